"""`fleet cat`."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

import fleet.log
from fleet.faults.quantities import moment_s
from fleet.log.batches import CLASS_BY_KIND
from fleet.log.fields import Field, fields_of
from fleet.log.topics import chosen, expressions
from fleet.printing import printable
from fleet.protocol.codec import kind_of
from fleet.protocol.messages import Logged

CatRow = tuple[str, Logged, int]
"""Topic, message, time of recording in ns."""


class CatFormat(StrEnum):
    """How messages are written."""

    text = "text"
    ndjson = "ndjson"
    csv = "csv"


def register(app: typer.Typer) -> None:
    """Add the command of this module."""
    app.command("cat")(cat)


def cat(
    log: Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")],
    topics: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEYEXPR",
            help="Only these topics, as '*/truth,3/**'. Several times too.",
        ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude-topics", metavar="KEYEXPR", help="Not these topics."),
    ] = None,
    start: Annotated[
        str,
        typer.Option(
            metavar="TIME",
            help="From this simulated time on, as 12.5s; +10s: after the log's start; "
            "-30s: before its end.",
        ),
    ] = "",
    end: Annotated[
        str, typer.Option(metavar="TIME", help="Up to this time, not included; as for --start.")
    ] = "",
    form: Annotated[
        CatFormat,
        typer.Option(
            "--format",
            help="text: a line a message. ndjson: a JSON object a line. "
            "csv: a table, of one class of messages.",
        ),
    ] = CatFormat.text,
) -> int:
    r"""Write out the messages of a log, in its order.

    \b
    Examples:
      fleet cat run.mcap --topics 'coordinator/**' --start +10s --end -30s
      fleet cat run.mcap --topics '*/truth' --format csv > truth.csv
    """
    opened = fleet.log.open(log, _warn)
    try:
        wanted = chosen([*opened.topics], expressions(topics), expressions(exclude))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if not wanted:
        raise typer.BadParameter(f"no topic is left; 'fleet info {log}' says what there is")
    start_s, end_s = _time(start, opened), _time(end, opened)
    if start_s is not None and end_s is not None and end_s <= start_s:
        raise typer.BadParameter(f"--end is not after --start: {end_s:g} s, {start_s:g} s")
    messages = opened.messages(wanted, start_s, end_s)
    if form is CatFormat.csv:
        _write_csv(messages, wanted)
    else:
        write = {CatFormat.text: _text, CatFormat.ndjson: _json}[form]
        for row in messages:
            sys.stdout.write(write(*row))
    return 0


def _warn(warning: str) -> None:
    sys.stderr.write(f"fleet: warning: {warning}\n")


def _time(text: str, log: fleet.log.Log) -> float | None:
    """Simulated seconds; None if nothing is given."""
    if not text:
        return None
    try:
        if text[0] == "+":
            return log.start_ns / 1e9 + moment_s(text[1:])
        if text[0] == "-":
            return log.end_ns / 1e9 - moment_s(text[1:])
        return moment_s(text)
    except ValueError as error:
        raise typer.BadParameter(f"{error}; or +10s, or -30s") from error


def _text(topic: str, message: Logged, log_ns: int) -> str:
    values = " ".join(f"{k}={_encode(v)}" for k, v in msgspec.to_builtins(message).items())
    return f"{log_ns / 1e9:.6f} {printable(topic)} {values}\n"


def _json(topic: str, message: Logged, log_ns: int) -> str:
    row = {"topic": topic, "log_ns": log_ns, **msgspec.to_builtins(message)}
    return f"{_encode(row)}\n"


def _encode(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _write_csv(messages: Iterable[CatRow], topics: list[str]) -> None:
    kinds = sorted({kind_of(topic) for topic in topics})
    if len(kinds) > 1:
        raise typer.BadParameter(
            f"csv is for messages of one class, and these are {', '.join(kinds)}: "
            f"choose, as --topics '*/{kinds[0]}/**'"
        )
    columns = fields_of(CLASS_BY_KIND[kinds[0]])
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["topic", "log_ns", *(name for c in columns for name in _names(c))])
    for topic, message, log_ns in messages:
        cells = (cell for c in columns for cell in _cells(c, getattr(message, c.name)))
        table.writerow([topic, log_ns, *cells])


def _names(column: Field) -> list[str]:
    return [f"{column.name}_{k}" for k in range(column.width)] or [column.name]


def _cells(column: Field, value: Any) -> Iterator[Any]:
    """Numbers and text as they are, of what varies in length the JSON text."""
    if column.width:
        yield from value
    elif column.fixed:
        yield str(value).lower() if column.dtype is bool else value
    else:
        yield _encode(value)
