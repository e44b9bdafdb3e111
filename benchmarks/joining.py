"""Memory of UAVs that are started by hand: one command each, and all by one command.

    python -m benchmarks.joining [--uavs 12]

A realtime run of `crossing` that waits for others (`fleet run --external`); once all have joined
and fly, the proportional set size (Linux) of all processes of the commands is added up: of the
UAVs, and what the one command needs beside them (itself, the fork server). Private memory is what a
process shares with nobody.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.startup import pss_mb
from fleet.transport.run_search import find_plan
from fleet.transport.zenoh_bus import open_client_bus

FLEET = (sys.executable, "-m", "fleet")
SETTLE_S = 5.0
"""Of flight, before memory is read."""


def private_mb(pid: int) -> float:
    """Memory that a process shares with no other, MB."""
    kib = 0
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        if line.startswith("Private_"):
            kib += int(line.split()[1])
    return kib * 1024 / 1e6


def members(session: int) -> list[int]:
    """All processes of a session."""
    pids = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    return [pid for pid in pids if _session(pid) == session]


def _session(pid: int) -> int:
    try:
        return os.getsid(pid)
    except ProcessLookupError:
        return 0


def measure(uavs: int, commands: Sequence[str]) -> None:
    """Fly with UAVs that these arguments of `fleet uav` start, and print what they need."""
    started: list[subprocess.Popen[str]] = []
    try:
        _fly_and_measure(uavs, commands, started)
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.communicate()


def _fly_and_measure(
    uavs: int, commands: Sequence[str], started: list[subprocess.Popen[str]]
) -> None:
    def start(*words: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            (*FLEET, *words),
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        return process

    with tempfile.TemporaryDirectory() as folder:
        router = start("router", "--listen", f"unixsock-stream/{folder}/bus")
        assert router.stderr is not None
        endpoint = router.stderr.readline().split()[-1]
        scenario = ("crossing", "--set", f"generate.count={uavs}", "--clock", "realtime")
        where = ("--connect", endpoint)
        start("run", *scenario, "--external", *where, "--out", f"{folder}/run.mcap")
        groups = [start("uav", ids, *where) for ids in commands]
        start("coordinator", *where)
        name, _ = find_plan(endpoint, "*", 60.0)
        with open_client_bus(name, "watcher", endpoint) as watcher:
            while not all(watcher.is_alive(str(n + 1)) for n in range(uavs)):
                time.sleep(0.1)
        time.sleep(SETTLE_S)
        processes = [pid for group in groups for pid in members(group.pid)]
        total = sum(map(pss_mb, processes))
        private = statistics.median(map(private_mb, processes))
        print(
            f"{len(groups)} commands for {uavs} UAVs, {len(processes)} processes: {total:.0f} MB, "
            f"{total / uavs:.1f} MB a UAV; private, median of the processes: {private:.1f} MB",
            flush=True,
        )


def main() -> None:
    """Measure both ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uavs", type=int, default=12)
    uavs = parser.parse_args().uavs
    measure(uavs, [str(n + 1) for n in range(uavs)])
    measure(uavs, [f"1-{uavs}"])


if __name__ == "__main__":
    main()
