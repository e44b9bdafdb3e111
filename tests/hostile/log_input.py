"""Logs as a fuzzer keeps them: what is in them, so that they can be written with right checksums.

Or plain bytes of a file, whose checksums are set right after they have been changed.
"""

from __future__ import annotations

import json
import random
import zlib
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from fleet.log.container import MAGIC, RECORD, sealed
from fleet.log.reader import Record, Summary, read
from fleet.log.schema import schemas
from fleet.protocol.codec import kind_of
from tests.hostile.mutation import (
    INTEGERS,
    TEXTS,
    changed_text,
    mutated_bytes,
    mutated_payload,
    mutated_tree,
    pick,
)

MOST_RECORDS = 600
_CHUNK_HEAD = 8 + 8 + 8  # times of the first and last message, and the uncompressed size


class LoggedMessage(msgspec.Struct, array_like=True):
    """A message of a log."""

    topic: str
    payload: bytes
    seq: int
    sent_ns: int
    log_ns: int


class LogInput(msgspec.Struct, array_like=True):
    """A log: its metadata records by name, and its messages in order."""

    metadata: list[tuple[str, dict[str, str]]]
    messages: list[LoggedMessage]


def log_input(path: Path) -> bytes:
    """What a log holds, as an input."""
    summary = Summary(path)
    messages = [
        LoggedMessage(r.topic, r.payload, r.seq, r.sent_ns, r.log_ns) for r in read(path, summary)
    ]
    return msgspec.msgpack.encode(LogInput([*summary.metadata.items()], messages))


def log_bytes(data: bytes) -> bytes:
    """The file of an input; raises ValueError if it is none, or cannot be written."""
    try:
        given = msgspec.msgpack.decode(data, type=LogInput)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    file = BytesIO()
    writer = Writer(file, 1 << 16, CompressionType.ZSTD)
    writer.start("fleet", "fleet")
    for name, values in given.metadata[:1]:
        writer.add_metadata(name, sealed(name, values))
    kinds = {
        kind: writer.register_schema(f"fleet.{kind}", "jsonschema", schema)
        for kind, schema in schemas().items()
    }
    channels: dict[str, int] = {}
    for m in given.messages[:MOST_RECORDS]:
        if m.topic not in channels:
            schema = kinds.get(kind_of(m.topic), 0)
            channels[m.topic] = writer.register_channel(m.topic, "msgpack", schema)
        times = max(0, m.log_ns), max(0, m.sent_ns)
        writer.add_message(channels[m.topic], times[0], m.payload, times[1], m.seq & 0xFFFFFFFF)
    writer.flush()
    for name, values in given.metadata[1:]:
        writer.add_metadata(name, sealed(name, values))
    writer.finish()
    return file.getvalue()


def mutated_log(rng: random.Random, data: bytes) -> bytes:
    """Another log: other payloads, times, topics, or metadata."""
    given = msgspec.msgpack.decode(data, type=LogInput)
    for _ in range(1 + int(rng.random() * 3)):
        if rng.random() < 0.2 and given.metadata:
            _change_metadata(rng, given)
        elif given.messages:
            _change_messages(rng, given)
    return msgspec.msgpack.encode(given)


def _change_messages(rng: random.Random, given: LogInput) -> None:
    place = int(rng.random() * len(given.messages))
    turn, m = rng.random(), given.messages[place]
    if turn < 0.6:
        m.payload = mutated_payload(rng, m.payload)
    elif turn < 0.7:
        field = pick(rng, ("seq", "sent_ns", "log_ns"))
        setattr(m, field, min(max(0, pick(rng, INTEGERS)), 2**63 - 1))
    elif turn < 0.8:
        other = pick(rng, given.messages).topic
        m.topic = other if rng.random() < 0.5 else changed_text(rng, m.topic)
        m.topic = m.topic.encode("utf-8", "replace").decode()
    elif turn < 0.9:
        given.messages.insert(int(rng.random() * len(given.messages)), m)
    else:
        del given.messages[place : place + 1 + int(rng.random() ** 3 * 100)]


def _change_metadata(rng: random.Random, given: LogInput) -> None:
    place = int(rng.random() * len(given.metadata))
    name, values = given.metadata[place]
    turn = rng.random()
    if turn < 0.05:
        del given.metadata[place]
    elif turn < 0.1:
        given.metadata.append((pick(rng, ("run", "result", "x")), dict(values)))
    elif values:
        key = pick(rng, list(values))
        values[key] = _other_value(rng, values[key])
        given.metadata[place] = name, values


def _other_value(rng: random.Random, text: str) -> str:
    """Another text; of JSON most often another tree."""
    if rng.random() < 0.8:
        with suppress(ValueError, TypeError, RecursionError):
            tree: Any = json.loads(text)
            return json.dumps(mutated_tree(rng, tree))
    changed = pick(rng, TEXTS) if rng.random() < 0.5 else changed_text(rng, text)
    return changed.encode("utf-8", "replace").decode()


def mutated_file(rng: random.Random, data: bytes) -> bytes:
    """The bytes of a file with some changed, and its checksums set right."""
    places = [at for at, opcode, _ in _records(data) if opcode != Opcode.CHUNK] or [0]
    if rng.random() < 0.5:
        begin = pick(rng, places)
        part = mutated_bytes(rng, data[begin : begin + 200])
        return refitted(data[:begin] + part + data[begin + 200 :])
    return refitted(mutated_bytes(rng, data))


def refitted(data: bytes) -> bytes:
    """A file in which each chunk that is not compressed has its right checksum, and the summary."""
    out = bytearray(data)
    footer, summary = -1, 0
    for at, opcode, length in _records(data):
        body = at + RECORD.size
        if opcode == Opcode.CHUNK and length > _CHUNK_HEAD + 16:
            told = int.from_bytes(data[body + 28 : body + 32], "little")
            begin = body + 32 + told + 8
            chunk = data[begin : body + length]
            if told == 0:
                out[body + 16 : body + 24] = len(chunk).to_bytes(8, "little")
                out[body + 24 : body + 28] = zlib.crc32(chunk).to_bytes(4, "little")
        elif opcode == Opcode.FOOTER and length == 20:
            footer, summary = body, int.from_bytes(data[body : body + 8], "little")
    if footer >= 0 and 0 < summary < footer:
        crc = zlib.crc32(out[summary : footer + 16])
        out[footer + 16 : footer + 20] = crc.to_bytes(4, "little")
    return bytes(out)


def _records(data: bytes) -> list[tuple[int, int, int]]:
    """Where each record of a file begins, its opcode and the length of its body."""
    at, found = len(MAGIC), []
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        found.append((at, opcode, length))
        if length > len(data):
            break
        at += RECORD.size + length
    return found


def plain_copy(records: list[Record], metadata: dict[str, dict[str, str]]) -> bytes:
    """A log whose chunks are not compressed."""
    file = BytesIO()
    writer = Writer(file, 1 << 12, CompressionType.NONE)
    writer.start("fleet", "fleet")
    writer.add_metadata("run", metadata["run"])
    kinds = {k: writer.register_schema(f"fleet.{k}", "jsonschema", b"{}") for k in schemas()}
    channels: dict[str, int] = {}
    for r in records:
        if r.topic not in channels:
            channel = writer.register_channel(r.topic, "msgpack", kinds[kind_of(r.topic)])
            channels[r.topic] = channel
        writer.add_message(channels[r.topic], r.log_ns, r.payload, r.sent_ns, r.seq)
    writer.flush()
    writer.add_metadata("result", metadata["result"])
    writer.finish()
    return file.getvalue()
