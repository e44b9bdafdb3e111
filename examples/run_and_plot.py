"""Fly the paper's four-UAV encounter and draw it from above (needs Matplotlib).

python examples/run_and_plot.py [FILE.png]
"""

import sys

import matplotlib.pyplot as plt

import fleet

run = fleet.run("four_way")
metrics = fleet.measure(run)
print(f"least normalised separation {metrics.totals.least_separation:.3f}; below 1 is a loss")

figure, axes = plt.subplots()
for uav in metrics.uavs:
    north_m, east_m, _ = run[f"{uav.id}/truth"].position_ned_m.T
    axes.plot(east_m, north_m, label=f"UAV {uav.id}")
axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
axes.legend()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "four_way.png")
