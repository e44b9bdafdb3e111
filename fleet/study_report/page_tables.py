"""Tables of a study's page as HTML: cells, comparisons, worst runs, failures, what was flown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from html import escape

import msgspec
import tomli_w

from fleet.analysis.words import counted, separation_text
from fleet.study.study_file import Study
from fleet.study_report.comparisons import CellComparisons
from fleet.study_report.outcomes import outcomes_of, ratio_words
from fleet.study_report.study_data import StudyData
from fleet.study_report.worst_runs import repeat_commands, worst_runs

MOST_ROWS = 400
MOST_ERRORS = 20
SIGNIFICANT = 0.05


def cells_table(data: StudyData) -> str:
    """Every cell: runs, outcomes, what comes without avoidance, risk ratios."""
    if len(data.cells) == 1:
        return _one_cell(data)
    outcomes = outcomes_of(data)
    heads = ["Cell", "Runs", "Failed"]
    for outcome in outcomes:
        heads.append(f"{outcome.title[:1].upper()}{outcome.title[1:]}, {outcome.unit or '1'}")
        if outcome.id in ("lost", "nmac"):
            heads += ["without avoidance", "risk ratio"]
    if data.weighted:
        heads.insert(2, "Worth")
    rows = []
    for cell in data.cells[:MOST_ROWS]:
        summary = cell.summary
        row = [cell.name, str(summary.runs), str(summary.failed)]
        if data.weighted:
            row.insert(2, f"{summary.worth:.0f}")
        for outcome in outcomes:
            row.append(outcome.text(outcome.of(cell)))
            if outcome.id in ("lost", "nmac"):
                event = summary.events.get(outcome.id)
                ratio = ratio_words(event.risk_ratio if event else None)
                row += [outcome.text(outcome.without(cell)), ratio]
        rows.append([escape(text) for text in row])
    return table_html(heads, rows, numeric=range(1, len(heads))) + _rest(data.cells)


def _one_cell(data: StudyData) -> str:
    """The outcomes of the only cell, one below the other."""
    (cell,) = data.cells
    rows = []
    for outcome in outcomes_of(data):
        event = cell.summary.events.get(outcome.id)
        ratio = ratio_words(event.risk_ratio if event else None)
        texts = (outcome.title, outcome.text(outcome.of(cell)))
        rows.append([escape(t) for t in (*texts, outcome.text(outcome.without(cell)), ratio)])
    heads = ("Outcome", "With avoidance", "Without avoidance", "Risk ratio")
    worth = f", worth {cell.summary.worth:.0f}" if data.weighted else ""
    note = f"<p class='note'>{counted(cell.summary.runs, 'run')}{worth}.</p>"
    return table_html(heads, rows, numeric=(1, 2, 3)) + note


def comparisons_table(found: CellComparisons) -> str:
    """Each cell against one, on common encounters."""
    against = escape(found.against.name)
    heads = (
        *("Cell", "In both", "In this cell only", f"In cell {found.against.cell.number} only"),
        *("In neither", "p", "p, all comparisons (Holm)", f"Differs ({SIGNIFICANT:.0%})"),
    )
    rows = []
    for cell, test in found.tests[:MOST_ROWS]:
        c = test.counts
        more = c.second_only > c.first_only
        differs = ("more" if more else "fewer") if test.adjusted_p_value < SIGNIFICANT else "no"
        counts = (c.both, c.second_only, c.first_only, c.neither)
        p_values = (p_text(test.p_value), p_text(test.adjusted_p_value))
        rows.append([escape(cell.name), *map(str, counts), *p_values, differs])
    intro = (
        f"<p class='note'>Against cell {against}; {counted(found.encounters, 'encounter')} that "
        "all cells flew.</p>"
    )
    return intro + table_html(heads, rows, numeric=range(1, 7)) + _rest(found.tests)


def p_text(p_value: float) -> str:
    """A p-value with two digits; those below 0.0001 as such."""
    return "<0.0001" if p_value < 1e-4 else f"{p_value:.2g}"


def worst_table(data: StudyData) -> str:
    """The runs of least separation, and how to repeat each."""
    heads = (
        *("Least separation / required", "without avoidance", "Cell", "Run", "At (s)"),
        *("Horizontal (m)", "Vertical (m)", "", "Repeat it"),
    )
    rows = []
    for worst in worst_runs(data):
        what = "NMAC" if worst.nmac else "lost" if worst.lost else ""
        commands = "\n".join(repeat_commands(data, worst.cell.cell.number, worst.run))
        rows.append(
            [
                separation_text(worst.least_separation),
                separation_text(worst.least_without),
                escape(worst.cell.name),
                str(worst.run),
                f"{worst.least_s:.1f}",
                f"{worst.horizontal_m:.1f}",
                f"{worst.vertical_m:.1f}",
                what,
                f"<details><summary>commands</summary><pre>{escape(commands)}</pre></details>",
            ]
        )
    if not rows:
        return "<p class='card'>In no run did two UAVs meet.</p>"
    return table_html(heads, rows, numeric=(0, 1, 3, 4, 5, 6))


def failures_html(data: StudyData) -> str:
    """How many runs could not be flown, why, and where."""
    flown = sum(cell.summary.runs for cell in data.cells)
    if not data.failed:
        words = (
            f"Flown, and none failed: {counted(flown, 'run')}." if flown else "No run was flown."
        )
        return f"<p class='card'>{words}</p>"
    total = flown + len(data.failed)
    rows = []
    for error, count in Counter(run.error for run in data.failed).most_common(MOST_ERRORS):
        first = next(run for run in data.failed if run.error == error)
        cells = len({run.cell for run in data.failed if run.error == error})
        where = f"run {first.run} of cell {first.cell}"
        rows.append([str(count), str(cells), escape(where), escape(error)])
    words = (
        f"<p>{len(data.failed)} of {counted(total, 'run')} could not be flown. They are in no "
        "probability and no median.</p>"
    )
    return words + table_html(("Runs", "Cells", "The first", "Why"), rows, numeric=(0, 1))


def again_html(data: StudyData) -> str:
    """What share of runs was flown again over zenoh, and whether digests agreed."""
    if not data.again:
        return "<p>No run was flown again over zenoh (<code>zenoh_share</code> of the study).</p>"
    flown = sum(cell.summary.runs for cell in data.cells)
    differing = [again for again in data.again if not again.agrees]
    share = f"{len(data.again)} of {counted(flown, 'run')} ({len(data.again) / flown:.2%})"
    said = f"<p>{share} flown again with a process for each UAV over zenoh: "
    if not differing:
        return f"{said}all came to the same digest, message by message.</p>"
    rows = [
        [str(a.cell), str(a.run), f"<code>{a.in_memory}</code>", f"<code>{a.over_zenoh}</code>"]
        for a in differing
    ]
    heads = ("Cell", "Run", "Digest in memory", "over zenoh")
    return f"{said}{len(differing)} came to other digests.</p>{table_html(heads, rows)}"


def study_toml(study: Study) -> str:
    """The study as a file has it, without what is as by default."""
    return tomli_w.dumps(_given(study))


def versions_table(data: StudyData) -> str:
    """With what it was flown."""
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in data.versions.items()
    )
    return f"<div class='card scroll'><table>{rows}</table></div>"


def table_html(
    heads: Sequence[str], rows: Iterable[Sequence[str]], numeric: Iterable[int] = ()
) -> str:
    """A table of HTML cells; `numeric` are the columns of numbers."""
    right = {*numeric}
    kinds = [
        " class='n'" if n in right else " class='w'" if head == "Cell" else ""
        for n, head in enumerate(heads)
    ]
    head = "".join(f"<th{k}>{escape(h)}</th>" for k, h in zip(kinds, heads, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{k}>{c}</td>" for k, c in zip(kinds, row, strict=True)) + "</tr>"
        for row in rows
    )
    return (
        f"<div class='card scroll'><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table></div>"
    )


def _rest(rows: Sequence[object]) -> str:
    more = len(rows) - MOST_ROWS
    return f"<p class='note'>And {more} more: see runs.parquet.</p>" if more > 0 else ""


def _given(table: msgspec.Struct) -> dict[str, object]:
    """Keys of a table whose values are not the default's."""
    out: dict[str, object] = {}
    tag = table.__struct_config__.tag
    if tag is not None:
        out[str(table.__struct_config__.tag_field)] = tag
    for field in msgspec.structs.fields(table):
        value = getattr(table, field.name)
        default = field.default
        if field.default_factory is not msgspec.NODEFAULT:
            default = field.default_factory()
        if value is not None and value != default:
            out[field.encode_name] = _plain(value)
    return out


def _plain(value: object) -> object:
    if isinstance(value, msgspec.Struct):
        return _given(value)
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value
