"""Logs to which another program has added topics of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mcap.writer import Writer

from fleet.log.reader import Summary, read
from fleet.log.schema import schemas
from fleet.protocol.codec import kind_of


class Added(NamedTuple):
    """A message of another program; without a name, its schema is none."""

    topic: str
    payload: bytes
    encoding: str = "msgpack"
    schema: str = ""
    t_s: float = 0.5


def with_added(base: Path | None, path: Path, added: Sequence[Added]) -> Path:
    """A copy of a log, or a log of nothing, with these messages among its own, by time."""
    summary = Summary(base or path)
    records = list(read(base, summary)) if base else []
    with path.open("wb") as file:
        writer = Writer(file, 1 << 16)
        writer.start("fleet" if base else "")
        for name in ("run",) if base else ():
            writer.add_metadata(name, summary.metadata[name])
        ours = {
            kind: writer.register_schema(f"fleet.{kind}", "jsonschema", schema)
            for kind, schema in (schemas() if base else {}).items()
        }
        theirs: dict[str, int] = {"": 0}
        channels: dict[tuple[str, ...], int] = {}
        rows: list[tuple[int, tuple[str, ...], bytes, int]] = [
            (r.log_ns, (r.topic, "msgpack"), r.payload, r.seq) for r in records
        ]
        rows += [(round(1e9 * m.t_s), (m.topic, m.encoding, m.schema), m.payload, 0) for m in added]
        for log_ns, key, payload, seq in sorted(rows, key=lambda row: row[0]):
            if key not in channels:
                if len(key) == 3 and key[2] not in theirs:
                    theirs[key[2]] = writer.register_schema(key[2], "", b"")
                schema = theirs[key[2]] if len(key) == 3 else ours[kind_of(key[0])]
                channels[key] = writer.register_channel(key[0], key[1], schema)
            writer.add_message(channels[key], log_ns, payload, log_ns, seq)
        if base and "result" in summary.metadata:
            writer.add_metadata("result", summary.metadata["result"])
        writer.finish()
    return path
