"""Runs in memory, on one core, beside BlueSky: seconds of processor time for a simulated second.

    python -m benchmarks.memory [--counts 4 30 100 1000] [--simulated 20] [--rounds 3]

N UAVs of random traffic (`crossing`) at 1 per square km, with and without a digest, and from 100 on
with a radio range of 3 km as well. BlueSky (`pip install bluesky-simulator==1.1.1`), where it is
installed, flies as many multicopters from the same places on the same headings at 18 m/s, the most
that its M600 flies: headless, with its compiled conflict detection every second and MVP, the same
protected zones and look-ahead, and no messages. The two take turns, and the least of all rounds
counts. What it takes to set out is not counted. Before that `four_way`, and two packaged encounters
for 120 s under a latency of 0.5 s and a loss of 30 %.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fleet.config.loading import load_scenario, read_scenario
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder

RANGE_M = 3000.0
RANGED_FROM = 100
FOOT_M, MILE_M = 0.3048, 1852.0
M_PER_DEG = 6371000.0 * math.pi / 180.0
STEPS_PER_S = 20
"""BlueSky's, of 0.05 s."""


def traffic(count: int, *changes: str) -> Scenario:
    """Random traffic at 1 UAV per square km."""
    table = [f"generate.count={count}", "generate.density_per_km2=1", *changes]
    return read_scenario("crossing", table).scenario


def own(scenario: Scenario, simulated_s: float, *, digested: bool) -> float:
    """Processor time for a simulated second of ours."""
    run = run_in_memory(scenario, RunRecorder(scenario, None, digested=digested))
    next(run)
    begun = time.process_time()
    for now_ns in run:
        if now_ns >= simulated_s * 1e9:
            break
    return (time.process_time() - begun) / simulated_s


class BlueSky:
    """BlueSky in this process; raises ImportError if it is not installed."""

    def __init__(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            import bluesky  # noqa: PLC0415 (it may not be there)

            bluesky.init(mode="sim", detached=True)
        self._bluesky: Any = bluesky

    def fly(self, uavs: Sequence[Uav], scenario: Scenario, simulated_s: float) -> float:
        """Processor time for a simulated second of its."""
        sim, traf = self._bluesky.sim, self._bluesky.traf
        required = scenario.required()
        with contextlib.redirect_stdout(io.StringIO()):
            sim.reset()
            for command in (
                "ASAS ON",
                "RESO MVP",
                f"ZONER {required.horizontal_m / MILE_M}",
                f"ZONEDH {required.vertical_m / FOOT_M}",
                f"DTLOOK {scenario.resolution.horizon_s}",
            ):
                self._bluesky.stack.stack(command)
            sim.step()
            places = np.array([u.position_ned_m for u in uavs])
            traf.cre(
                [f"U{u.id}" for u in uavs],
                "M600",
                places[:, 0] / M_PER_DEG,
                places[:, 1] / M_PER_DEG,
                np.array([u.heading_deg % 360.0 for u in uavs]),
                -places[:, 2],
                np.full(len(uavs), 18.0),
            )
            sim.op()
            sim.step()
            begun = time.process_time()
            for _ in range(round(STEPS_PER_S * simulated_s)):
                sim.step()
            return (time.process_time() - begun) / simulated_s


def rivals(count: int, simulated_s: float, other: BlueSky | None) -> dict[str, Callable[[], float]]:
    """What is measured for so many UAVs, by name."""
    plain = traffic(count)
    out = {
        "bare": lambda: own(plain, simulated_s, digested=False),
        "digest": lambda: own(plain, simulated_s, digested=True),
    }
    if count >= RANGED_FROM:
        ranged = traffic(count, f"surveillance.range_m={RANGE_M}")
        out["range 3 km"] = lambda: own(ranged, simulated_s, digested=False)
    if other is not None:
        out["BlueSky"] = lambda: other.fly(uavs_of(plain), plain, simulated_s)
    return out


def main() -> None:
    """Measure and print a row for each number of UAVs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[4, 30, 100, 1000])
    parser.add_argument("--simulated", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    four_way = read_scenario("four_way").scenario
    for digested in (False, True):
        times = [own(four_way, 250.0, digested=digested) for _ in range(options.rounds)]
        name = "with a digest" if digested else "without"
        print(f"four_way {name}: {1.0 / min(times):.0f} times real time", flush=True)
    for name in ("head_on", "side"):
        faulty = load_scenario(name, {"duration_s": 120}, {"latency": "500ms", "loss": "30%"})
        least_s = 120.0 * min(own(faulty, 120.0, digested=False) for _ in range(options.rounds))
        print(f"{name} under faults, 120 s: {1e3 * least_s:.0f} ms", flush=True)
    try:
        other = BlueSky()
    except ImportError:
        other = None
    columns = ("bare", "digest", "range 3 km", "BlueSky")
    print(f"\n| N | {' | '.join(columns)} | best of ours / BlueSky |\n|---|---|---|---|---|---|")
    for count in options.counts:
        runs = rivals(count, options.simulated, other)
        rounds = [{name: run() for name, run in runs.items()} for _ in range(options.rounds)]
        least = {name: min(r[name] for r in rounds) for name in runs}
        cells = [f"{least[c]:.4f}" if c in least else "-" for c in columns]
        best = min(value for name, value in least.items() if name != "BlueSky")
        ratio = f"{best / least['BlueSky']:.1f}" if "BlueSky" in least else "-"
        print(f"| {count} | {' | '.join(cells)} | {ratio} |", flush=True)


if __name__ == "__main__":
    main()
