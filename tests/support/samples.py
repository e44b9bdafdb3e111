"""Sample messages: one of each class by hand, and Hypothesis strategies for all of them."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterator
from typing import Any

import msgspec
from hypothesis import strategies as st

from fleet.config.scenario import Scenario, Uav
from fleet.protocol.advisories import LoggedAdvisory, LoggedCandidate
from fleet.protocol.classes import MESSAGES
from fleet.protocol.messages import (
    Ack,
    Clock,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Digest,
    Done,
    Election,
    Heartbeat,
    Late,
    Message,
    PersistentState,
    StateBroadcast,
    Truth,
)

MS = 1_000_000
S = 1_000_000_000

_msgpack: Any = importlib.import_module("msgpack")  # it has no type information


def unpack(payload: bytes) -> Any:
    """Decode with the independent msgpack package."""
    return _msgpack.unpackb(payload)


def pack(value: Any) -> bytes:
    """Encode with the independent msgpack package."""
    packed: bytes = _msgpack.packb(value)
    return packed


def adsb(
    uav: int,
    position_ned_m: tuple[float, float, float] = (0.0, 0.0, -300.0),
    heading_rad: float = 0.0,
    t_ns: int = 0,
    **changes: Any,
) -> StateBroadcast:
    """The broadcast of a UAV in level flight at 25 m/s towards a waypoint straight ahead."""
    north, east, down = position_ned_m
    ahead, beyond = (
        (north + far * math.cos(heading_rad), east + far * math.sin(heading_rad), down)
        for far in (9000.0, 10_000.0)
    )
    message = StateBroadcast(
        id=uav,
        seq=t_ns // (200 * MS),
        t_ns=t_ns,
        applies_ns=t_ns,
        position_ned_m=position_ned_m,
        velocity_ned_mps=(25.0 * math.cos(heading_rad), 25.0 * math.sin(heading_rad), 0.0),
        speed_mps=25.0,
        heading_rad=heading_rad,
        flight_path_rad=0.0,
        waypoint_ned_m=ahead,
        next_waypoint_ned_m=beyond,
        arrived=False,
        guidance_heading_rad=heading_rad,
        guidance_climb_mps=0.0,
        reach_s=356.0,
        next_heading_rad=heading_rad,
        next_turn_rad=0.0,
        next_climb_mps=0.0,
        manoeuvre="",
        commanded_heading_rad=heading_rad,
        commanded_climb_mps=0.0,
        commanded_level_down_m=down,
        command_term=0,
        command_issuer=0,
        command_number=0,
        highest_term=0,
        mandate_term=0,
        mandate_valid=False,
        hears=True,
        equipment="full",
    )
    return msgspec.structs.replace(message, **changes)


def command(**changes: Any) -> Command:
    """A turn to the east for UAV 2, the first command of UAV 1 in term 3, issued at 1 s."""
    message = Command(
        id=1,
        seq=0,
        t_ns=S,
        target=2,
        term=3,
        number=1,
        issued_ns=S,
        manoeuvre="turn",
        heading_rad=math.pi / 2,
        turn_rad=math.pi / 2,
        climb_mps=0.0,
        level_down_m=0.0,
        start_ns=S + 200 * MS,
        manoeuvre_end_ns=20 * S,
        expiry_ns=3 * S,
    )
    return msgspec.structs.replace(message, **changes)


def ack(of: Command, reason: str = "", **changes: Any) -> Ack:
    """The target's answer to a command: accepted if there is no reason not to."""
    message = Ack(
        id=of.target,
        seq=0,
        t_ns=of.t_ns + 100 * MS,
        target=of.id,
        term=of.term,
        number=of.number,
        issued_ns=of.issued_ns,
        accepted=not reason,
        reason=reason,
        actuate_ns=0 if reason else of.start_ns,
    )
    return msgspec.structs.replace(message, **changes)


def election(
    term: int,
    members: tuple[int, ...],
    computing: int,
    valid_until_ns: int,
    t_ns: int = 0,
    elector: int = 0,
) -> Election:
    """An election, by the coordinator unless it is said by whom."""
    return Election(elector, term, t_ns, term, members[0], members, computing, valid_until_ns)


def heartbeat(t_ns: int, seq: int | None = None, highest_term: int = 0) -> Heartbeat:
    """A heartbeat of the coordinator, sent every 400 ms."""
    return Heartbeat(0, t_ns // (400 * MS) if seq is None else seq, t_ns, highest_term)


CANDIDATES = (
    LoggedCandidate("turn", 0.5, 0.25, -350.0, 20.5, True, True, 21.5, 1.5, 0.25),
    LoggedCandidate("climb", 0.0, 2.5),
)
"""One with all its fields, and one with few."""


def encounter(target: int = 2, stage: str = "axis", least: float = 1.5) -> LoggedAdvisory:
    """A line of a decision."""
    return LoggedAdvisory(
        target, "head_on", 0.5, 21.5, stage, "turn", 0.5, 0.25, least, 9.5, 12.5,
        -350.0, unresolved=least < 1.0, candidates=CANDIDATES,
    )  # fmt: skip


def truth(uav: int, position_ned_m: tuple[float, float, float], t_ns: int) -> Truth:
    """The true state of a UAV in level flight to the north."""
    velocity = (25.0, 0.0, 0.0)
    return Truth(
        uav, 5, t_ns, position_ned_m, velocity, 25.0, 0.25, 0.125, "plan", 1, 0.5, 0.0, 0.5, 0.0,
        -300.0, 0, 0, 0,
    )  # fmt: skip


SAMPLES: tuple[Message, ...] = (
    adsb(7, (100.5, -200.25, -300.0), 0.5, 400 * MS, manoeuvre="turn", command_number=2),
    heartbeat(800 * MS, highest_term=12),
    election(3, (1, 2, 5), 1, 2 * S),
    command(),
    ack(command(), "duplicate"),
    truth(2, (1.5, 2.5, -300.0), 3 * S),
    PersistentState(3, 2, S, 12, 8, 8, 3),
    Decision(1, 0, S, 3, (encounter(2), encounter(5, "least_bad"))),
    Conflict(0, 4, S, ((1, 2), (2, 5)), (20.5, 31.25), (1, 2, 5)),
    DeliveryReport(
        2,
        9,
        S,
        (0, 1),
        ("election", "cmd"),
        (4, 5),
        (900 * MS, 900 * MS),
        (S, S),
        2 * ("received",),
        (50_000, 60_000),
        (0, 30 * MS),
        (0, 1000),
    ),
    Late(3, 1, S, 25 * MS),
    Done(4, 10, S, 10, {"adsb/0": 1, "truth": 1}, {"adsb/0": "0f" * 8, "truth": "1e" * 8}),
)
"""One message of each class, in the order of MESSAGES."""

EXPECTED = {"adsb/0": ((1, 5), (2, 4)), "cmd/2": ((1, 7),)}
CLOCK = Clock(10, S, "run", EXPECTED, held=(0,), down=(2, 5))
DIGEST = Digest(10, S, "00ff" * 8)


def replaced(value: Any, path: tuple[str | int, ...], leaf: Any) -> Any:
    """A copy of nested maps and arrays with one leaf exchanged."""
    if not path:
        return leaf
    copy: Any = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = replaced(value[path[0]], path[1:], leaf)
    return copy


def float_paths(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Where the floats are in nested maps and arrays."""
    if isinstance(value, float):
        yield path
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from float_paths(item, (*path, name))
    elif isinstance(value, list):
        for place, item in enumerate(value):
            yield from float_paths(item, (*path, place))


def head_on(**changes: Any) -> Scenario:
    """UAV 1 flies north and UAV 2 south towards it, 1500 m apart; 3 stands by far away."""
    uavs = (
        Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),)),
        Uav(2, (1500.0, 0.0, -300.0), 180.0, ((-9000.0, 0.0, -300.0),)),
        Uav(3, (0.0, 90_000.0, -300.0), 0.0, ((9000.0, 90_000.0, -300.0),)),
    )
    return Scenario("test", 60.0, uav=uavs, **changes)


def messages_of(cls: type[Message]) -> st.SearchStrategy[Message]:
    """Any valid message of a class, from its annotations."""
    strategy: st.SearchStrategy[Message] = _values(msgspec.inspect.type_info(cls))
    return strategy


def any_message() -> st.SearchStrategy[Message]:
    """Any valid message of any class."""
    return st.one_of([messages_of(cls) for cls in MESSAGES])


def _values(info: Any) -> st.SearchStrategy[Any]:
    match info:
        case msgspec.inspect.StructType():
            fields = {f.name: _values(f.type) for f in info.fields} | _bound_together(info.cls)
            return st.builds(info.cls, **fields)
        case msgspec.inspect.FloatType():
            low, above = info.ge, info.gt
            return st.floats(
                low if above is None else above,
                info.le,
                exclude_min=above is not None,
                allow_nan=False,
                allow_infinity=False,
            )
        case msgspec.inspect.IntType():
            top = info.lt - 1 if info.lt is not None else info.le
            return st.integers(
                -(2**63) if info.ge is None else info.ge, 2**63 - 1 if top is None else top
            )
        case msgspec.inspect.UnionType():  # a number, or none
            return st.none() | _values(info.types[0])
        case msgspec.inspect.BoolType():
            return st.booleans()
        case msgspec.inspect.StrType():
            return st.text(max_size=info.max_length)
        case msgspec.inspect.TupleType():
            return st.tuples(*[_values(item) for item in info.item_types])
        case msgspec.inspect.VarTupleType():
            return st.lists(_values(info.item_type), max_size=4).map(tuple)
        case msgspec.inspect.DictType():
            return st.dictionaries(_values(info.key_type), _values(info.value_type), max_size=4)
    raise TypeError(f"no strategy for {info}")


def _bound_together(cls: type) -> dict[str, st.SearchStrategy[Any]]:
    """Fields whose values a class checks beyond their types: columns get one fixed length."""
    types = {f.name: f.type for f in msgspec.inspect.type_info(cls).fields}  # type: ignore[attr-defined]

    def column(name: str) -> st.SearchStrategy[Any]:
        return st.tuples(*[_values(types[name].item_type)] * 2)

    if cls is StateBroadcast:
        return {"id": st.integers(1, 2**53 - 1)}
    if cls is Election:
        members = st.sets(_values(types["members"].item_type), max_size=4)
        return {"members": members.map(lambda some: tuple(sorted(some)))}
    if cls is Conflict:
        return {name: column(name) for name in ("pairs", "time_to_violation_s")}
    if cls is DeliveryReport:
        columns = ("src", "kinds", "seqs", "sent_ns", "delivered_ns", "fates")
        measured = ("transit_ns", "delay_ns", "slip_ns")
        return {name: column(name) for name in (*columns, *measured)}
    return {}
