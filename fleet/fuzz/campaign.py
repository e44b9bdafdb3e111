"""A campaign: many trials on all processors, in order of their seeds."""

from __future__ import annotations

import multiprocessing as mp
import signal
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field

from fleet.fuzz.cases import case_of
from fleet.fuzz.trial import Trial, fly

AHEAD = 8
"""So many trials a process are handed out in advance."""


@dataclass
class Tally:
    """What a campaign has come to."""

    runs: int = 0
    failed: list[Trial] = field(default_factory=list)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)
    lost_separation: int = 0

    def add(self, trial: Trial) -> None:
        """Count a trial."""
        self.runs += 1
        self.lost_separation += trial.lost_separation
        self.verdicts.update(trial.verdicts.items())
        if trial.failures:
            self.failed.append(trial)


def campaign(first_seed: int, runs: int, jobs: int) -> Iterator[Trial]:
    """Trials of the seeds from `first_seed` on.

    Raises:
        BrokenProcessPool: a worker was killed.

    """
    if jobs == 1:
        for seed in range(first_seed, first_seed + runs):
            yield fly(case_of(seed))
        return
    context = mp.get_context("forkserver")
    with ProcessPoolExecutor(jobs, context, _deaf) as pool:
        waiting: deque[Future[Trial]] = deque()
        try:
            for seed in range(first_seed, first_seed + runs):
                waiting.append(pool.submit(_trial, seed))
                if len(waiting) >= AHEAD * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)  # what was not begun is not waited for


def _trial(seed: int) -> Trial:
    return fly(case_of(seed))


def _deaf() -> None:
    """Ctrl-C goes to the whole terminal group; the campaign itself ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
