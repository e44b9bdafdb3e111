"""What every interval of a study is told as: a value, its bounds, and how they were found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.extras import import_extra
from fleet.model.types import Array, Truths

LEVEL = 0.95
"""The confidence level unless another is asked for."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number estimated from runs, with a two-sided confidence interval.

    `value` is nan where the runs say nothing of it (a ratio of nothing to nothing); `low` and
    `high` are in its unit, infinite where there is no bound. `level` is the confidence level,
    `runs` how many runs it is of, `method` names the interval as docs/statistics.md does.
    """

    value: float
    low: float
    high: float
    level: float
    runs: int
    method: str

    @property
    def half_width(self) -> float:
        """Half the length of the interval, in the unit of the value."""
        return (self.high - self.low) / 2

    def covers(self, truth: float) -> bool:
        """Whether a number is within the interval, bounds included."""
        return self.low <= truth <= self.high


def scipy_stats() -> Any:
    """`scipy.stats`, imported when it is needed; raises MissingExtraError without SciPy."""
    return import_extra("scipy.stats", "study", "the statistics of a study")


def error_share(level: float) -> float:
    """1 - level, how many intervals may miss; raises ArgumentError unless 0 < level < 1."""
    if not 0 < level < 1:
        raise ArgumentError(f"level: expected a share between 0 and 1, as 0.95, not {level}")
    return 1 - level


def normal_quantile(level: float) -> float:
    """The z of a two-sided interval of a confidence level: 1.96 of 0.95."""
    return float(scipy_stats().norm.isf(error_share(level) / 2))


def checked_count(events: float, runs: float) -> None:
    """Whether so many of so many is possible; raises ArgumentError if not."""
    if runs < 1 or not 0 <= events <= runs:
        raise ArgumentError(f"expected events of at least one run, not {events} of {runs}")


def truths_of(name: str, values: ArrayLike) -> Truths:
    """One truth a run; raises ArgumentError for none, or for what is neither true nor false."""
    given = np.asarray(values)
    if given.ndim != 1 or not len(given):
        raise ArgumentError(f"{name}: expected one truth a run, not an array of {given.shape}")
    if given.dtype != np.bool_ and not np.isin(given, (0, 1)).all():
        raise ArgumentError(f"{name}: expected true or false for each run")
    return given.astype(np.bool_)


def numbers_of(name: str, values: ArrayLike, *, finite: bool = True) -> Array:
    """One number a run; raises ArgumentError for none, for nan, and for infinite if not allowed."""
    given = np.asarray(values, dtype=np.float64)
    if given.ndim != 1 or not len(given):
        raise ArgumentError(f"{name}: expected one number a run, not an array of {given.shape}")
    wrong = ~np.isfinite(given) if finite else np.isnan(given)
    if wrong.any():
        raise ArgumentError(
            f"{name}: {np.count_nonzero(wrong)} of {len(given)} are {given[wrong][0]}; "
            "leave those runs out, or say what they count as"
        )
    return given


def share_of(name: str, value: float) -> float:
    """A share strictly between 0 and 1; raises ArgumentError for another."""
    if not (0 < value < 1 and math.isfinite(value)):
        raise ArgumentError(f"{name}: expected a share between 0 and 1, not {value}")
    return value
