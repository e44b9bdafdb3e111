"""A campaign: many trials on all processors, in order of their seeds."""

from __future__ import annotations

import multiprocessing as mp
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field

from fleet.fuzz.cases import case_of
from fleet.fuzz.trial import Trial, fly_case
from fleet.simulation.interrupts import Interrupts
from fleet.simulation.orphans import start_fork_server, tie_worker
from fleet.simulation.os_limits import check_room

QUEUED_AHEAD = 8
"""So many trials a process are handed out in advance."""


@dataclass
class CampaignTally:
    """What a campaign has come to."""

    runs: int = 0
    failed: list[Trial] = field(default_factory=list)
    verdicts: Counter[tuple[str, str]] = field(default_factory=Counter)
    lost_separation: int = 0
    due: int = 0
    not_arrived: int = 0

    def add(self, trial: Trial) -> None:
        """Count a trial."""
        self.runs += 1
        self.lost_separation += trial.lost_separation
        self.due += trial.due
        self.not_arrived += trial.not_arrived
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
            yield fly_case(case_of(seed))
        return
    context = mp.get_context("forkserver")
    check_room(jobs)
    start_fork_server([])
    before = mp.active_children()
    interrupts = Interrupts()
    interrupts.install()
    with ProcessPoolExecutor(jobs, context, tie_worker) as pool:
        waiting: deque[Future[Trial]] = deque()
        try:
            for seed in range(first_seed, first_seed + runs):
                with interrupts:  # a worker that is just being started is to be known
                    waiting.append(pool.submit(_trial, seed))
                if len(waiting) >= QUEUED_AHEAD * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BaseException:  # given up: what is still being flown is of no use
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(mp.active_children()).difference(before):
                worker.kill()
            raise
        finally:
            interrupts.restore()


def _trial(seed: int) -> Trial:
    return fly_case(case_of(seed))
