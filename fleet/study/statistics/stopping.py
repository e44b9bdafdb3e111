"""Stopping a study when it knows enough: intervals that stay valid however often one looks."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.errors import ArgumentError
from fleet.extras import import_extra
from fleet.study.statistics.estimate import LEVEL, Estimate, checked_count, error_share
from fleet.study.statistics.proportions import fewest_runs

EDGE = 1e-12
"""How near to 0 and 1 bounds are sought."""


@dataclass(frozen=True, slots=True)
class StoppingRule:
    """Fly on until a probability is known to a half-width, or `most_runs` are flown.

    One may look at the interval after each run, and stop for whatever reason: the probability that
    any interval of a growing study ever misses the truth is at most 1 - level. An interval has
    those shares p whose likelihood is more than 1 - level times the mean likelihood of shares that
    are drawn from a Beta distribution about p. Under p that ratio of mean to likelihood is a
    martingale that begins with 1, and by Ville's inequality exceeds 1 / (1 - level) at most so
    often. The Beta distribution is as wide as makes the intervals shortest about the half-width
    that is wanted, so that has to be chosen before the first run. It takes about 2.5 times the runs
    of a fixed number.

    Sources: H. Robbins, Annals of Mathematical Statistics 41 (1970), 1397; S. R. Howard, A. Ramdas,
    J. McAuliffe and J. Sekhon, Annals of Statistics 49 (2021), 1055, and Probability Surveys 17
    (2020), 257 (mixture of Beta and binomial).

    Raises:
        ArgumentError: a half-width or level that is not between 0 and 1, no run.
    """

    half_width: float
    most_runs: int
    level: float = LEVEL

    def __post_init__(self) -> None:
        """Refuse what no study can reach."""
        error_share(self.level)
        if not 0 < self.half_width < 1 or self.most_runs < 1:
            raise ArgumentError(
                "expected a half-width between 0 and 1 and at least one run, not "
                f"{self.half_width} and {self.most_runs}"
            )

    def estimate(self, events: int, runs: int) -> Estimate:
        """The probability of an event that happened in so many of the runs until now.

        Raises:
            ArgumentError: more events than runs, or no run.
            MissingExtraError: SciPy is not installed.
        """
        checked_count(events, runs)
        low, high = self._bounds(events, runs)
        return Estimate(events / runs, low, high, self.level, int(runs), "anytime")

    def enough(self, events: int, runs: int) -> bool:
        """Whether a study with so many events in so many runs may stop."""
        if runs < 1:
            return False
        known = self.estimate(events, runs).half_width <= self.half_width
        return known or runs >= self.most_runs

    def runs_expected(self, expected: float) -> int:
        """About how many runs it takes if the share of events comes out as `expected` (0 to 1)."""
        fewest = fewest_runs(self._bounds, self.half_width, expected, self.level)
        return min(fewest, self.most_runs)

    def _bounds(self, events: float, runs: float, _level: float = LEVEL) -> tuple[float, float]:
        optimize = import_extra("scipy.optimize", "study", "the statistics of a study")

        def excess(share: float) -> float:
            return self._log_ratio(share, events, runs)

        value, near = min(max(events / runs, EDGE), 1 - EDGE), {"xtol": 1e-15, "rtol": 1e-13}
        low = high = None
        if excess(EDGE) > 0:
            low = optimize.brentq(excess, EDGE, value, **near)
        if excess(1 - EDGE) > 0:
            high = optimize.brentq(excess, value, 1 - EDGE, **near)
        return float(low or 0.0), float(high or 1.0)

    def _log_ratio(self, share: float, events: float, runs: float) -> float:
        """Logarithm of mean likelihood by likelihood of a share, less what it may come to."""
        special = import_extra("scipy.special", "study", "the statistics of a study")
        worth = 0.1 / (self.half_width * self.half_width)
        one, other = worth * share, worth * (1 - share)
        mean = special.betaln(one + events, other + runs - events) - special.betaln(one, other)
        likelihood = special.xlogy(events, share) + special.xlog1py(runs - events, -share)
        return float(mean - likelihood + special.xlogy(1, error_share(self.level)))
