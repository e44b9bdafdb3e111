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
from fleet.log.contents import has_summary
from fleet.log.foreign import ForeignTopic, foreign_topics, is_foreign
from fleet.log.scan import ChunkData, Damage, parts_of
from fleet.log.store import Log
from fleet.log.unknown import UnknownClass, is_unknown, unknown_classes

__all__ = ["DAMAGE", "Record", "Summary", "read", "summarise"]


@dataclass(frozen=True, slots=True)
class Record:
    """One logged message, not decoded; `foreign` if another program has added it."""

    topic: str
    payload: bytes
    seq: int
    sent_ns: int
    log_ns: int
    foreign: bool = False


@dataclass
class Summary:
    """What a log holds; `warnings` say what is wrong with it, and what is missing.

    `messages`, bytes and times are those of the run; those of other programs are in `foreign`, and
    those of classes that are not known here in `unknown`.
    """

    path: Path
    complete: bool = False
    messages: Counter[str] = field(default_factory=Counter)
    payload_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    foreign: tuple[ForeignTopic, ...] = ()
    unknown: tuple[UnknownClass, ...] = ()


def read(path: Path, summary: Summary | None = None, *, foreign: bool = False) -> Iterator[Record]:
    """Every message up to the first damage; what is learnt on the way goes into `summary`.

    Nothing after a gap is read, so that what is read is a run without gaps. Messages of other
    programs are passed over, unless they are asked for (`foreign`).

    Raises:
        LogError: there is no such file, it is no MCAP, or has others' data on topics of ours.

    """
    summary = summary if summary is not None else Summary(path)
    try:
        file = open_file(path)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path} is not an MCAP file")
        size = file.seek(0, 2)
        summary.complete = False
        reading = _Reading(summary, with_foreign=foreign)
        try:
            for part in parts_of(file, size):
                if isinstance(part, Damage):
                    return
                if isinstance(part, ChunkData):
                    yield from reading.records(part.data)
                else:
                    summary.metadata[part.name] = part.values
        except DamagedError:
            return
        finally:
            summary.foreign = reading.foreign_topics()
            summary.unknown = unknown_classes(reading.unknown)
        summary.complete = has_summary(file, size)


def summarise(path: Path) -> Summary:
    """What a log holds, from reading all that can be read of it; raises LogError as `read` does."""
    log = Log(path, lambda _: None)
    totals = log.verify()
    if not totals.payload_bytes and not log.foreign and "run" not in log.metadata:
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
        log.foreign,
        log.unknown,
    )


class _Reading:
    """Takes one chunk after the other."""

    def __init__(self, summary: Summary, *, with_foreign: bool) -> None:
        self._summary = summary
        self._with_foreign = with_foreign
        self._schemas: dict[int, Schema] = {}
        self._topics: dict[int, str] = {}
        self._foreign: dict[int, Channel] = {}
        self._foreign_counts: Counter[int] = Counter()
        self._unknown: set[int] = set()
        self.unknown: Counter[str] = Counter()

    def records(self, data: bytes) -> Iterator[Record]:
        """The messages of a chunk; raises DamagedError."""
        for opcode, number, begin, end in records_in(data):
            if opcode == Opcode.SCHEMA:
                self._schemas[number] = parse(Schema, data[begin:end])
            elif opcode == Opcode.CHANNEL:
                self._add(parse(Channel, data[begin:end]))
            elif opcode == Opcode.MESSAGE:
                if number not in self._topics:
                    raise DamagedError("the name of a topic is missing")
                _, seq, log_ns, sent_ns = MESSAGE.unpack_from(data, begin)
                payload, topic = data[begin + MESSAGE.size : end], self._topics[number]
                foreign = number in self._foreign
                if foreign:
                    self._foreign_counts[number] += 1
                elif number in self._unknown:
                    self.unknown[topic] += 1
                else:
                    self._count(topic, payload, log_ns)
                if self._with_foreign or not foreign:
                    yield Record(topic, payload, seq, sent_ns, log_ns, foreign)

    def foreign_topics(self) -> tuple[ForeignTopic, ...]:
        """What there was of other programs."""
        return foreign_topics(self._foreign.values(), self._schemas, self._foreign_counts)

    def _add(self, channel: Channel) -> None:
        self._topics[channel.id] = channel.topic
        if is_foreign(self._summary.path, channel, self._schemas):
            self._foreign[channel.id] = channel
        elif is_unknown(channel.topic):
            self._unknown.add(channel.id)

    def _count(self, topic: str, payload: bytes, log_ns: int) -> None:
        summary = self._summary
        if not summary.messages:
            summary.first_ns = log_ns
        summary.messages[topic] += 1
        summary.payload_bytes += len(payload)
        summary.last_ns = max(summary.last_ns, log_ns)
