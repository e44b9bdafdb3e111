"""What certificates cost: lockstep runs over zenoh with and without `--secure`, in turn.

    python -m benchmarks.secure [SCENARIO] [--rounds 10] [--set duration_s=60]

Each round flies the scenario both ways, the first one by turns. Wall time a tick, and processor
time of all processes a tick from the first to the last one, which says more on a machine that is
busy with other things; the least of each is what the machine can do undisturbed.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.security.certificates import make_certificates
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet

OPEN, SECURE = "open", "secure"
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def processor_s(pids: list[int]) -> float:
    """Processor time that processes have used so far (Linux)."""
    total = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(") ")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / TICKS_A_SECOND


def flown(scenario: Scenario, secure: str) -> tuple[dict[str, float], str]:
    """Wall and processor milliseconds a tick of one run, and its digest."""
    used: list[float] = []

    def note(outcome: RunOutcome) -> None:
        if outcome.ticks in (1, scenario.ticks):
            used.append(processor_s([os.getpid(), *outcome.pids.values()]))

    outcome = run_fleet(RunOptions(scenario, secure=secure), note)
    if outcome.status != "complete":
        raise SystemExit(outcome.why)
    processor = used[-1] - used[0]
    spent = {"wall": outcome.wall_s, "processor": processor}
    return {what: 1000 * s / outcome.ticks for what, s in spent.items()}, (
        outcome.run_recorder.digest
    )


def main() -> None:
    """Fly in turn and compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--set", dest="settings", action="append", default=[])
    given = parser.parse_args()
    scenario = read_scenario(given.scenario, given.settings).scenario
    took: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    digests = set()
    with tempfile.TemporaryDirectory() as folder:
        certs = Path(folder) / "certs"
        make_certificates(certs, [uav.id for uav in uavs_of(scenario)], [], 1.0, time.time())
        where = {OPEN: "", SECURE: str(certs)}
        for number in range(given.rounds):
            for mode in (OPEN, SECURE) if number % 2 else (SECURE, OPEN):
                spent, digest = flown(scenario, where[mode])
                digests.add(digest)
                for what, tick_ms in spent.items():
                    took[what][mode].append(tick_ms)
    if len(digests) != 1:
        raise SystemExit("the digests differ")
    for what, by_mode in took.items():
        for mode in (OPEN, SECURE):
            times = by_mode[mode]
            least, median = min(times), statistics.median(times)
            print(f"{what:9} {mode:6} ms a tick: least {least:.3f}, median {median:.3f}")
        pairs = [s / o for s, o in zip(by_mode[SECURE], by_mode[OPEN], strict=True)]
        ratio = min(by_mode[SECURE]) / min(by_mode[OPEN])
        median = statistics.median(pairs)
        print(f"{what:9} secure / open: of the least {ratio:.3f}, median of pairs {median:.3f}")


if __name__ == "__main__":
    main()
