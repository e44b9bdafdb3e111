"""The probability of an event in a run, from how many runs had it, and how many runs that takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

from fleet.errors import ArgumentError
from fleet.study.statistics.estimate import (
    LEVEL,
    Estimate,
    checked_count,
    error_share,
    normal_quantile,
    scipy_stats,
)

ProportionMethod = Literal["exact", "wilson"]
"""`exact` (Clopper-Pearson) never covers less than its level, whatever the probability; `wilson`
(score) is shorter and covers its level on average."""

Bounds = Callable[[float, float, float], tuple[float, float]]
"""Bounds of a proportion from events (which need not be whole), runs and level."""

MOST_RUNS = 10**12


def proportion(
    events: int, runs: int, level: float = LEVEL, method: ProportionMethod = "exact"
) -> Estimate:
    """The probability of an event that happened in `events` of `runs` independent runs.

    Sources: C. J. Clopper and E. S. Pearson, Biometrika 26 (1934); E. B. Wilson, JASA 22 (1927);
    L. D. Brown, T. T. Cai and A. DasGupta, Statistical Science 16 (2001), compare them.

    Raises:
        ArgumentError: more events than runs, no run, an unknown method or level.
        MissingExtraError: SciPy is not installed.
    """
    checked_count(events, runs)
    low, high = _bounds(method)(events, runs, level)
    return Estimate(events / runs, low, high, level, int(runs), method)


def exact_bounds(events: float, runs: float, level: float = LEVEL) -> tuple[float, float]:
    """Clopper-Pearson bounds by the Beta distribution, also of counts that are not whole."""
    beta, share = scipy_stats().beta, error_share(level) / 2
    low = float(beta.ppf(share, events, runs - events + 1)) if events > 0 else 0.0
    high = float(beta.isf(share, events + 1, runs - events)) if events < runs else 1.0
    return low, high


def wilson_bounds(events: float, runs: float, level: float = LEVEL) -> tuple[float, float]:
    """Wilson's score bounds, also of counts that are not whole."""
    return score_bounds(events, runs, normal_quantile(level))


def score_bounds(events: float, runs: float, z: float) -> tuple[float, float]:
    """Wilson's score bounds for a quantile z of the normal distribution."""
    middle = (events + z * z / 2) / (runs + z * z)
    reach = z * math.sqrt(events * (1 - events / runs) + z * z / 4) / (runs + z * z)
    low = middle - reach if events > 0 else 0.0
    high = middle + reach if events < runs else 1.0
    return low, high


def runs_needed(
    half_width: float,
    expected: float = 0.5,
    level: float = LEVEL,
    method: ProportionMethod = "exact",
) -> int:
    """The fewest runs whose interval is no wider than twice `half_width`.

    That is if the share of events comes out as `expected`; 0.5 is the worst case of most. An event
    that is expected never (0) or always (1) needs the fewest.

    Raises:
        ArgumentError: a half-width that is not between 0 and 1, an expected share outside 0 to 1.
        MissingExtraError: SciPy is not installed.
    """
    if not 0 < half_width < 1 or not 0 <= expected <= 1:
        raise ArgumentError(
            f"expected a half-width and a share between 0 and 1, not {half_width} and {expected}"
        )
    return fewest_runs(_bounds(method), half_width, expected, level)


def fewest_runs(bounds: Bounds, half_width: float, expected: float, level: float) -> int:
    """The fewest runs for a half-width by any bounds that narrow with runs."""

    def narrow(runs: int) -> bool:
        low, high = bounds(expected * runs, runs, level)
        return high - low <= 2 * half_width

    enough = 1
    while not narrow(enough):
        if enough > MOST_RUNS:
            raise ArgumentError(f"half-width: {half_width} takes more than {MOST_RUNS} runs")
        enough *= 2
    too_few = enough // 2
    while enough - too_few > 1:
        middle = (enough + too_few) // 2
        enough, too_few = (middle, too_few) if narrow(middle) else (enough, middle)
    return enough


def _bounds(method: str) -> Bounds:
    known: dict[str, Bounds] = {"exact": exact_bounds, "wilson": wilson_bounds}
    if method not in known:
        raise ArgumentError(f"method: expected one of {', '.join(known)}, not {method!r}")
    return known[method]
