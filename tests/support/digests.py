"""The digests of the packaged scenarios and of random cases with all kinds of faults.

    python -m tests.support.digests [--share 0.2] [--cases 20]

They are flown in memory and printed as JSON, so that machines can be compared. With a share of it
each scenario is flown for that part of its time.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from itertools import count

from fleet.config.loading import convert, load_scenario, packaged
from fleet.config.scenario import Scenario
from fleet.faults.registry import kinds
from fleet.fuzz.cases import case_of
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder


def seeds(cases: int) -> list[int]:
    """So many seeds of cases with faults, if there are enough of them with all kinds together."""
    found: list[int] = []
    left = set(kinds())
    for seed in count(1):
        drawn = {rule["kind"] for rule in case_of(seed)["fault"]}
        if len(found) == cases:
            return found
        if drawn & left or (drawn and not left):
            found.append(seed)
            left -= drawn
    return found


def scenarios(share: float, cases: int) -> Iterator[tuple[str, Scenario]]:
    """What is flown, by name."""
    for name in packaged():
        duration_s = load_scenario(name).duration_s
        yield name, load_scenario(name, {"duration_s": max(1.0, round(share * duration_s))})
    for seed in seeds(cases):
        yield f"case {seed}", convert(case_of(seed), f"case {seed}")


def digest(scenario: Scenario) -> str:
    """The digest of a run in memory."""
    run_recorder = RunRecorder(scenario, None)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder.digest


def main() -> None:
    """Fly all and print the digests, as they come."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--cases", type=int, default=20)
    options = parser.parse_args()
    for name, scenario in scenarios(options.share, options.cases):
        print(json.dumps({name: digest(scenario)}), flush=True)


if __name__ == "__main__":
    main()
