"""The key space: `fleet/{run}/{topic}`, topic = `{issuer}/{class}[/{cell or target}]`.

The log uses the topic alone. The issuer is part of every key, so that access rules can bind it.
"""

from __future__ import annotations

from fleet.model.types import COORDINATOR
from fleet.protocol.classes import (
    ADDRESSED,
    BROADCAST,
    DELIVERY_ORDER,
    MESSAGE_BY_KIND,
    hears_class,
)
from fleet.protocol.messages import Message

CLOCK = "sim/clock"
DIGEST = "sim/digest"
REJECTED = "sim/rejected"
SIMULATION_TOPICS = frozenset({CLOCK, DIGEST, REJECTED})
"""What the simulation itself adds to a log; no digest covers it."""
PLAN = "sim/plan"
ABORT = "sim/abort"
FAULT = "sim/fault"
EVERYTHING = "**"


def issuer_name(number: int) -> str:
    """How a process is named in keys: its UAV number, or `coordinator`."""
    return "coordinator" if number == COORDINATOR else str(number)


def topic_of(message: Message) -> str:
    """The topic of a message."""
    return f"{issuer_name(message.id)}/{message.suffix}"


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


def is_broadcast(suffix: str) -> bool:
    """Whether a topic goes to all others: its issuer does not receive it back."""
    return suffix.partition("/")[0] in BROADCAST


def topics_for(number: int) -> tuple[str, ...]:
    """The topics, without issuer, on which a participant hears others, in delivery order."""
    heard = (MESSAGE_BY_KIND[kind] for kind in DELIVERY_ORDER if hears_class(number, kind))
    ends = ((cls.kind, str(number) if cls.kind in ADDRESSED else cls.cell) for cls in heard)
    return tuple(f"{kind}/{end}" if end else kind for kind, end in ends)
