"""The page of a study: its sections and tiles."""

from __future__ import annotations

from html import escape

from fleet.analysis.words import counted
from fleet.report.page_parts import Page, Section, asset, html_page, tiles_html
from fleet.study.summary import alike_words
from fleet.study_report.chart_data import chart_data_of
from fleet.study_report.comparisons import cell_comparisons
from fleet.study_report.draw_study import (
    curves_chart,
    maps_chart,
    points_chart,
    shares_charts,
    survival_chart,
)
from fleet.study_report.factor_shares import factor_shares
from fleet.study_report.outcomes import ReportedOutcome, outcomes_of
from fleet.study_report.page_tables import (
    again_html,
    cells_table,
    comparisons_table,
    failures_html,
    study_toml,
    versions_table,
    worst_table,
)
from fleet.study_report.study_data import StudyData
from fleet.version import __version__

NOTHING_FLOWN = "<p class='card'>No run of this study was flown.</p>"


def study_page(data: StudyData, against: int = 0) -> str:
    """The page of a study; cells are compared with cell `against`.

    Raises:
        StudyError: there is no such cell, or nothing of it was flown.
        MissingExtraError: Plotly, SciPy or statsmodels is not installed.

    """
    page = Page(
        f"{data.study.name}: fleet study",
        _header(data),
        _sections(data, against),
        {"study": chart_data_of(data) if data.flown_cells else None},
        asset("fleet.study_report", "study.js"),
        f"Drawn from {escape(data.said)} by fleet {escape(__version__)}. Intervals and bands: "
        "95 %.",
    )
    return html_page(page)


def _header(data: StudyData) -> str:
    study = data.study
    runs = f"{'at most ' if study.stop else ''}{counted(study.runs, 'run')} each"
    parts = [counted(len(data.cells), "cell"), runs, f"seed {study.seed}"]
    return (
        f"<header><h1>{escape(study.name)}</h1><div class='sub'>{escape(study.description)} "
        f"{', '.join(parts)}, from {escape(data.said)}.</div>{tiles_html(tiles_of_study(data))}"
        "</header>\n"
    )


def tiles_of_study(data: StudyData) -> list[tuple[str, str, str]]:
    """The figures at the top of the page: value, what it is, and good, bad or nothing."""
    flown = sum(cell.summary.runs for cell in data.cells)
    tiles = [(f"{flown:,}", f"runs flown, in {counted(len(data.flown_cells), 'cell')}", "")]
    tiles += [_range_tile(outcome, data) for outcome in outcomes_of(data)[:2]]
    failed = len(data.failed)
    tiles.append((str(failed), "runs that could not be flown", "bad" if failed else "good"))
    if data.again:
        agreed = sum(again.agrees for again in data.again)
        what = "runs flown again over zenoh came to the same digest"
        tone = "good" if agreed == len(data.again) else "bad"
        tiles.append((f"{agreed} of {len(data.again)}", what, tone))
    return tiles


def _range_tile(outcome: ReportedOutcome, data: StudyData) -> tuple[str, str, str]:
    found = [e for e in map(outcome.of, data.flown_cells) if e is not None]
    low, high = (pick(found, key=lambda e: e.value) for pick in (min, max))
    value = outcome.value_text(high)
    if outcome.value_text(low) != value:
        value = f"{outcome.number(low.value)} to {value}"
    what = f"{outcome.title}, in the worst cell {outcome.interval_text(high)}"
    return value, f"{what}; without avoidance {_without(outcome, data)}", ""


def _without(outcome: ReportedOutcome, data: StudyData) -> str:
    found = [e.value for e in map(outcome.without, data.flown_cells) if e is not None]
    texts = [outcome.number(value) for value in (min(found), max(found))]
    return f"{' to '.join(dict.fromkeys(texts))} {outcome.unit}"


def _sections(data: StudyData, against: int) -> list[Section]:
    if not data.flown_cells:
        nothing = Section("outcomes", "Outcomes", "What came of it.", html=NOTHING_FLOWN)
        return [nothing, _failures(data), _study(data)]
    return [
        _outcomes(data),
        Section(
            "separation",
            "Least separation",
            "How near two UAVs came in how many runs.",
            [survival_chart(data)],
        ),
        _factors(data),
        _comparisons(data, against),
        Section(
            "worst",
            "Worst runs",
            "Where UAVs came nearest, and how to look at it: as processes over zenoh, with log "
            "and report.",
            html=worst_table(data),
        ),
        _failures(data),
        _study(data),
    ]


def _outcomes(data: StudyData) -> Section:
    charts = []
    if data.factors and data.grid:
        charts = [maps_chart(), curves_chart(data)]
    elif data.factors:
        charts = [points_chart(data)]
    weights = (
        " Encounters have weights: probabilities are of encounters as they occur, and medians, "
        "which would not be, are left out."
    )
    few = not charts or len(data.cells) == 1
    title = "<summary>All cells as a table</summary>"
    table = cells_table(data)
    return Section(
        "outcomes",
        "Outcomes",
        "Probabilities of a run, and medians over runs, with 95 % intervals."
        + (weights if data.weighted else "")
        + f" {alike_words([cell.summary for cell in data.cells])}".rstrip(),
        charts,
        "two" if len(charts) == 2 else "",
        table if few else f"<details>{title}{table}</details>",
    )


def _factors(data: StudyData) -> Section:
    found = factor_shares(data)
    return Section(
        "factors",
        "Factors",
        "What the outcomes depend on.",
        shares_charts(found),
        html=f"<p class='card'>{escape(found.why)}</p>" if found.why else "",
    )


def _comparisons(data: StudyData, against: int) -> Section:
    lost = cell_comparisons(data, "lost", against)
    nmac = cell_comparisons(data, "nmac", against)
    intro = (
        "McNemar's exact test on encounters that were flown in all cells, each with the same "
        "draws. A p-value after Holm's correction is of all comparisons of a table at once."
    )
    if lost is None or nmac is None:
        why = "Needs a grid with two cells whose runs were flown."
        return Section("comparisons", "Comparisons", intro, html=f"<p class='card'>{why}</p>")
    notes = ""
    if data.study.stop:
        notes += " Cells got runs until they were known well: p-values take no account of that."
    if data.weighted:
        notes += " Encounters count as they were drawn, not as they occur."
    tables = (
        f"<h3>Loss of separation</h3>{comparisons_table(lost)}"
        f"<details><summary>NMAC</summary>{comparisons_table(nmac)}</details>"
    )
    return Section("comparisons", "Comparisons", intro + notes, html=tables)


def _failures(data: StudyData) -> Section:
    empty = [cell.name for cell in data.cells if not cell.summary.runs]
    said = ""
    if empty and data.flown_cells:
        names = "; ".join(escape(name) for name in empty[:10])
        more = f" and {len(empty) - 10} more" if len(empty) > 10 else ""
        said = f"<p class='note'>Cells without a run that was flown: {names}{more}.</p>"
    return Section(
        "failures",
        "Failures and checks",
        "Runs that could not be flown, and runs that were flown again.",
        html=f"{failures_html(data)}{said}{again_html(data)}",
    )


def _study(data: StudyData) -> Section:
    toml = escape(study_toml(data.study))
    name = escape(data.study.name)
    html = (
        f"<div class='card'><p><code>fleet study run {name}.toml</code> flies the same runs "
        f"again.</p><pre>{toml}</pre></div><h3 style='margin:14px 0 6px'>Begun with</h3>"
        f"{versions_table(data)}"
    )
    return Section("study", "Study", "What was flown, and with what.", html=html)
