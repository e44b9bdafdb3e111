"""Reading a log message by message: up to the first damage, and no further."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from fleet.errors import LogError
from fleet.log.container import (
    DAMAGE,
    MAGIC,
    MESSAGE,
    DamagedError,
    open_file,
    parse,
    records_in,
)
from fleet.log.contents import has_summary, require_ours
from fleet.log.scan import ChunkData, Damage, parts_of
from fleet.log.store import Log

__all__ = ["DAMAGE", "Record", "Summary", "read", "summarise"]


@dataclass(frozen=True, slots=True)
class Record:
    """One logged message, not decoded."""

    topic: str
    payload: bytes
    seq: int
    sent_ns: int
    log_ns: int


@dataclass
class Summary:
    """What a log holds; `warnings` say what is wrong with it, and what is missing."""

    path: Path
    complete: bool = False
    messages: Counter[str] = field(default_factory=Counter)
    payload_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def read(path: Path, summary: Summary | None = None) -> Iterator[Record]:
    """Every message up to the first damage; what is learnt on the way goes into `summary`.

    Nothing after a gap is read, so that what is read is a run without gaps.

    Raises:
        LogError: there is no such file, or it is not a fleet log.

    """
    summary = summary if summary is not None else Summary(path)
    channels: dict[int, str] = {}
    try:
        file = open_file(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path} is not an MCAP file")
        size = file.seek(0, 2)
        summary.complete = False
        try:
            for part in parts_of(file, size):
                if isinstance(part, Damage):
                    return
                if isinstance(part, ChunkData):
                    yield from _records(part.data, channels, summary)
                else:
                    summary.metadata[part.name] = part.values
        except DamagedError:
            return
        summary.complete = has_summary(file, size)


def summarise(path: Path) -> Summary:
    """What a log holds, from reading all that can be read of it; raises LogError as `read` does."""
    log = Log(path, lambda _: None)
    totals = log.verify()
    if not totals.payload_bytes and "run" not in log.metadata:
        raise LogError(f"{path} holds no fleet run")
    return Summary(
        path,
        log.complete,
        +totals.messages,
        totals.payload_bytes,
        totals.first_ns,
        totals.last_ns,
        log.metadata,
        log.warnings,
    )


def _records(data: bytes, channels: dict[int, str], summary: Summary) -> Iterator[Record]:
    for opcode, number, begin, end in records_in(data):
        if opcode == Opcode.SCHEMA:
            require_ours(summary.path, [parse(Schema, data[begin:end]).name])
        elif opcode == Opcode.CHANNEL:
            channels[number] = parse(Channel, data[begin:end]).topic
        elif opcode == Opcode.MESSAGE:
            if number not in channels:
                raise DamagedError("the name of a topic is missing")
            _, seq, log_ns, sent_ns = MESSAGE.unpack_from(data, begin)
            payload = data[begin + MESSAGE.size : end]
            topic = channels[number]
            if not summary.messages:
                summary.first_ns = log_ns
            summary.messages[topic] += 1
            summary.payload_bytes += len(payload)
            summary.last_ns = max(summary.last_ns, log_ns)
            yield Record(topic, payload, seq, sent_ns, log_ns)
