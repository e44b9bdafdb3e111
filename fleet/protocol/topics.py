"""The key space: `fleet/{run}/{topic}`, topic = `{issuer}/{class}[/{cell or target}]`.

The log uses the topic alone. The issuer is part of every key, so that access rules can bind it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from fleet.model.types import COORDINATOR
from fleet.protocol.classes import (
    ADDRESSED,
    BROADCAST,
    CELLED,
    DELIVERY_ORDER,
    MESSAGE_BY_KIND,
    hears_class,
)
from fleet.protocol.messages import Message

SIMULATION = "sim"
"""How the simulation is named in keys."""
CLOCK = "sim/clock"
DIGEST = "sim/digest"
REJECTED = "sim/rejected"
ROUND_TIME = "sim/round_time"
OUTAGE = "sim/outage"
SIMULATION_TOPICS = frozenset({CLOCK, DIGEST, REJECTED, ROUND_TIME, OUTAGE})
"""What the simulation itself adds to a log; no digest covers it."""
PLAN = "sim/plan"
ABORT = "sim/abort"
FAULT = "sim/fault"
VIEW = "sim/view"
PACE = "sim/pace"
EVERYTHING = "**"
ANY = "*"


def issuer_name(number: int) -> str:
    """How a process is named in keys: its UAV number, or `coordinator`."""
    return "coordinator" if number == COORDINATOR else str(number)


def issuer_number(name: str) -> int:
    """The number of a participant that is named so."""
    return int(name) if name.isdecimal() else COORDINATOR


def topic_of(message: Message, cell: str = "") -> str:
    """The topic of a message; with a cell, in which its issuer is, that of a run with cells."""
    suffix = f"{message.kind}/{cell}" if cell and in_cells(message) else message.suffix
    return f"{issuer_name(message.id)}/{suffix}"


def in_cells(message: Message) -> bool:
    """Whether a message goes to a cell in runs that have any: what UAVs tell all others."""
    return message.id != COORDINATOR and message.kind in CELLED


def cell_in(topic: str) -> str:
    """What follows the class in a topic: a cell, or a target; empty if nothing does."""
    return suffix_of(topic).partition("/")[2]


def issuer_of(topic: str) -> str:
    """The issuer's name in a topic."""
    return topic.partition("/")[0]


def suffix_of(topic: str) -> str:
    """The topic without its issuer."""
    return topic.partition("/")[2]


def key(run: str, topic: str) -> str:
    """The zenoh key of a topic in a run."""
    return f"fleet/{run}/{topic}"


def topic_in(run: str, full_key: str) -> str:
    """The topic of a zenoh key of a run."""
    return full_key[len(run) + 7 :]


def alive(name: str) -> str:
    """The topic of a process's liveliness token."""
    return f"{name}/alive"


def progress_of(name: str) -> str:
    """The topic on which a process answers what it is about."""
    return f"{name}/progress"


def step_of(name: str) -> str:
    """The topic on which a program answers the relay of a UAV."""
    return f"{name}/step"


def is_broadcast(suffix: str) -> bool:
    """Whether a topic goes to all others: its issuer does not receive it back."""
    return suffix.partition("/")[0] in BROADCAST


def subscribed(number: int, hears: Sequence[str], cells: Iterable[str] | None) -> list[str]:
    """What a participant subscribes to of each issuer, in delivery order, by what it hears.

    `cells` are those that it listens to; None: the run has none. The coordinator listens to all.
    """
    if cells is None:
        return list(hears)
    names = [ANY] if number == COORDINATOR else sorted(cells)
    out = []
    for suffix in hears:
        kind, _, end = suffix.partition("/")
        if kind not in CELLED:
            out.append(suffix)
            continue
        out += [suffix] * (not end)  # what the coordinator tells all has no cell
        out += [f"{kind}/{name}" for name in names]
    return out


def topics_for(number: int) -> tuple[str, ...]:
    """The topics, without issuer, on which a participant hears others, in delivery order."""
    heard = (MESSAGE_BY_KIND[kind] for kind in DELIVERY_ORDER if hears_class(number, kind))
    ends = ((cls.kind, str(number) if cls.kind in ADDRESSED else cls.cell) for cls in heard)
    return tuple(f"{kind}/{end}" if end else kind for kind, end in ends)
