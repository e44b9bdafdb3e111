"""`fleet info`."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from fleet.analysis.words import (
    arrival_text,
    clock_text,
    outage_text,
    separation_text,
    shortage_text,
)
from fleet.cli.screen import Screen
from fleet.log.foreign import ForeignTopic
from fleet.log.reader import Summary, summarise
from fleet.log.run_metadata import overrides_of, uavs_told
from fleet.model.words import ClockMode
from fleet.printing import printable
from fleet.protocol.codec import kind_of
from fleet.protocol.topics import issuer_of

SHOWN_RUN = (
    "run",
    "scenario",
    "seed",
    "clock",
    "bus",
    "uavs",
    "fleet_version",
    "versions",
    "python",
)
FOREIGN_SHOWN = 30
"""So many foreign topics are told."""
SHOWN_RESULT = ("status", "why", "digest", "sim_s", "least_separation", "pairs_lost", "all_arrived")

ARRIVAL = ("arrived", "due", "not_arrived", "delay_mean_s", "delay_max_s")


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("info")(info)


def info(
    log: Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> int:
    """Say what a log holds: the run, how it ended, and its messages by class.

    Example: fleet info four_way.mcap
    """
    summary = summarise(log)
    if as_json:
        print(json.dumps(_as_dict(summary)))
        return 0
    facts = Table(show_header=False)
    facts.add_column()
    facts.add_column(overflow="fold")
    run, result = summary.metadata.get("run", {}), summary.metadata.get("result", {})
    if not run and summary.foreign and not summary.messages:
        facts.add_row("run", "none: another program has written this")
    else:
        _add_run(facts, run, result)
    facts.add_row("messages", f"{summary.messages.total()}, {summary.payload_bytes} bytes")
    facts.add_row("time", f"{summary.first_ns / 1e9:g} to {summary.last_ns / 1e9:g} s")
    facts.add_row(
        "file", "complete" if summary.complete else "damaged or cut short: see the warning"
    )
    tables = [_classes(summary)] if summary.messages or not summary.foreign else []
    if summary.foreign:
        tables.append(_foreign(summary.foreign))
    screen = Screen()
    screen.print(f"[italic]{escape(str(log))}[/]", soft_wrap=True, highlight=False)
    screen.print(facts, *tables, sep="\n")
    for warning in summary.warnings:
        print(f"fleet: warning: {log}: {warning}", file=sys.stderr)
    return 0


def _add_run(facts: Table, run: Mapping[str, str], result: Mapping[str, str]) -> None:
    for name in SHOWN_RUN:
        facts.add_row(name, escape(run.get(name, "?")))
    facts.add_row("set", escape(overrides_of(run)) or "nothing")
    uavs = uavs_told(run)
    for name in SHOWN_RESULT:
        facts.add_row(name, escape(_shown(result, name, uavs)) or "-")
    if result.get("lacked_room", "{}") != "{}":
        facts.add_row("dropped for lack of room", escape(printable(_shortages(result))))
    if run.get("clock") == ClockMode.REALTIME:
        facts.add_row("wall clocks", escape(printable(_clocks(result))))
        facts.add_row("degraded", escape(result.get("degraded", "-")))
        facts.add_row("not heard", escape(printable(_outages(result))) or "-")


def _shortages(result: Mapping[str, str]) -> str:
    """What the metadata tell of what was dropped."""
    with suppress(KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return shortage_text(json.loads(result["lacked_room"]))
    return "unknown: the log does not tell"


def _outages(result: Mapping[str, str]) -> str:
    """What the metadata tell of outages."""
    with suppress(KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return outage_text(json.loads(result["outages"]))
    return "unknown: the log does not tell"


def _clocks(result: Mapping[str, str]) -> str:
    """What the metadata tell of the wall clocks."""
    with suppress(KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return clock_text(json.loads(result["clocks"]))
    return "unknown: the log does not tell"


def _shown(result: Mapping[str, str], name: str, uavs: int) -> str:
    """A value of the metadata, for people."""
    text = result.get(name, "unknown: the log has no end")
    if name == "all_arrived" and name in result:
        with suppress(KeyError, ValueError, TypeError, RecursionError):
            told = {n: json.loads(result[n]) for n in ARRIVAL} | {name: text}
            return arrival_text(told, uavs)
    if name == "least_separation":
        with suppress(ValueError):
            return separation_text(float(text))
    return text


def _classes(summary: Summary) -> Table:
    table = Table(title="Messages by class", title_justify="left")
    for column in ("class", "messages", "issuers"):
        table.add_column(column, justify="left" if column == "class" else "right")
    count: Counter[str] = Counter()
    issuers: dict[str, set[str]] = {}
    for topic, n in summary.messages.items():
        count[kind_of(topic)] += n
        issuers.setdefault(kind_of(topic), set()).add(issuer_of(topic))
    for kind in sorted(count):
        table.add_row(kind, str(count[kind]), str(len(issuers[kind])))
    for one in summary.unknown:
        name = f"{escape(printable(one.kind))} (not known here)"
        table.add_row(name, str(one.messages), str(one.issuers))
    return table


def _foreign(topics: Sequence[ForeignTopic]) -> Table:
    table = Table(title="Foreign topics, of other programs", title_justify="left")
    for column in ("topic", "messages", "encoding", "schema"):
        table.add_column(
            column, justify="right" if column == "messages" else "left", overflow="fold"
        )
    for told in topics[:FOREIGN_SHOWN]:
        names = (escape(printable(name)) or "-" for name in (told.encoding, told.schema))
        table.add_row(escape(printable(told.topic)), str(told.messages), *names)
    if len(topics) > FOREIGN_SHOWN:
        table.caption = f"the first {FOREIGN_SHOWN} of {len(topics)}"
    return table


def _as_dict(summary: Summary) -> dict[str, object]:
    return {
        "log": str(summary.path),
        "complete": summary.complete,
        "warnings": summary.warnings,
        "metadata": summary.metadata,
        "messages": dict(sorted(summary.messages.items())),
        "unknown": [asdict(one) for one in summary.unknown],
        "foreign": [asdict(topic) for topic in summary.foreign],
        "payload_bytes": summary.payload_bytes,
        "first_ns": summary.first_ns,
        "last_ns": summary.last_ns,
    }
