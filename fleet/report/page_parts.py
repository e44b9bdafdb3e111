"""What pages share: one HTML file with everything in it, Plotly's script once, nothing to fetch."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files

from fleet.extras import import_extra
from fleet.report.plot import Chart, Json, cased


@dataclass
class Section:
    """A part of the page: heading, a sentence on it, charts side by side, and further HTML."""

    id: str
    title: str
    intro: str
    charts: list[Chart] = field(default_factory=list)
    columns: str = ""
    html: str = ""


def plotly_script() -> str:
    """Plotly's JavaScript.

    Raises:
        MissingExtraError: it is not installed.

    """
    script: str = import_extra("plotly.offline", "report", "the page").get_plotlyjs()
    return script


@dataclass(frozen=True)
class Page:
    """A whole page; texts of it and of its sections and charts are HTML, but for titles.

    `data` is for `script`, which finds it in the element `report-data`, with all charts.
    """

    title: str
    header: str
    sections: Sequence[Section]
    data: Json
    script: str
    footer: str
    beneath: str = ""


def html_page(page: Page) -> str:
    """The text of a page; raises MissingExtraError if Plotly is not installed."""
    plotly = plotly_script()
    data = {**page.data, "charts": [_chart_data(c) for s in page.sections for c in s.charts]}
    return "".join(
        [
            "<!DOCTYPE html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n",
            "<meta name='viewport' content='width=device-width, initial-scale=1'>\n",
            f"<title>{escape(page.title)}</title>\n",
            f"<style>\n{asset('fleet.report', 'page.css')}</style>\n",
            f"<script>{plotly}</script>\n</head>\n<body>\n",
            page.header,
            _navigation(page.sections),
            "<main>\n",
            *(_section(s) for s in page.sections),
            f"</main>\n<footer>{page.footer}</footer>\n",
            page.beneath,
            f"<script type='application/json' id='report-data'>{_embedded(data)}</script>\n",
            f"<script>\n{page.script}</script>\n</body>\n</html>\n",
        ]
    )


def asset(package: str, name: str) -> str:
    """The text of a file that comes with a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def tiles_html(tiles: Iterable[tuple[str, str, str]]) -> str:
    """The figures at the top of a page: value, what it is, and `good`, `bad` or nothing."""
    shown = "".join(
        f"<div class='tile {tone}'><b>{escape(value)}</b><span>{escape(what)}</span></div>"
        for value, what, tone in tiles
    )
    return f"<div class='tiles'>{shown}</div>"


def options_html(values: Sequence[str], labels: Sequence[str], chosen: int = 0) -> str:
    """What a picker offers."""
    return "".join(
        f"<option value='{escape(value)}'{' selected' if n == chosen else ''}>"
        f"{escape(label)}</option>"
        for n, (value, label) in enumerate(zip(values, labels, strict=True))
    )


def _chart_data(chart: Chart) -> Json:
    """What the script needs of a chart."""
    choices = [
        {"traces": cased(c.traces), "layout": c.layout, "note": c.note} for c in chart.choices
    ]
    traces = [] if choices else cased(chart.traces)
    return {
        "id": chart.id,
        "live": chart.live,
        "traces": traces,
        "layout": chart.layout,
        "choices": choices,
    }


def _embedded(data: Json) -> str:
    """JSON that cannot end the script element that it is in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c")


def _navigation(sections: Sequence[Section]) -> str:
    links = "".join(f"<a href='#{s.id}'>{escape(s.title)}</a>" for s in sections)
    return f"<nav aria-label='Sections'><div>{links}</div></nav>\n"


def _section(section: Section) -> str:
    charts = "".join(_figure(c) for c in section.charts)
    grid = f"<div class='grid {section.columns}'>{charts}</div>" if charts else ""
    return (
        f"<section id='{section.id}'><h2>{escape(section.title)}</h2>"
        f"<p class='sub'>{escape(section.intro)}</p>{grid}{section.html}</section>\n"
    )


def _figure(chart: Chart) -> str:
    picker = ""
    if chart.choices:
        labels = [choice.label for choice in chart.choices]
        options = options_html([str(n) for n in range(len(labels))], labels)
        picker = f"<label>{chart.pick} <select id='{chart.id}-pick'>{options}</select></label>"
    return (
        f"<figure><div class='head'><h3>{escape(chart.title)}</h3>{picker}{chart.controls}</div>"
        f"<p class='caption'>{chart.caption}</p><p class='note' id='{chart.id}-note'></p>"
        f"<div class='plot' id='plot-{chart.id}' style='min-height:{chart.height}px'></div>"
        "</figure>"
    )
