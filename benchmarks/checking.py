"""What `fleet check` takes for a long run: processor time and memory, at growing lengths.

    python -m benchmarks.checking [--lengths-s 75 150 300] [--uavs 16]

UAVs patrol between random points (as in `tests.hosts.soak`), in memory, under 200 ms of latency and
10 % of loss in bursts. Each log is checked by a process of its own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from fleet.config.loading import load_scenario
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.hosts.soak import patrols

FAULTS = {"latency": "200ms", "loss": "10%", "burst": "3"}


def flown(folder: Path, uavs: int, length_s: float) -> Path:
    """The log of a flight of that length."""
    file, log = folder / "patrols.toml", folder / "patrols.mcap"
    file.write_text(patrols(uavs, length_s, 1), encoding="utf-8")
    scenario = load_scenario(str(file), None, FAULTS)
    outcome = run_fleet(RunOptions(scenario, out=log, force=True, bus="memory"), lambda _: None)
    assert outcome.status == "complete", outcome.why
    return log


def checked(log: Path) -> tuple[float, float]:
    """Processor time in s and the most memory in MB of a check."""
    check = subprocess.Popen(
        [sys.executable, "-m", "fleet", "check", str(log)], stdout=subprocess.DEVNULL
    )
    _, status, used = os.wait4(check.pid, 0)
    assert os.waitstatus_to_exitcode(status) == 0
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly and check all, and print a row each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lengths-s", type=float, nargs="+", default=[75.0, 150.0, 300.0])
    parser.add_argument("--uavs", type=int, default=16)
    options = parser.parse_args(arguments)
    print(
        "| UAVs | flown | log | check, s | s for an hour | check, MB |\n|---|---|---|---|---|---|"
    )
    for length_s in options.lengths_s:
        with tempfile.TemporaryDirectory() as folder:
            log = flown(Path(folder), options.uavs, length_s)
            used_s, most_mb = checked(log)
            told = f"{log.stat().st_size / 1e6:.0f} MB | {used_s:.1f}"
        hour_s = 3600.0 * used_s / length_s
        print(
            f"| {options.uavs} | {length_s:g} s | {told} | {hour_s:.0f} | {most_mb:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
