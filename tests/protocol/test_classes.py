"""What follows from what the classes of messages declare of themselves."""

from __future__ import annotations

import pytest
from msgspec import convert

from fleet.faults.kinds.loss import Loss
from fleet.model.types import COORDINATOR
from fleet.protocol.audience import Audience
from fleet.protocol.classes import (
    ADDRESSED,
    AUDIBLE,
    BROADCAST,
    DELIVERY_ORDER,
    MESSAGE_BY_KIND,
    MESSAGES,
)
from fleet.protocol.messages import AddressedMessage, Message
from fleet.protocol.topics import is_broadcast, topics_for
from tests.support.samples import SAMPLES


def test_classes_are_told_apart_by_name_and_rank() -> None:
    assert len({cls.kind for cls in MESSAGES}) == len(MESSAGES)
    heard = [cls for cls in MESSAGES if cls.kind in AUDIBLE]
    assert len({cls.rank for cls in heard}) == len(heard)
    assert all(cls.rank > 0 for cls in heard)
    assert not any(cls.rank for cls in MESSAGES if cls.kind not in AUDIBLE)


def test_an_election_comes_before_the_commands_of_its_term_and_they_before_answers() -> None:
    known = ("adsb", "heartbeat", "election", "cmd", "ack")
    assert tuple(kind for kind in DELIVERY_ORDER if kind in known) == known


def test_every_class_that_is_heard_is_broadcast_or_addressed() -> None:
    assert {"adsb", "heartbeat", "election"} <= BROADCAST
    assert {"cmd", "ack"} <= ADDRESSED
    assert {cls.kind for cls in MESSAGES if issubclass(cls, AddressedMessage)} == ADDRESSED
    assert {k for k, c in MESSAGE_BY_KIND.items() if c.audience is Audience.TARGET} == ADDRESSED


def test_a_uav_hears_what_is_for_all_uavs_and_for_itself() -> None:
    assert {"adsb/0", "heartbeat", "election", "cmd/3", "ack/3"} <= {*topics_for(3)}
    assert not {"cmd/2", "ack/2", "truth", "decision"} & {*topics_for(3)}


def test_the_coordinator_hears_what_is_for_all() -> None:
    assert "adsb/0" in topics_for(COORDINATOR)
    assert not {"heartbeat", "election", "cmd/0", "ack/0"} & {*topics_for(COORDINATOR)}


@pytest.mark.parametrize("number", [COORDINATOR, 1, 2, 7, 9])
@pytest.mark.parametrize("message", SAMPLES, ids=lambda m: m.kind)
def test_a_message_is_for_those_who_hear_its_topic_but_no_broadcast_for_its_issuer(
    message: Message, number: int
) -> None:
    own = is_broadcast(message.suffix) and message.id == number
    assert message.is_for(number) == (message.suffix in topics_for(number) and not own)


@pytest.mark.parametrize("kind", DELIVERY_ORDER)
def test_a_fault_rule_may_name_every_class_that_is_heard(kind: str) -> None:
    assert convert({"kind": "loss", "probability": 0.5, "class": kind}, Loss).classes == kind
