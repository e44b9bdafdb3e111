"""What a process for each UAV costs over zenoh, at growing numbers: who needs how much processor.

    python -m benchmarks.processes [--counts 32 64 128] [--ranges-m 1500 3000 6000]
                                   [--seconds 10] [--clock lockstep realtime]

Random traffic at 0.25 UAVs per square km, one process each, the coordinator and the simulation with
its log, on this machine. Processor time is that of the kernel's accounts (/proc, Linux), from 2 s
of flight on: of the simulation (which is the router, too), and of a UAV in the mean. Then
`time of a UAV = a + b * deliveries` is fitted over all runs of a clock. Where a realtime
run asks for more than the machine has, the simulation does not keep up, and only the pace is told.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import isnan, nan
from pathlib import Path

import numpy as np

from benchmarks.startup import pss_mb
from fleet.config.loading import load_scenario
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet

WARM_UP_S = 2.0
CLOCKS = ("lockstep", "realtime")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


@dataclass
class Spent:
    """Processor time in s by process, and messages delivered, up to a moment of the run."""

    sim_s: float
    processor_s: dict[int, float]
    delivered: int
    late: int


@dataclass(frozen=True)
class Row:
    """For a second of simulated time."""

    simulation_s: float
    uav_s: float
    delivered: float
    late_share: float
    speed: float
    memory_mb: float


def processor_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S


def descendants(pid: int) -> list[int]:
    """All processes that a process has started, and those have."""
    parents = dict[int, list[int]]()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text(encoding="ascii")
            except OSError:
                continue
            parents.setdefault(int(stat.rpartition(")")[2].split()[1]), []).append(int(entry.name))
    found, left = list[int](), [pid]
    while left:
        left = [child for parent in left for child in parents.get(parent, [])]
        found += left
    return found


def spent(outcome: RunOutcome) -> Spent:
    """Up to now."""
    tally = outcome.run_recorder.tally
    pids = [os.getpid(), *descendants(os.getpid())]
    return Spent(
        outcome.sim_s,
        {pid: processor_s(pid) for pid in pids},
        sum(n for (_, fate), n in tally.fates.items() if fate),
        tally.late.total(),
    )


def fly(count: int, range_m: float, seconds: float, clock: str, folder: Path) -> Row:
    """One run."""
    settings = {
        "generate.count": count,
        "duration_s": WARM_UP_S + seconds,
        "surveillance.range_m": range_m,
    }
    scenario = load_scenario("crossing", settings)
    marks, memory = list[Spent](), list[float]()

    def look(outcome: RunOutcome) -> None:
        if not marks and outcome.sim_s >= WARM_UP_S:
            marks.append(spent(outcome))
        if len(marks) == 1 and outcome.sim_s >= WARM_UP_S + seconds - scenario.tick_s:
            marks.append(spent(outcome))
            memory.extend(pss_mb(pid) for pid in descendants(os.getpid()))

    options = RunOptions(scenario, out=folder / "run.mcap", force=True, bus="zenoh", clock=clock)
    outcome = run_fleet(options, look)
    assert outcome.status == "complete", outcome.why
    begin, end = marks
    span_s = end.sim_s - begin.sim_s
    if span_s < 0.5 * seconds:
        return Row(nan, nan, nan, nan, outcome.sim_s / outcome.wall_s, sum(memory) / count)
    used = {pid: end.processor_s[pid] - s for pid, s in begin.processor_s.items()}
    simulation_s = used.pop(os.getpid()) / span_s
    steps = (count + 1) * span_s / scenario.tick_s
    return Row(
        simulation_s,
        sum(used.values()) / span_s / count,
        (end.delivered - begin.delivered) / span_s / count,
        (end.late - begin.late) / steps,
        outcome.sim_s / outcome.wall_s,
        sum(memory) / count,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly all, print a row each and the fits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[32, 64, 128])
    parser.add_argument("--ranges-m", type=float, nargs="+", default=[1500.0, 3000.0, 6000.0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--clock", choices=CLOCKS, nargs="+", default=list(CLOCKS))
    options = parser.parse_args(arguments)
    print(
        "| UAVs | radio range | clock | times real time | delivered to a UAV in 1 s "
        "| a UAV, ms in 1 s | simulation, s in 1 s | MB a UAV | late steps |\n"
        "|---|---|---|---|---|---|---|---|---|"
    )
    for clock in options.clock:
        rows = []
        for count, range_m in product(options.counts, options.ranges_m):
            with tempfile.TemporaryDirectory() as folder:
                row = fly(count, range_m, options.seconds, clock, Path(folder))
            if not isnan(row.uav_s):
                rows.append(row)
            late = f"{100 * row.late_share:.1f}%" if clock == "realtime" else "-"
            told = f"{row.speed:.2f} | {row.delivered:.1f} | {1e3 * row.uav_s:.1f}"
            told += f" | {row.simulation_s:.3f} | {row.memory_mb:.1f} | {late}"
            line = f"| {count} | {range_m:g} m | {clock} | {told} |"
            print(line.replace("nan%", "-").replace("nan", "-"), flush=True)
        if len(rows) > 2:
            per, base = np.polyfit([r.delivered for r in rows], [r.uav_s for r in rows], 1)
            print(f"\n{clock}: a UAV {1e3 * base:.2f} ms + {1e6 * per:.0f} us a delivery\n")


if __name__ == "__main__":
    main()
