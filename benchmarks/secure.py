"""What certificates cost: lockstep runs over zenoh with and without `--secure`, in turn.

    python -m benchmarks.secure [SCENARIO] [--rounds 10] [--set duration_s=60]

Each round flies the scenario both ways, the first one by turns; wall time a
tick, and the ratios. The least of each is what the machine can do undisturbed.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.security.certificates import make_certificates
from fleet.simulation.simulation import RunOptions, run_fleet

OPEN, SECURE = "open", "secure"


def flown(scenario: Scenario, secure: str) -> tuple[float, str]:
    """Wall milliseconds a tick of one run, and its digest."""
    outcome = run_fleet(RunOptions(scenario, secure=secure), lambda _: None)
    if outcome.status != "complete":
        raise SystemExit(outcome.why)
    return 1000 * outcome.wall_s / outcome.ticks, outcome.run_recorder.digest


def main() -> None:
    """Fly in turn and compare."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--set", dest="settings", action="append", default=[])
    given = parser.parse_args()
    scenario = read_scenario(given.scenario, given.settings).scenario
    took: dict[str, list[float]] = {OPEN: [], SECURE: []}
    with tempfile.TemporaryDirectory() as folder:
        certs = Path(folder) / "certs"
        make_certificates(certs, [uav.id for uav in uavs_of(scenario)], [], 1.0, time.time())
        where = {OPEN: "", SECURE: str(certs)}
        digests = set()
        for number in range(given.rounds):
            for mode in (OPEN, SECURE) if number % 2 else (SECURE, OPEN):
                tick_ms, digest = flown(scenario, where[mode])
                took[mode].append(tick_ms)
                digests.add(digest)
    if len(digests) != 1:
        raise SystemExit("the digests differ")
    for mode, times in took.items():
        print(f"{mode:6} ms a tick: least {min(times):.3f}, median {statistics.median(times):.3f}")
    ratios = [s / o for s, o in zip(took[SECURE], took[OPEN], strict=True)]
    least = min(took[SECURE]) / min(took[OPEN])
    print(
        f"secure / open: of the least {least:.3f}, median of pairs {statistics.median(ratios):.3f}"
    )


if __name__ == "__main__":
    main()
