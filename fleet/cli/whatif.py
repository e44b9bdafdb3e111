"""A what-if beside the run that it departs from, as tables for people."""

from __future__ import annotations

from typing import Any

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from fleet.analysis.separation import PairMinimum
from fleet.analysis.what_if import WhatIfSide
from fleet.analysis.words import arrival_text, counted, separation_text
from fleet.cli.result import commands_words, fault_lines, others_text

WHAT_IF_PAIRS_SHOWN = 10
DIGITS_SHOWN = 16
"""Of a digest: two whole ones do not fit beside each other."""


def what_if_tables(log: WhatIfSide, what_if: WhatIfSide) -> list[RenderableType]:
    """Both sides as a table of the nearest pairs and a table of facts; what differs stands out."""
    return [_pairs(log, what_if), _facts(log, what_if)]


def _pairs(log: WhatIfSide, what_if: WhatIfSide) -> Table:
    table = Table(title="Least separation of each pair, normalised", title_justify="left")
    for column in ("pair", "log", "what if"):
        table.add_column(column, justify="left" if column == "pair" else "right")
    sides = [{(m.a, m.b): m for m in side.minima} for side in (log, what_if)]
    nearest = sorted(
        sides[0].keys() | sides[1].keys(),
        key=lambda pair: min(s[pair].least_separation for s in sides if pair in s),
    )
    for pair in nearest[:WHAT_IF_PAIRS_SHOWN]:
        table.add_row(f"{pair[0]}-{pair[1]}", *(_minimum(side.get(pair)) for side in sides))
    if len(nearest) > WHAT_IF_PAIRS_SHOWN:
        table.caption = f"the {WHAT_IF_PAIRS_SHOWN} nearest of {len(nearest)} pairs"
    return table


def _minimum(minimum: PairMinimum | None) -> str:
    if minimum is None:
        return "-"
    style = "bold red" if minimum.lost else "green"
    return f"[{style}]{separation_text(minimum.least_separation)}[/] at {minimum.t_s:.1f} s"


def _facts(log: WhatIfSide, what_if: WhatIfSide) -> Table:
    table = Table(title="Results", title_justify="left")
    for column in ("", "log", "what if"):
        table.add_column(column, overflow="fold")
    rows = [_rows(side.result) for side in (log, what_if)]
    for row, side in zip(rows, (log, what_if), strict=True):
        row["faults"] = "\n".join(fault_lines(side.plan)) or "none"
    for name in {**rows[0], **rows[1]}:
        a, b = (escape(row.get(name, "-")) for row in rows)
        table.add_row(name, a, b if a == b else f"[bold]{b}[/]")
    return table


def _rows(side: dict[str, Any]) -> dict[str, str]:
    """The facts of one side, in words."""
    commands = side["commands"]
    latency = commands["latency_s"]
    rows = {
        "run": f"{side['status']}, {side['clock']}, {side['sim_s']:g} s, seed {side['seed']}",
        "digest": f"{side['digest'][:DIGITS_SHOWN]}..." if side["digest"] else "-",
        "lost separation": f"{side['pairs_lost']} of {counted(side['pairs'], 'pair')}",
        "all arrived": arrival_text(side, side["uavs"]),
        "of the UAVs": others_text(side["arrivals"]) or "-",
        "elections": str(side["elections"]),
        "commands": commands_words(commands),
        "issue to actuation": f"p50 {latency['p50']:.3g} s, p99 {latency['p99']:.3g} s"
        if latency
        else "-",
        "unresolved encounters": str(side["unresolved"]),
    }
    for kind, row in side["delivery"].items():
        dropped = "".join(f", {n} dropped by {fault}" for fault, n in row["dropped"].items())
        lost = f", {row['unreported']} not taken" if row["unreported"] else ""
        rows[f"delivery of {kind}"] = (
            f"{row['delivered']} of {row['sent']} delivered{dropped}{lost}"
        )
    return rows
