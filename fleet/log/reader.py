"""Reading a log: its metadata and messages, also of a file whose end is missing."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from fleet.log.recorder import PROFILE, LogError

DAMAGE = (
    McapError,
    ZstdError,
    struct.error,
    EOFError,
    KeyError,
    ValueError,
    MemoryError,
    OverflowError,
)
"""What the MCAP library raises where a file is cut or its bytes are changed."""


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
    """What a log holds."""

    path: Path
    complete: bool = False
    messages: Counter[str] = field(default_factory=Counter)
    payload_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


def read(path: Path, summary: Summary | None = None) -> Iterator[Record]:
    """Every message up to the last readable one; what is learnt on the way goes into `summary`.

    Raises:
        LogError: there is no such file, or it is not a fleet log.

    """
    summary = summary if summary is not None else Summary(path)
    channels: dict[int, str] = {}
    try:
        stream = path.open("rb")
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    with stream:
        if stream.read(8) != b"\x89MCAP0\r\n":
            raise LogError(f"{path} is not an MCAP file")
        stream.seek(0)
        try:
            for item in StreamReader(stream, validate_crcs=True).records:
                if isinstance(item, Channel):
                    channels[item.id] = item.topic
                elif isinstance(item, Metadata):
                    summary.metadata[item.name] = dict(item.metadata)
                elif isinstance(item, Message):
                    yield _record(item, channels[item.channel_id], summary)
                elif isinstance(item, Schema) and not item.name.startswith("fleet."):
                    raise LogError(
                        f"{path} is not a fleet log: it has messages of type '{item.name}' "
                        f"(an MCAP file written by '{PROFILE}' is expected)"
                    )
            summary.complete = True
        except DAMAGE:
            summary.complete = False


def summarise(path: Path) -> Summary:
    """What a log holds, from reading all of it; raises LogError as `read` does."""
    summary = Summary(path)
    for _ in read(path, summary):
        pass
    if not summary.messages and "run" not in summary.metadata:
        raise LogError(f"{path} holds no fleet run")
    return summary


def _record(item: Message, topic: str, summary: Summary) -> Record:
    if not summary.messages:
        summary.first_ns = item.log_time
    summary.messages[topic] += 1
    summary.payload_bytes += len(item.data)
    summary.last_ns = max(summary.last_ns, item.log_time)
    return Record(topic, item.data, item.sequence, item.publish_time, item.log_time)
