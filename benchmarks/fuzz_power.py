"""What `fleet fuzz` would find: bugs put into the protocol one by one, and looked for.

    python -m benchmarks.fuzz_power [--runs 1000] [--seed 0] [--bug NAME ...] [--jobs 1]

Every bug of the committed list (`protocol_bugs.toml`) is applied in a process of its own, in which
the cases of `fleet fuzz` are flown from the first seed on, until one is not valid: an invariant is
violated, the run crashes, or it hangs. The table says after how many cases, and by what. The exit
code is 1 if a bug that the list does not explain is not found. Changes that the list calls
equivalent, which are no bugs, and bugs of which it says why they survive, are flown for a tenth of
the cases.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

from benchmarks.mutation import Bug, bugs, sabotage

HANG_S = 30.0


def hunt(bug: Bug, first_seed: int, runs: int) -> tuple[int, tuple[str, ...]]:
    """After how many cases a bug is found, and by what; (runs, ()) if it is not.

    Only for a process that has imported nothing of the fleet yet.
    """
    sabotage(bug)
    from fleet.fuzz.cases import case_of  # noqa: PLC0415 (only now: the bug is to be imported)
    from fleet.fuzz.trial import fly_case  # noqa: PLC0415

    for n in range(runs):
        failures = fly_case(case_of(first_seed + n), HANG_S).failures
        if failures:
            return n + 1, failures
    return runs, ()


def verdict(bug: Bug, failures: Sequence[str]) -> str:
    """What a row of the table says."""
    if failures:
        return ", ".join(failures)
    if bug.equivalent:
        return f"no bug: {bug.equivalent}"
    return f"NOT FOUND: {bug.survives or 'unexplained'}"


def main() -> int:
    """Hunt and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bug", action="append")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    chosen = [b for b in bugs() if not options.bug or b.name in options.bug]
    context = mp.get_context("spawn")
    print("| bug | cases | found by |\n|---|---|---|", flush=True)
    found = unexplained = 0
    with ProcessPoolExecutor(options.jobs, context, max_tasks_per_child=1) as pool:
        cases = [
            options.runs // 10 if bug.equivalent or bug.survives else options.runs for bug in chosen
        ]
        hunts = [pool.submit(hunt, b, options.seed, n) for b, n in zip(chosen, cases, strict=True)]
        for bug, pending in zip(chosen, hunts, strict=True):
            flown, failures = pending.result()
            found += bool(failures)
            unexplained += not (failures or bug.equivalent or bug.survives)
            print(f"| {bug.name} | {flown} | {verdict(bug, failures)} |", flush=True)
    real = sum(not bug.equivalent for bug in chosen)
    print(f"\n{found} of {real} bugs found; {len(chosen) - real} changes are no bugs")
    return int(unexplained > 0)


if __name__ == "__main__":
    sys.exit(main())
