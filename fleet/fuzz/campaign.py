"""A campaign: many trials on all processors, in order of their seeds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from fleet.fuzz.cases import case_of
from fleet.fuzz.trial import Trial, fly_case
from fleet.simulation.worker_pool import WorkerPool

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
    """Trials of the seeds from `first_seed` on, in their order.

    Raises:
        BrokenProcessPool: a worker was killed.

    """
    early: dict[int, Trial] = {}
    seeds = range(first_seed, first_seed + runs)
    expected = iter(seeds)
    wanted = next(expected, None)
    with WorkerPool(jobs) as pool:
        for seed, trial in pool.each(_trial, seeds, QUEUED_AHEAD):
            early[seed] = trial
            while wanted in early:
                yield early.pop(wanted)
                wanted = next(expected, None)


def _trial(seed: int) -> Trial:
    return fly_case(case_of(seed))
