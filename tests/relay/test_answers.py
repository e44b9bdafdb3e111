"""What a program answers: made messages of, or refused in a line that says what is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from fleet.errors import ProgramError
from fleet.protocol.messages import Ack, StateBroadcast, Truth
from fleet.relay.answers import FILLED_IN, HEADER, AskedStep, answered_messages
from tests.support.samples import MS, adsb, command, truth

COMMAND = command()
ASKED = AskedStep(2, "no_compute", 12, 1200 * MS, True, [(1150 * MS, COMMAND)], 2)
Told = list[list[Any]]


def fields(message: Any) -> dict[str, Any]:
    """What a program tells of a message."""
    left_out = FILLED_IN.get(type(message), HEADER)
    told = msgspec.to_builtins(message, builtin_types=())
    return {name: value for name, value in told.items() if name not in left_out}


def answer() -> Told:
    """A good one."""
    shared = set(Truth.__struct_fields__)
    intent = {k: v for k, v in fields(adsb(2)).items() if k not in shared}
    told = {"target": 1, "term": 3, "number": 1, "accepted": True, "reason": "", "actuate_ns": 9}
    return [["ack", told], ["truth", fields(truth(2, (1.0, 2.0, -3.0), 0))], ["adsb", intent]]


def test_an_answer_is_made_messages_of_in_its_order() -> None:
    ack, state, broadcast = answered_messages(msgspec.to_builtins(answer()), ASKED)
    assert isinstance(ack, Ack)
    assert (ack.id, ack.t_ns, ack.issued_ns) == (2, 1150 * MS, COMMAND.issued_ns)
    assert isinstance(state, Truth)
    assert isinstance(broadcast, StateBroadcast)
    assert broadcast.position_ned_m == state.position_ned_m == (1.0, 2.0, -3.0)
    assert (broadcast.t_ns, broadcast.applies_ns) == (1200 * MS, 1200 * MS)
    assert (broadcast.equipment, broadcast.manoeuvre, broadcast.arrived) == (
        "no_compute",
        "",
        False,
    )


def test_what_a_broadcast_leaves_out_is_taken_from_the_true_state() -> None:
    told = answer()
    told[2][1]["commanded_climb_mps"] = 2.0
    _, state, broadcast = answered_messages(told, ASKED)
    assert isinstance(state, Truth)
    assert isinstance(broadcast, StateBroadcast)
    assert (state.commanded_climb_mps, broadcast.commanded_climb_mps) == (0.0, 2.0)
    assert broadcast.guidance_heading_rad == state.guidance_heading_rad


def without(place: int) -> Callable[[Told], object]:
    return lambda told: told[:place] + told[place + 1 :]


def having(place: int, **changes: Any) -> Callable[[Told], object]:
    def changed(told: Told) -> object:
        told[place][1] |= changes
        return told

    return changed


WRONG: dict[str, tuple[Callable[[Told], object], str]] = {
    "no list": (lambda _: {"truth": 1}, "it is no list of [class, fields], but {'truth': 1}"),
    "no pair": (lambda told: [*told, ["truth"]], "['truth'] is no [class, fields]"),
    "many": (lambda told: told * 100, "it has 300 messages, more than 256"),
    "no truth": (without(1), "one 'truth' is needed, there are 0"),
    "two truths": (lambda told: [*told, told[1]], "one 'truth' is needed, there are 2"),
    "no broadcast": (without(2), "one 'adsb' is due, there are 0"),
    "no ack": (without(0), "command 1 of UAV 1 in term 3 is not answered by an 'ack'"),
    "two acks": (lambda told: [*told, told[0]], "ack answers no command of this step: target 1"),
    "wrong class": (
        lambda told: [*told, ["heartbeat", {}]],
        "'heartbeat' is no class that a UAV with equipment no_compute may send "
        "(truth, adsb, ack, persistent_state)",
    ),
    "computes": (lambda told: [*told, ["cmd", {}]], "'cmd' is no class"),
    "header": (having(1, id=3), "truth has 'id', which the relay fills in"),
    "state": (having(2, speed_mps=9.0), "adsb has 'speed_mps', which the relay fills in"),
    "nan": (having(1, speed_mps=math.nan), "truth has 'speed_mps' nan, which is no finite number"),
    "deep inf": (
        having(1, position_ned_m=[0.0, math.inf, 0.0]),
        "truth has 'position_ned_m' inf, which is no finite number",
    ),
    "null": (having(1, speed_mps=None), "truth: Expected `float`, got `null` - at `$.speed_mps`"),
    "bounds": (having(1, heading_rad=1e9), "truth: Expected `float` <="),
    "strange field": (having(2, colour="red"), "adsb: Object contains unknown field `colour`"),
    "no field": (lambda told: [*without(2)(told), ["adsb", {}]], "adsb: Object missing required"),  # type: ignore[misc]
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_answer_is_one_line(name: str) -> None:
    spoil, why = WRONG[name]
    with pytest.raises(ProgramError) as raised:
        answered_messages(spoil(answer()), ASKED)
    told = str(raised.value)
    assert told.startswith("UAV 2: what its program answers for tick 12 cannot be sent: ")
    assert why in told
    assert "\n" not in told


def test_a_broadcast_that_is_not_due_is_refused() -> None:
    asked = AskedStep(2, "no_compute", 12, 1200 * MS, False, [(0, COMMAND)], 2)
    with pytest.raises(ProgramError, match="one 'adsb' is not due"):
        answered_messages(answer(), asked)
