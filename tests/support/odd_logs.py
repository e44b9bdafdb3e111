"""Odd logs: what a reader may meet, each made of one good log by rewriting it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import Writer

from fleet.faults.kinds.loss import Loss
from fleet.log.reader import Record, Summary, read
from fleet.protocol.codec import decode, encode, kind_of
from fleet.protocol.messages import Clock
from fleet.protocol.topics import CLOCK, DIGEST
from tests.support.foreign_logs import Added, with_added
from tests.support.mutants import meeting
from tests.support.rewriting import Change, logged, rewritten

LATE_NS = 2**63 - 1
"""The last time that a message can have."""
ESC = "\x1b[31mred\x1b]0;title\x07\u202eesrever\u2066\x00<script>alert(1)</script>"
"""What must reach neither a terminal nor a page as it is."""

Odd = Callable[[Path, Path], Path]


def base_log(path: Path) -> Path:
    """A log with an election, commands, losses and decisions."""
    logged(path, meeting(Loss(probability=0.2), duration_s=1.5))
    return path


def metadata_of(log: Path) -> dict[str, dict[str, str]]:
    """Its metadata records."""
    summary = Summary(log)
    for _ in read(log, summary):
        pass
    return summary.metadata


def only(*kinds: str) -> Odd:
    """Only messages of these classes."""
    return changed(lambda _, record: record if kind_of(record.topic) in kinds else None)


def changed(change: Change) -> Odd:
    """Some messages changed or left out."""
    return lambda base, path: rewritten(base, path, change)


def fields(kind: str, **values: Any) -> Odd:
    """All messages of a class with other values."""

    def change(_: int, record: Record) -> Record:
        if kind_of(record.topic) != kind:
            return record
        message = msgspec.to_builtins(decode(record.topic, record.payload)) | values
        return dataclasses.replace(record, payload=msgspec.msgpack.encode(message))

    return changed(change)


def entries(kind: str, column: str, **values: Any) -> Odd:
    """All rows of a message's tuple with other values; a plain tuple with another value."""

    def change(_: int, record: Record) -> Record:
        if kind_of(record.topic) != kind:
            return record
        message = decode(record.topic, record.payload)
        rows = getattr(message, column)
        new = tuple(
            msgspec.structs.replace(row, **values)
            if isinstance(row, msgspec.Struct)
            else values["value"]
            for row in rows
        )
        payload = encode(msgspec.structs.replace(message, **{column: new}))
        return dataclasses.replace(record, payload=payload)

    return changed(change)


def renamed(old: str, new: str) -> Odd:
    """A topic with another name."""
    return changed(
        lambda _, r: dataclasses.replace(r, topic=new) if r.topic == old else r,
    )


def foreign(old: str, new: str) -> Odd:
    """A topic with a name that our recorder would not write."""

    def make(base: Path, path: Path) -> Path:
        with path.open("wb") as file:
            writer = Writer(file, 1 << 20)
            writer.start("fleet", "odd")
            schema = writer.register_schema("fleet.adsb", "jsonschema", b"{}")
            writer.add_metadata("run", metadata_of(base)["run"])
            channels: dict[str, int] = {}
            for r in read(base):
                topic = new if r.topic == old else r.topic
                if topic not in channels:
                    channels[topic] = writer.register_channel(topic, "msgpack", schema)
                writer.add_message(channels[topic], r.log_ns, r.payload, r.sent_ns, r.seq)
            writer.add_metadata("result", metadata_of(base)["result"])
            writer.finish()
        return path

    return make


def about(record: str, **values: str | None) -> Odd:
    """Other metadata; None takes a key away."""

    def make(base: Path, path: Path) -> Path:
        table = {**metadata_of(base)[record], **values}
        kept = {k: v for k, v in table.items() if v is not None}
        return rewritten(base, path, **{record: kept})  # type: ignore[arg-type]

    return make


def scenario(**values: Any) -> Odd:
    """Another scenario in the metadata."""

    def make(base: Path, path: Path) -> Path:
        run = metadata_of(base)["run"]
        table = {**json.loads(run["effective_scenario"]), **values}
        return rewritten(base, path, run={**run, "effective_scenario": json.dumps(table)})

    return make


def twice(base: Path, path: Path) -> Path:
    """A UAV of the scenario there twice."""
    table = json.loads(metadata_of(base)["run"]["effective_scenario"])
    return scenario(uav=[*table["uav"], table["uav"][0]])(base, path)


def nothing(base: Path, path: Path) -> Path:
    """Interrupted before the first message."""
    result = {"status": "interrupted", "why": "interrupted by the user", "digest": ""}
    return rewritten(base, path, lambda *_: None, result=result)


def cut(base: Path, path: Path) -> Path:
    """The first half of the file."""
    path.write_bytes(base.read_bytes()[: base.stat().st_size // 2])
    return path


def first_of(kind: str) -> Odd:
    """Of a class nothing but the first message."""
    seen: list[int] = []

    def make(base: Path, path: Path) -> Path:
        seen.clear()

        def change(n: int, record: Record) -> Record | None:
            if kind_of(record.topic) == kind:
                seen.append(n)
                return record if len(seen) == 1 else None
            return record

        return rewritten(base, path, change)

    return make


def clocks(**values: Any) -> Odd:
    """The simulation's grants with other values."""

    def change(_: int, record: Record) -> Record:
        if record.topic != CLOCK:
            return record
        clock = msgspec.msgpack.decode(record.payload, type=Clock)
        new = msgspec.structs.replace(clock, **values)
        return dataclasses.replace(record, payload=encode(new))

    return changed(change)


def times(**values: Any) -> Odd:
    """The last messages of the log recorded or sent at other times."""
    return changed(lambda n, r: dataclasses.replace(r, **values) if n > 100 else r)


DEEP = "[" * 100_000 + "]" * 100_000

ODD: dict[str, Odd] = {
    "nothing": nothing,
    "nothing, no end": lambda base, path: rewritten(base, path, lambda *_: None, result=None),
    "cut": cut,
    "no metadata": lambda base, path: rewritten(base, path, run=None, result=None),
    "no result": lambda base, path: rewritten(base, path, result=None),
    "no scenario": about("run", effective_scenario=None),
    "no UAV": scenario(uav=[]),
    "one UAV": scenario(
        uav=[
            {
                "id": 1,
                "position_ned_m": [0, 0, -300],
                "heading_deg": 0,
                "waypoints_ned_m": [[1000, 0, -300]],
            }
        ]
    ),
    "other UAVs": scenario(
        uav=[
            {
                "id": 77,
                "position_ned_m": [0, 0, -300],
                "heading_deg": 0,
                "waypoints_ned_m": [[1000, 0, -300]],
            }
        ]
    ),
    "a UAV twice": twice,
    "no UAV, no fault": scenario(uav=[], fault=[]),
    "flying backwards": fields("truth", speed_mps=-25.0),
    "no coordinator": scenario(coordination={"electors": "local"}),
    "unknown key": scenario(nonsense=1),
    "deep scenario": about("run", effective_scenario='{"x":' + DEEP + "}"),
    "scenario of another type": about("run", effective_scenario="5"),
    "no JSON": about("run", effective_scenario="{", overrides="{", versions="{"),
    "overrides a number": about("run", overrides="5"),
    "overrides a table": about("run", overrides='{"a": 1}'),
    "overrides numbers": about("run", overrides="[1, null]"),
    "overrides deep": about("run", overrides=DEEP),
    "versions a list": about("run", versions="[1]"),
    "versions nested": about("run", versions='{"numpy": {"a": 1}}'),
    "versions nothing": about("run", versions="null"),
    "unknown clock": about("run", clock="sundial", bus="tram"),
    "UAVs no JSON": about("run", uavs="[", seed="x", tick_ns="x"),
    "plan of another type": about("result", fault_plan="5"),
    "shortages of another type": about("result", lacked_room="5"),
    "plan null": about("result", fault_plan="null"),
    "plan deep": about("result", fault_plan='[{"x":' + DEEP + "}]"),
    "plan of nobody": about("result", fault_plan='[{"kind": "kill", "node": "999"}]'),
    "unknown status": about("result", status="perhaps", why="\n" * 5, sim_s="x"),
    "digest no hex": about("result", digest="zz"),
    "announced plan deep": clocks(plan='[{"x":' + DEEP + "}]"),
    "announced plan of nobody": clocks(plan='[{"kind": "kill", "node": "999"}]'),
    "announced plan null": clocks(plan="null"),
    "unknown state": clocks(state="lunch"),
    "absent strangers": clocks(held=(999,), down=(998, 0)),
    "no truth": changed(lambda _, r: None if kind_of(r.topic) == "truth" else r),
    "one truth": first_of("truth"),
    "truth alone": only("truth"),
    "one UAV's truth": changed(lambda _, r: None if r.topic == "2/truth" else r),
    "no clock": changed(lambda _, r: None if r.topic == CLOCK else r),
    "no digest": changed(lambda _, r: None if r.topic == DIGEST else r),
    "heard alone": only("adsb", "election", "cmd"),
    "deliveries alone": only("delivery"),
    "garbled": changed(lambda n, r: dataclasses.replace(r, payload=b"\x81") if n % 3 else r),
    "empty": changed(lambda _, r: dataclasses.replace(r, payload=b"")),
    "unknown mode": fields("truth", mode=ESC[:60]),
    "unknown manoeuvre": fields("adsb", manoeuvre=ESC[:60]),
    "unknown reason": fields("ack", reason=ESC[:60], accepted=False),
    "unknown command": fields("cmd", manoeuvre=ESC[:60]),
    "unknown sector": entries("decision", "encounters", sector=ESC[:60]),
    "unknown stage": entries("decision", "encounters", stage=ESC[:60]),
    "unknown decision": entries("decision", "encounters", manoeuvre=ESC[:60], target=999),
    "unknown fate": entries("delivery", "fates", value=ESC[:60]),
    "unknown kind": entries("delivery", "kinds", value=ESC[:60]),
    "unknown source": entries("delivery", "src", value=999),
    "conflict of strangers": entries("conflict", "pairs", value=(998, 999)),
    "conflict with oneself": entries("conflict", "pairs", value=(1, 1)),
    "elections of strangers": fields("election", members=(998, 999), computing=999, group=998),
    "elections of nobody": fields("election", members=(), computing=0, group=0),
    "member many times": fields("election", members=(1,) * 4096),
    "term 0": fields("election", term=0),
    "commands to strangers": fields("cmd", target=999),
    "answers to strangers": fields("ack", target=999),
    "truth at the end of time": fields("truth", t_ns=LATE_NS),
    "sent at the end of time": fields("adsb", t_ns=LATE_NS, applies_ns=LATE_NS),
    "valid for ever": fields("election", valid_until_ns=LATE_NS),
    "commands for ever": fields(
        "cmd", start_ns=LATE_NS, manoeuvre_end_ns=LATE_NS, expiry_ns=LATE_NS, issued_ns=LATE_NS
    ),
    "commands at the end of time": fields("cmd", t_ns=LATE_NS),
    "answers at the end of time": fields("ack", t_ns=LATE_NS, actuate_ns=LATE_NS),
    "decisions at the end of time": fields("decision", t_ns=LATE_NS),
    "conflicts at the end of time": fields("conflict", t_ns=LATE_NS),
    "delivered at the end of time": entries("delivery", "delivered_ns", value=LATE_NS),
    "sent and delivered at the end": entries("delivery", "sent_ns", value=LATE_NS),
    "reported at the end of time": fields("delivery", t_ns=LATE_NS),
    "clock at the end of time": clocks(t_ns=LATE_NS, tick=2**53),
    "recorded at the end of time": times(log_ns=2**64 - 1),
    "published at the end of time": times(sent_ns=2**64 - 1),
    "a stranger's broadcast": renamed("1/adsb/0", "999/adsb/0"),
    "no number": renamed("1/adsb/0", "x/adsb/0"),
    "a huge number": renamed("1/adsb/0", "9" * 40 + "/adsb/0"),
    "other digits": renamed("1/adsb/0", "\u0661/adsb/0"),
    "no issuer": renamed("1/adsb/0", "/adsb/0"),
    "no class": foreign("1/adsb/0", "1"),
    "topic of nothing": foreign("1/adsb/0", "1/"),
    "unknown class": foreign("1/adsb/0", "1/gossip"),
    "foreign topics": lambda base, path: with_added(
        base, path, [Added("1/gossip", b"\xc1"), Added(ESC, b"\x91" * 99), Added("x", b"", "y")]
    ),
    "foreign data on a topic of ours": lambda base, path: with_added(
        base, path, [Added("1/adsb/0", b"{}", "json")]
    ),
    "raw topic": renamed("1/adsb/0", ESC.replace("/", "") + "/adsb/0"),
    "commands to no number": renamed("2/ack/1", "2/ack/x"),
    "truth of a stranger": renamed("1/truth", "999/truth"),
    "truth of no number": renamed("1/truth", "x/truth"),
    "truth of the coordinator": renamed("1/truth", "coordinator/truth"),
    "raw words": about("result", status="invalid", why=ESC),
    "raw versions": about(
        "run", versions=json.dumps({ESC: ESC}), overrides=json.dumps([ESC]), python=ESC, run=ESC
    ),
    "raw description": scenario(description=ESC, resolver="none"),
    "raw resolver": scenario(resolver=ESC),
}
