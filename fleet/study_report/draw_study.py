"""The charts of a study's page: frames that the script fills in, and shares of factors."""

from __future__ import annotations

from fleet.report.plot import ALERT, INK, Chart, Json, PickableContent, axis, figure_layout
from fleet.study.statistics.estimate import Estimate
from fleet.study_report.chart_data import MOST_BARS
from fleet.study_report.colours import LINE_COLOURS
from fleet.study_report.factor_shares import TOGETHER, FactorShares, OutcomeShares
from fleet.study_report.study_data import StudyData

WHAT_IS_SHARED = {
    "sobol": "Sobol indices: shares of the variance of an outcome over the bounds of all factors. "
    "First order is what a factor does alone, total what it does alone and together with others.",
    "grid": "Shares of the variance between cells that are due to each factor alone (main "
    "effects), each level counting alike; what the runs of a cell differ by is taken out. They "
    "say what matters among the levels that were chosen, and may come out slightly below 0.",
}


def maps_chart() -> Chart:
    """Heat maps of each outcome over two factors."""
    return Chart(
        "maps",
        "By cell",
        "Each cell has the value and its 95 % interval; darker is worse. The scale is the same for "
        "all levels of the other factors.",
        [],
        figure_layout(300, legend_rows=0),
        300,
        "maps",
        controls=_pickers("maps"),
    )


def curves_chart(data: StudyData) -> Chart:
    """An outcome against a factor, a line for each level of another."""
    return Chart(
        "curves",
        "Against a factor",
        "With avoidance, with 95 % intervals (of probabilities: Clopper-Pearson); dotted: without "
        "avoidance, on the same encounters."
        + (_WEIGHTED if data.weighted else _STOPPED if data.study.stop else ""),
        [],
        figure_layout(420),
        420,
        "curves",
        controls=_pickers("curves"),
    )


def points_chart(data: StudyData) -> Chart:
    """An outcome of cells that were drawn, against each factor."""
    count = len(data.flown_cells)
    bars = "with its 95 % interval" if count <= MOST_BARS else "whose interval is told by hovering"
    return Chart(
        "points",
        "Against each factor",
        f"Each point is one of {count} combinations that were drawn, {bars}; all factors vary at "
        "once.",
        [],
        figure_layout(380, legend_rows=0),
        380,
        "points",
        controls=_pickers("points"),
    )


def survival_chart(data: StudyData) -> Chart:
    """The share of runs that keep at least so much separation."""
    band = (
        "point by point, of encounters as they occur"
        if data.weighted
        else "the whole curve is in the band with 95 % confidence (Kolmogorov's statistic)"
    )
    return Chart(
        "survival",
        "Share of runs that keep at least so much separation",
        f"Separation is normalised: below 1 it is lost. Band: {band}. Dotted: without avoidance.",
        [],
        figure_layout(440),
        440,
        "survival",
        controls=_pickers("survival"),
    )


_WEIGHTED = " Probabilities are of encounters as they occur (Korn-Graubard intervals)."


_STOPPED = " The probability by which cells got runs has intervals that hold at all looks."


def shares_charts(found: FactorShares) -> list[Chart]:
    """What each factor does to each outcome; no chart where nothing is known of that."""
    if not found.shares:
        return []
    choices = [PickableContent(shares.outcome, _share_traces(shares)) for shares in found.shares]
    bars = max(len(shares.first) for shares in found.shares)
    height = 110 + (52 if found.kind == "sobol" else 40) * bars
    title = "Sobol indices" if found.kind == "sobol" else "Main effects"
    layout = figure_layout(
        height,
        legend_rows=1 if found.kind == "sobol" else 0,
        xaxis=axis("Share of the variance", range=[-0.2, 1.2]),
        yaxis=axis(autorange="reversed", ticks=""),
        shapes=[_upright(0.0, INK, "solid"), _upright(1.0, ALERT, "dot")],
        barmode="group",
        bargap=0.35,
    )
    caption = WHAT_IS_SHARED[found.kind]
    return [Chart("shares", title, caption, [], layout, height, choices=choices, pick="of")]


def _share_traces(shares: OutcomeShares) -> list[Json]:
    if not shares.total:
        return [_bars("alone", shares.first, LINE_COLOURS[0])]
    return [
        _bars("first order: alone", shares.first, LINE_COLOURS[0]),
        _bars("total: with others too", shares.total, LINE_COLOURS[1]),
    ]


def _bars(name: str, shares: dict[str, Estimate], colour: str) -> Json:
    values = list(shares.values())
    return {
        "type": "bar",
        "orientation": "h",
        "name": name,
        "y": [*shares],
        "x": [e.value for e in values],
        "error_x": {
            "type": "data",
            "symmetric": False,
            "array": [max(0.0, e.high - e.value) for e in values],
            "arrayminus": [max(0.0, e.value - e.low) for e in values],
            "color": INK,
            "thickness": 1.3,
        },
        "marker": {"color": ["#9aa4af" if n == TOGETHER else colour for n in shares]},
        "hovertemplate": "%{customdata}<extra></extra>",
        "customdata": [share_words(n, e) for n, e in shares.items()],
        "showlegend": name != "alone",
    }


def share_words(name: str, share: Estimate) -> str:
    """As in `loss: 61 % (48 to 72)`."""
    value, low, high = (f"{100.0 * x:.0f}" for x in (share.value, share.low, share.high))
    return f"{name}: {value} % ({low} to {high})"


def _upright(x: float, colour: str, dash: str) -> Json:
    """A line at a share."""
    line = {"color": colour, "width": 1, "dash": dash}
    return {"type": "line", "yref": "y domain", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": line}


def _pickers(chart: str) -> str:
    """Where the script puts what can be chosen."""
    return f"<div class='pickers' id='{chart}-pickers'></div>"
