"""The key space: who issued what, in which run."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.protocol import topics as keys
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Message
from tests.support.samples import SAMPLES, ack, adsb, any_message, command, election, heartbeat

fast = settings(deadline=None, derandomize=True, max_examples=100)
names = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=12)
topics = st.lists(names, min_size=1, max_size=4).map("/".join)


@pytest.mark.parametrize(
    ("message", "topic"),
    [
        (adsb(7), "7/adsb/0"),
        (heartbeat(0), "coordinator/heartbeat"),
        (election(1, (2, 3), 2, 0), "coordinator/election"),
        (election(1, (2, 3), 2, 0, elector=2), "2/election"),
        (command(id=1, target=12), "1/cmd/12"),
        (ack(command(id=4, target=2)), "2/ack/4"),
    ],
)
def test_topics_are_issuer_class_and_receiver(message: Message, topic: str) -> None:
    assert keys.topic_of(message) == topic


@given(any_message())
@fast
def test_a_topic_tells_the_issuer_and_the_rest(message: Message) -> None:
    topic = keys.topic_of(message)
    assert keys.issuer_of(topic) == ("coordinator" if message.id == 0 else str(message.id))
    assert keys.suffix_of(topic) == message.suffix
    assert topic == f"{keys.issuer_of(topic)}/{keys.suffix_of(topic)}"


@given(any_message())
@fast
def test_keys_are_plain_key_expressions(message: Message) -> None:
    full = keys.key("run_1", keys.topic_of(message))
    assert re.fullmatch(r"fleet/run_1(/[a-z0-9_]+)+", full)


@given(run=names, topic=topics)
@fast
def test_the_topic_of_a_key_is_the_one_it_was_made_of(run: str, topic: str) -> None:
    full = keys.key(run, topic)
    assert full.split("/")[:2] == ["fleet", run]
    assert keys.topic_in(run, full) == topic


@given(a=st.integers(0, 2**53), b=st.integers(0, 2**53))
@fast
def test_different_issuers_have_different_names(a: int, b: int) -> None:
    assert (keys.issuer_name(a) == keys.issuer_name(b)) == (a == b)


def test_broadcasts_heartbeats_and_elections_go_to_all_others_commands_and_answers_do_not() -> None:
    heard = {m.kind for m in SAMPLES if keys.is_broadcast(m.suffix)}
    assert {"adsb", "heartbeat", "election"} <= heard
    assert not {"cmd", "ack"} & heard


def test_what_only_the_recorder_hears_is_never_a_broadcast() -> None:
    suffixes = [m.suffix for m in SAMPLES if m.kind not in AUDIBLE]
    assert len(suffixes) == len(SAMPLES) - len(AUDIBLE)
    assert not any(map(keys.is_broadcast, suffixes))


def test_no_participant_is_named_like_the_range() -> None:
    topics = (keys.CLOCK, keys.DIGEST, keys.PLAN, keys.ABORT, keys.FAULT)
    ranges = {keys.issuer_of(topic) for topic in topics}
    assert ranges == {"sim"}
    assert keys.issuer_name(0) not in ranges


def test_liveliness_is_announced_under_the_name() -> None:
    assert keys.alive(keys.issuer_name(3)) == "3/alive"
    assert keys.alive(keys.issuer_name(0)) == "coordinator/alive"
