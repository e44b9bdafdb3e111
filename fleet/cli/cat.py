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
from fleet.cli.reading import unknown_words
from fleet.faults.quantities import moment_s
from fleet.log.batches import CLASS_BY_KIND
from fleet.log.fields import Field, fields_of
from fleet.log.foreign import ForeignDecoder, ForeignMessage
from fleet.log.topics import chosen, expressions
from fleet.printing import printable
from fleet.protocol.codec import kind_of
from fleet.protocol.messages import Logged

SHOWN_BYTES = 32
"""So many bytes are shown of a message that cannot be decoded."""


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
    foreign = {told.topic for told in opened.foreign}
    try:
        wanted = chosen([*opened.topics, *foreign], expressions(topics), expressions(exclude))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if not wanted:
        unknown = f"; there are {unknown_words(opened.unknown)}" if opened.unknown else ""
        raise typer.BadParameter(
            f"no topic is left; 'fleet info {log}' says what there is{unknown}"
        )
    start_s, end_s = _time(start, opened), _time(end, opened)
    if start_s is not None and end_s is not None and end_s <= start_s:
        raise typer.BadParameter(f"--end is not after --start: {end_s:g} s, {start_s:g} s")
    if form is CatFormat.csv:
        _write_csv(opened.messages(_ours(wanted, foreign), start_s, end_s), wanted)
        return 0
    write = {CatFormat.text: _text, CatFormat.ndjson: _json}[form]
    decoder = ForeignDecoder()
    for row in opened.all_messages(wanted, start_s, end_s):
        sys.stdout.write(write(*row, decoder))
    if decoder.failed:
        _warn(f"{log}: {printable(decoder.problem())}; shown as bytes")
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


def _text(
    topic: str, message: Logged | ForeignMessage, log_ns: int, decoder: ForeignDecoder
) -> str:
    if not isinstance(message, ForeignMessage):
        words = _named(msgspec.to_builtins(message))
    else:
        try:
            value = decoder.value(topic, message, log_ns)
            words = _named(value) if isinstance(value, dict) else _encode(value)
        except ValueError:
            words = _bytes(message)
    return f"{log_ns / 1e9:.6f} {printable(topic)} {words}\n"


def _named(values: dict[str, Any]) -> str:
    return " ".join(f"{printable(name)}={_encode(value)}" for name, value in values.items())


def _bytes(message: ForeignMessage) -> str:
    shown, size = message.payload[:SHOWN_BYTES].hex(), len(message.payload)
    more = "..." if size > SHOWN_BYTES else ""
    return f"{printable(message.encoding) or 'unknown'}, {size} bytes: {shown}{more}"


def _json(
    topic: str, message: Logged | ForeignMessage, log_ns: int, decoder: ForeignDecoder
) -> str:
    row: dict[str, Any] = {"topic": topic, "log_ns": log_ns}
    if not isinstance(message, ForeignMessage):
        return f"{_encode(row | msgspec.to_builtins(message))}\n"
    row["encoding"] = message.encoding
    try:
        row["value"] = decoder.value(topic, message, log_ns)
    except ValueError:
        row["hex"] = message.payload.hex()
    return f"{_encode(row)}\n"


def _encode(value: Any) -> str:
    return msgspec.json.encode(value).decode()


def _ours(topics: list[str], foreign: set[str]) -> list[str]:
    """The same, if none is foreign; raises BadParameter."""
    others = sorted(foreign.intersection(topics))
    if others:
        raise typer.BadParameter(
            f"csv is for messages of one class of ours, and '{others[0]}' is of another program; "
            "'fleet export --csv' writes a table of it"
        )
    return topics


def _write_csv(messages: Iterable[tuple[str, Logged, int]], topics: list[str]) -> None:
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
