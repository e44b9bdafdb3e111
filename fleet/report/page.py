"""The page of a run: its sections, tiles and tables."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from fleet.analysis.arrival import Arrival, Arrivals
from fleet.analysis.palette import colour_of
from fleet.analysis.words import missing_text, share_text
from fleet.model.units import to_s
from fleet.protocol.messages import Command
from fleet.report.curves import DrawnPair, pair_curves, pairs_lost
from fleet.report.draw_airspace import moving, plan_chart, scene_chart
from fleet.report.draw_events import messages_chart, messages_data, timeline_chart
from fleet.report.draw_links import latency_chart, matrix_chart, share_chart
from fleet.report.draw_resolution import resolution_chart
from fleet.report.draw_time import commands_chart, pair_chart, pairs_chart
from fleet.report.events import EventTimeline, timeline_of, told_in_order
from fleet.report.links import ClassRow, class_rows
from fleet.report.page_parts import Page, Section, asset, html_page, tiles_html
from fleet.report.resolution import resolutions
from fleet.report.risk import risks
from fleet.report.run_data import RunData
from fleet.report.scenario_text import effective_toml, facts, repeat_command

PAIRS_ON_PAGE = 300
MOST_DECISIONS = 60
MOST_EVENTS = 600
MOST_UAVS = 100


def page_of(run_data: RunData, source: str) -> str:
    """The whole page; `source` names the log.

    Raises:
        MissingExtraError: Plotly is not installed.

    """
    pairs = pair_curves(run_data, PAIRS_ON_PAGE)
    messages = messages_data(run_data)
    sections = _sections(run_data, pairs, source, messages["left_out"])
    data = {
        "first_s": first_time_s(run_data, pairs),
        "moving": moving(run_data),
        "messages": messages,
    }
    page = Page(
        f"{run_data.scenario.name}: fleet report",
        _header(run_data, pairs, source),
        sections,
        data,
        asset("fleet.report", "page.js"),
        f"Drawn from {escape(source)} by fleet {escape(run_data.about.fleet_version)}.",
        _clock(run_data),
    )
    return html_page(page)


def first_time_s(run_data: RunData, pairs: Sequence[DrawnPair]) -> float:
    """Where the time slider begins: at the first command, else where two are nearest."""
    commands = run_data.of(Command)
    if commands:
        return to_s(commands[0].t_ns)
    return pairs[0].minimum.t_s if pairs else 0.0


def _sections(
    run_data: RunData, pairs: list[DrawnPair], source: str, left_out: Sequence[str]
) -> list[Section]:
    at_risk = risks(run_data)
    timeline = timeline_of(run_data, at_risk)
    decided = resolutions(run_data, MOST_DECISIONS)
    count = len(run_data.flights)
    separation = [
        pair_chart(run_data, pairs, at_risk),
        pairs_chart(run_data, pairs, count * (count - 1) // 2),
    ]
    nobody = "<p class='card'>Nobody was told to manoeuvre.</p>"
    return [
        Section(
            "airspace",
            "Airspace",
            "Where everybody flew. The slider at the bottom moves all views.",
            [scene_chart(run_data), plan_chart(run_data)],
            "two",
            _arrival_table(run_data.arrivals),
        ),
        Section(
            "separation",
            "Separation and risk",
            "How near they came, from the true states.",
            separation if pairs else [],
            "two",
            "" if pairs else "<p class='card'>There is only one UAV.</p>",
        ),
        Section(
            "commands", "Commands", "What was commanded, and flown.", [commands_chart(run_data)]
        ),
        Section(
            "resolution",
            "Resolution",
            "What could have been commanded, and why this was.",
            [resolution_chart(run_data, decided)] if decided else [],
            html="" if decided else nobody,
        ),
        Section(
            "timeline",
            "Timeline",
            "Conflicts, elections, commands, acknowledgements, refusals and faults.",
            [timeline_chart(run_data, timeline)],
            html=_events(timeline),
        ),
        Section(
            "messages",
            "Messages",
            "Who said what to whom about one moment.",
            [messages_chart(run_data)],
            html=_left_out(left_out),
        ),
        Section(
            "links",
            "Links",
            "What became of the messages on their way.",
            [matrix_chart(run_data), share_chart(run_data), latency_chart(run_data)],
            "three",
            _class_table(class_rows(run_data.tally)),
        ),
        Section(
            "scenario",
            "Scenario",
            "What was flown, and how to repeat it.",
            html=_repeat(run_data, source),
        ),
    ]


def _header(run_data: RunData, pairs: Sequence[DrawnPair], source: str) -> str:
    s = run_data.scenario
    damage = (
        f"<div class='damage' role='alert'>{escape(run_data.damage)}</div>"
        if run_data.damage
        else ""
    )
    key = "".join(
        f"<span><i style='background:{colour_of(f.index)}'></i>UAV {f.id}</span>"
        for f in run_data.flights
    )
    return (
        f"<header><h1>{escape(s.name)}</h1><div class='sub'>{escape(s.description)} "
        f"{len(run_data.flights)} UAVs, {run_data.end_s:g} s, seed {s.seed}, "
        f"from {escape(source)}.</div>"
        f"{damage}{tiles_html(tiles_of(run_data, pairs))}<div class='key'>{key}</div></header>\n"
    )


def tiles_of(run_data: RunData, pairs: Sequence[DrawnPair]) -> list[tuple[str, str, str]]:
    """The figures at the top of the page: value, what it is, and good, bad or nothing."""
    tally = run_data.tally
    lost = pairs_lost(run_data)
    rows = class_rows(tally)
    share = share_text(sum(r.came for r in rows), sum(r.known for r in rows))
    sure = share.partition("(")[2] or "-)"
    refused = sum(tally.refused.values())
    tiles = []
    if pairs:
        p = pairs[0]
        where = f"least separation / required ({p.label} at {p.minimum.t_s:.1f} s)"
        tiles.append((p.least_text, where, "bad" if lost else "good"))
        tiles.append((str(lost), "pairs that lost separation", "bad" if lost else "good"))
    told = run_data.arrivals.totals()
    tone = {"yes": "good", "no": "bad"}.get(told["all_arrived"], "")
    late = "" if told["delay_max_s"] is None else f", at most {told['delay_max_s']:.1f} s late"
    missing = missing_text(told, len(run_data.flights))
    arrived = f"UAVs arrived{f'; {missing}' if missing else ''}{late}"
    return [
        *tiles,
        (f"{told['arrived']} of {len(run_data.flights)}", arrived, tone),
        (str(len(tally.terms)), "elections (terms)", ""),
        (str(len(tally.issued)), f"commands, {len(tally.applied)} applied, {refused} refusals", ""),
        (str(tally.unresolved), "encounters unresolved", "bad" if tally.unresolved else ""),
        (share.partition(" (")[0], f"of messages whose fate is known came (95 %: {sure}", ""),
        (str(len(run_data.plan)), "rules in the fault plan", ""),
    ]


def _clock(run_data: RunData) -> str:
    step = run_data.scenario.tick_s
    speeds = "".join(
        f"<option value='{n}'{' selected' if n == 5 else ''}>{n}x</option>"
        for n in (1, 2, 5, 10, 20)
    )
    return (
        "<div class='clock'><div><button id='play' type='button'>Play</button>"
        f"<select id='speed' aria-label='Speed'>{speeds}</select>"
        f"<input id='time' type='range' min='0' max='{run_data.end_s:g}' step='{step:g}' "
        "aria-label='Simulated time in seconds'>"
        "<output id='time-shown' for='time'></output></div></div>\n"
    )


def _events(timeline: EventTimeline) -> str:
    moments = told_in_order(timeline)
    rows = "".join(
        f"<tr data-t='{m.time_s:.3f}' class='{m.kind}'><td class='n'>{m.time_s:.1f}</td>"
        f"<td>{escape(m.text)}</td></tr>"
        for m in moments[:MOST_EVENTS]
    )
    more = f", the first {MOST_EVENTS}" if len(moments) > MOST_EVENTS else ""
    return (
        f"<details><summary>All {len(moments)} events as a list{more}; click one to go to its time"
        "</summary><div class='scroll card'><table class='events'><thead><tr><th class='n'>Time (s)"
        f"</th><th>Event</th></tr></thead><tbody>{rows}</tbody></table></div></details>"
    )


def _left_out(left_out: Sequence[str]) -> str:
    if not left_out:
        return ""
    return f"<p class='note'>Too many to draw, and left out: {escape(', '.join(left_out))}.</p>"


def _arrival_table(arrivals: Arrivals) -> str:
    heads = ("UAV", "Aircraft", "Arrived (s)", "Undisturbed (s)", "Delay (s)", "Back on plan (s)")
    head = "".join(f"<th>{h}</th>" for h in heads)
    rows = "".join(
        f"<tr><td>{row.id}</td><td>{row.aircraft}</td><td>{_seconds(row.arrival_s)}</td>"
        f"<td>{_seconds(row.planned_arrival_s)}</td><td>{_seconds(row.delay_s)}</td>"
        f"<td>{_back(row)}</td></tr>"
        for row in arrivals.rows[:MOST_UAVS]
    )
    more = len(arrivals.rows) - MOST_UAVS
    note = f"<p class='note'>And {more} more UAVs.</p>" if more > 0 else ""
    return (
        "<div class='card scroll' style='margin-top:14px'><table><thead><tr>"
        f"{head}</tr></thead><tbody>{rows}</tbody></table></div>{note}"
    )


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _back(row: Arrival) -> str:
    if not row.back_on_plan:
        return "still off"
    return "never left" if row.back_on_plan_s is None else f"{row.back_on_plan_s:.1f}"


def _class_table(rows: Sequence[ClassRow]) -> str:
    heads = ("Messages", "Times receivers", "Fate known", "Delivered", "Share of known (95 %)")
    head = "<th>Class</th>" + "".join(f"<th class='n'>{h}</th>" for h in heads)
    head += "<th>Kept away by</th><th class='n'>Latency p50, p99, max (ms)</th>"
    body = "".join(f"<tr>{_class_cells(r)}</tr>" for r in rows)
    return (
        "<div class='card scroll' style='margin-top:14px'><table><thead><tr>"
        f"{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _class_cells(row: ClassRow) -> str:
    counts = (row.messages, row.sent, row.known, row.came)
    numbers = (*(f"{n:,}" for n in counts), share_text(row.came, row.known))
    why = ", ".join(f"{fate} {n:,}" for fate, n in row.dropped.items()) or "-"
    spread = ", ".join(
        f"{1e3 * row.latency_s[k]:.3g}" for k in ("p50", "p99", "max") if row.latency_s
    )
    cells = "".join(f"<td class='n'>{n}</td>" for n in numbers)
    return f"<td>{row.kind}</td>{cells}<td>{escape(why)}</td><td class='n'>{spread}</td>"


def _repeat(run_data: RunData, source: str) -> str:
    rows = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in facts(run_data))
    toml, name = effective_toml(run_data), f"{run_data.scenario.name}.toml"
    digest = run_data.about.digest or ""
    same = f" It gives the same digest, <code>{escape(digest)}</code>." if digest else ""
    own = run_data.about.scenario_toml
    as_read = (
        f"<details><summary>The scenario as it was read</summary><pre>{escape(own)}</pre></details>"
    )
    return (
        f"<div class='card scroll'><table>{rows}</table></div><div class='card' "
        f"style='margin-top:14px'><h3>Repeat it</h3><p>Save the text below as <code>{escape(name)}"
        f"</code> (it holds all settings, and the fault plan) and type</p>"
        f"<pre>{escape(repeat_command(run_data))}</pre><p>{same} <code>fleet repeat "
        f"{escape(source)}</code> flies the log's run again and compares.</p>"
        f"<details><summary>{escape(name)}</summary><pre>{escape(toml)}</pre></details>"
        f"{as_read if own else ''}</div>"
    )
