"""The tables of docs/results.md, of studies that have been flown.

    python -m benchmarks.study_tables RESULTS...

For each folder of results a Markdown table: probabilities in percent with their 95 % intervals, by
cell, and whether cells differ from the first one on the same encounters (McNemar, after Holm).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fleet.cli.study_table import percent_text, ratio_text
from fleet.model.types import Truths
from fleet.study.results import ResultsFolder, open_results
from fleet.study.statistics.mcnemar import compare_conditions
from fleet.study.summary import CellSummary, by_cell, summaries


def rows(results: ResultsFolder) -> list[str]:
    """The table's lines."""
    factors = [factor.name for factor in results.study.factor]
    heads = [*factors, "runs", "lost", "lost without", "risk ratio", "induced", "NMAC"]
    heads += ["least separation 5 %, median", "delay median, 95 %", "p against the first"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    p_values = differences(results)
    for cell in summaries(results):
        levels = [level.label for level in cell.cell.levels]
        told = [*levels, str(cell.runs), *outcome(cell), p_values.get(cell.cell.number, "-")]
        lines.append(f"| {' | '.join(told)} |")
    return lines


def outcome(cell: CellSummary) -> list[str]:
    """What came of a cell."""
    lost, nmac = cell.events["lost"], cell.events["nmac"]
    least, delay = cell.quantiles["least_separation"], cell.quantiles["delay_max_s"]
    return [
        percent_text(lost.probability),
        f"{100.0 * lost.without.value:.1f}",
        ratio_text(lost.risk_ratio),
        f"{100.0 * lost.induced.value:.1f}",
        percent_text(nmac.probability),
        f"{least[0].value:.3f}, {least[1].value:.3f}" if least else "-",
        f"{delay[1].value:.1f} s, {delay[2].value:.1f} s" if delay else "-",
    ]


def differences(results: ResultsFolder) -> dict[int, str]:
    """Adjusted p-values of losses against the first cell, by cell, if all their runs were flown."""
    lost: dict[str, Truths] = {}
    for cell, columns in by_cell(results, results.table()):
        if (columns["error"] != "").any():
            return {}
        lost[str(cell.number)] = columns["lost"].astype(np.bool_)
    if len({len(values) for values in lost.values()}) > 1 or len(lost) < 2:
        return {}
    tests = compare_conditions(lost, against="0")
    return {int(test.second): f"{test.adjusted_p_value:.2g}" for test in tests}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+")
    for folder in parser.parse_args().folders:
        results = open_results(folder)
        print(f"\n{results.study.name}: {results.study.description}\n")
        print("\n".join(rows(results)))


if __name__ == "__main__":
    main()
