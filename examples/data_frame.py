"""Read a log into a data frame (needs pandas), and tell how fast who climbed.

python examples/data_frame.py [LOG]
"""

import sys

import fleet

if len(sys.argv) > 1:
    run = fleet.open_log(sys.argv[1])
else:
    run = fleet.run("side", out="side.mcap", overwrite=True)

frame = run.log.columns("*/truth").frame()
frame["t_s"] = frame["t_ns"] / 1e9
frame["climb_mps"] = -frame["velocity_ned_mps_2"]
print(frame.groupby("id")[["climb_mps", "speed_mps"]].describe().T.to_string())
