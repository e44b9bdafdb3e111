"""Whether conditions differ on common encounters: McNemar's exact test, corrected by Holm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.extras import import_extra
from fleet.study.statistics.paired import PairedCounts


@dataclass(frozen=True, slots=True)
class ConditionTest:
    """McNemar's test between two conditions that were flown on the same encounters."""

    first: str
    second: str
    counts: PairedCounts
    p_value: float
    """Of the two-sided exact test, of this comparison alone."""
    adjusted_p_value: float
    """After Holm's correction for all comparisons that were made at once; this decides."""


def mcnemar_p_value(counts: PairedCounts) -> float:
    """The two-sided p-value of McNemar's exact test; 1 where no encounter tells them apart.

    Source: Q. McNemar, Psychometrika 12 (1947); the exact test is the binomial one of the
    encounters with an event under one condition alone (A. Agresti, Categorical Data Analysis).
    """
    tables = import_extra(
        "statsmodels.stats.contingency_tables", "study", "the statistics of a study"
    )
    table = [[counts.both, counts.first_only], [counts.second_only, counts.neither]]
    return float(tables.mcnemar(table, exact=True).pvalue)


def compare_conditions(
    outcomes: Mapping[str, ArrayLike], against: str | None = None
) -> tuple[ConditionTest, ...]:
    """Compare conditions by name, each with one truth an encounter in the same order.

    All pairs are compared, or each with `against` alone, which is then the first of each pair.

    Source: S. Holm, Scandinavian Journal of Statistics 6 (1979).

    Raises:
        ArgumentError: fewer than two conditions, `against` is none of them, or they are not of the
            same encounters.
        MissingExtraError: statsmodels is not installed.
    """
    if len(outcomes) < 2 or (against is not None and against not in outcomes):
        raise ArgumentError(
            f"expected at least two conditions, and to compare with one of them, not {against!r} "
            f"with {', '.join(outcomes) or 'none'}"
        )
    if against is None:
        pairs = list(combinations(outcomes, 2))
    else:
        pairs = [(against, name) for name in outcomes if name != against]
    counts = [PairedCounts.of(outcomes[first], outcomes[second]) for first, second in pairs]
    p_values = [mcnemar_p_value(c) for c in counts]
    several = import_extra("statsmodels.stats.multitest", "study", "the statistics of a study")
    adjusted = several.multipletests(p_values, method="holm")[1]
    return tuple(
        ConditionTest(*pair, c, p, float(a))
        for pair, c, p, a in zip(pairs, counts, p_values, adjusted, strict=True)
    )
