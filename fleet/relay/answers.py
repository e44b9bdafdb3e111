"""What a program answers to its relay, held against what it was asked, and made messages of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from fleet.errors import ProgramError
from fleet.model.equipment import computes
from fleet.model.words import Mode
from fleet.protocol.messages import (
    Ack,
    Command,
    Decision,
    Election,
    Message,
    PersistentState,
    StateBroadcast,
    Truth,
)

TypedMessage = TypeVar("TypedMessage", bound=Message)

HEADER = Message.__struct_fields__
SHARED = tuple(
    name
    for name in StateBroadcast.__struct_fields__
    if name in Truth.__struct_fields__ and name not in HEADER
)
"""What a broadcast and a true state both tell: what an answer leaves out of the one is taken from
the other."""
STATE = ("position_ned_m", "velocity_ned_mps", "speed_mps", "heading_rad", "flight_path_rad")
FILLED_IN: dict[type[Message], tuple[str, ...]] = {
    StateBroadcast: (*HEADER, *STATE, "applies_ns", "equipment", "arrived", "manoeuvre"),
    Ack: (*HEADER, "issued_ns"),
}
"""What is for the relay to say, where that is more than the header."""
ANSWERED: tuple[type[Message], ...] = (Truth, StateBroadcast, Ack, PersistentState)
ANSWERED_BY_COMPUTING: tuple[type[Message], ...] = (Election, Command, Decision)
MOST_ANSWERED = 256
"""So many messages may be sent in a step."""
MOST_SHOWN, MOST_WRONG = 60, 200
"""So much is shown of a value, and said of what is wrong with it: characters."""


class AnswerError(Exception):
    """Something in an answer cannot be sent; the message says what."""


@dataclass(frozen=True)
class AskedStep:
    """What an answer is held against: the step that was asked for, and by whom.

    `commands` are those of the inbox, each with the moment at which it is answered; `waypoints` is
    how many there are on its plan.
    """

    uav: int
    equipment: str
    tick: int
    t_ns: int
    broadcast: bool
    commands: Sequence[tuple[int, Command]]
    waypoints: int


def answered_messages(answer: object, asked: AskedStep) -> list[Message]:
    """The messages that an answer is made of, in its order; they are not numbered yet.

    A broadcast tells the true state of the answer: faults of navigation are not in it yet.

    Raises:
        ProgramError: it is nothing that this UAV may say in this step.

    """
    try:
        return [*_messages(answer, asked)]
    except AnswerError as error:
        raise ProgramError(
            f"UAV {asked.uav}: what its program answers for tick {asked.tick} cannot be sent: "
            f"{error}"
        ) from error


def _messages(answer: object, asked: AskedStep) -> Iterator[Message]:
    told = [_item(item, asked) for item in _items(answer)]
    truths = [fields for cls, fields in told if cls is Truth]
    if len(truths) != 1:
        raise AnswerError(f"one 'truth' is needed, there are {len(truths)}")
    broadcasts = sum(cls is StateBroadcast for cls, _ in told)
    if broadcasts != asked.broadcast:
        due = "is due" if asked.broadcast else "is not due (the question has 'broadcast' false)"
        raise AnswerError(f"one 'adsb' {due}, there are {broadcasts}")
    truth = _typed(Truth, {**truths[0], **_header(asked)})
    unanswered = list(asked.commands)
    for cls, fields in told:
        if cls is Truth:
            yield truth
        elif cls is StateBroadcast:
            yield _broadcast(fields, truth, asked)
        elif cls is Ack:
            yield _ack(fields, unanswered, asked)
        else:
            yield _typed(cls, {**fields, **_header(asked)})
    if unanswered:
        command = unanswered[0][1]
        raise AnswerError(f"{_named(command)} is not answered by an 'ack'")


def _items(answer: object) -> list[object]:
    if not isinstance(answer, list):
        raise AnswerError(f"it is no list of [class, fields], but {_shown(answer)}")
    if len(answer) > MOST_ANSWERED:
        raise AnswerError(f"it has {len(answer)} messages, more than {MOST_ANSWERED}")
    return answer


def _item(item: object, asked: AskedStep) -> tuple[type[Message], dict[str, Any]]:
    """Class and fields of one message, without what is for the relay to say."""
    pair = item if isinstance(item, list) and len(item) == 2 else [None, None]
    kind, fields = pair
    if not isinstance(kind, str) or not isinstance(fields, dict):
        raise AnswerError(f"{_shown(item)} is no [class, fields]")
    allowed = ANSWERED + (ANSWERED_BY_COMPUTING if computes(asked.equipment) else ())
    cls = next((cls for cls in allowed if cls.kind == kind), None)
    if cls is None:
        kinds = ", ".join(cls.kind for cls in allowed)
        raise AnswerError(
            f"'{kind[:MOST_SHOWN]}' is no class that a UAV with equipment {asked.equipment} may "
            f"send ({kinds})"
        )
    own = FILLED_IN.get(cls, HEADER)
    for name, value in fields.items():
        if name in own:
            raise AnswerError(f"{kind} has '{name}', which the relay fills in")
        bad = next((v for v in _floats_in(value) if not math.isfinite(v)), None)
        if bad is not None:
            raise AnswerError(f"{kind} has '{name}' {bad}, which is no finite number")
    return cls, fields


def _floats_in(value: object) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    elif isinstance(value, list):
        for part in value:
            yield from _floats_in(part)


def _header(asked: AskedStep) -> dict[str, int]:
    return {"id": asked.uav, "seq": 0, "t_ns": asked.t_ns}


def _broadcast(fields: dict[str, Any], truth: Truth, asked: AskedStep) -> StateBroadcast:
    shared = {name: getattr(truth, name) for name in SHARED}
    own = {"applies_ns": asked.t_ns, "equipment": asked.equipment, **_header(asked)}
    own |= {"arrived": truth.waypoint_index >= asked.waypoints}
    own |= {"manoeuvre": "" if truth.mode in (Mode.PLAN, Mode.ARRIVED) else truth.mode}
    return _typed(StateBroadcast, {**shared, **fields, **own})


def _ack(
    fields: dict[str, Any],
    unanswered: list[tuple[int, Command]],
    asked: AskedStep,
) -> Ack:
    """The answer to a command that waits for one, as of when that was handled."""
    named = fields.get("target"), fields.get("term"), fields.get("number")
    for n, (at_ns, command) in enumerate(unanswered):
        if (command.id, command.term, command.number) == named:
            del unanswered[n]
            own = {**_header(asked), "t_ns": at_ns, "issued_ns": command.issued_ns}
            return _typed(Ack, {**fields, **own})
    raise AnswerError(
        f"ack answers no command of this step: target {_shown(named[0])}, "
        f"term {_shown(named[1])}, number {_shown(named[2])}"
    )


def _typed(cls: type[TypedMessage], fields: dict[str, Any]) -> TypedMessage:
    try:
        return msgspec.convert(fields, cls)
    except (msgspec.ValidationError, ValueError) as error:
        raise AnswerError(f"{cls.kind}: {str(error)[:MOST_WRONG]}") from error


def _named(command: Command) -> str:
    return f"command {command.number} of UAV {command.id} in term {command.term}"


def _shown(value: object) -> str:
    told = repr(value)
    return told if len(told) <= MOST_SHOWN else f"{told[:MOST_SHOWN]}..."
