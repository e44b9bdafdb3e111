"""How often the intervals of studies cover what is true: simulated studies of known probability.

    python -m benchmarks.coverage [--studies 1000] [--rare 100] [--only ratio]

Each line is one kind of interval in one case: how many of so many studies covered the truth, how
many were wholly above or below it, the median half-width, and the mean of the values by the truth.
All intervals are of level 95 %. Of 1,000 studies that cover 95 % of the time, between 936 and 964
do in 19 of 20 cases.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import numpy as np

from benchmarks.coverage_cases import Case, cases
from fleet.study.statistics.estimate import Estimate

SEED = 20_250_101


@dataclass
class Count:
    """What came of the studies of a case."""

    studies: int = 0
    above: int = 0
    below: int = 0
    widths: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, found: Estimate, truth: float) -> None:
        """Count a study; a bound may be off by rounding."""
        self.studies += 1
        slack = 1e-12 * abs(truth)
        self.above += found.low > truth + slack
        self.below += found.high < truth - slack
        self.widths.append(found.half_width)
        self.values.append(found.value)


def row(case: Case, studies: int) -> str:
    """Simulate a case, and tell it as a line of the table."""
    count = Count()
    for seed in np.random.SeedSequence(SEED).generate_state(studies):
        count.add(case.study(int(seed)), case.truth)
    covers = 1 - (count.above + count.below) / studies
    cells = (
        case.interval,
        case.of,
        f"{covers:.1%}",
        f"{count.above / studies:.1%}",
        f"{count.below / studies:.1%}",
        f"{np.median(count.widths):.2g}",
        f"{np.mean(count.values) / case.truth:.3f}" if case.truth else "",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Simulate and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=1000, help="of each case")
    parser.add_argument("--rare", type=int, default=100, help="estimates of each rare event")
    parser.add_argument("--only", default="", help="cases whose interval contains this")
    options = parser.parse_args()
    print("| interval | of | covers | too high | too low | half-width | mean / truth |")
    print("|---|---|---|---|---|---|---|", flush=True)
    begun = time.process_time()
    for case in cases():
        if options.only in case.interval:
            print(row(case, options.rare if case.rare else options.studies), flush=True)
    print(f"\n{time.process_time() - begun:.0f} s of processor time")


if __name__ == "__main__":
    main()
