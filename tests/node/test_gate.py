"""What of all that arrives on an open bus is taken for a message of the run, and by whom."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.scenario import Scenario, Surveillance, Uav
from fleet.errors import FleetStoppedError
from fleet.model.conflict.contact import INCARNATION
from fleet.model.types import Position
from fleet.node.gate import HARMLESS, REFUSAL_TEXTS, Gate, RefusedError, credible
from fleet.node.intake import Intake, Listed
from fleet.protocol.account import Account
from fleet.protocol.codec import encode
from fleet.protocol.messages import Clock, Done, Election, Heartbeat, Late, Message, Rejected
from fleet.protocol.sample import KEYS_KEPT, Sample, attachment, sample_of
from fleet.protocol.topics import topic_of
from fleet.simulation.listener import Listener, OwnMessages
from fleet.simulation.run_recorder import RunRecorder
from tests.support.samples import S, adsb, any_message, command, election, heartbeat, truth

UAVS = tuple(Uav(n, (0.0, 1000.0 * n, -300.0), 0.0, ((9e4, 0.0, -300.0),)) for n in (1, 2, 3))
COORDINATED = Scenario("gate", 10.0, uav=UAVS)
TICK_NS = COORDINATED.tick_ns
HOUR_NS = 3600 * 10**9
fast = settings(deadline=None, derandomize=True, max_examples=100)


def came(message: Message) -> Sample:
    return Sample(topic_of(message), encode(message))


def gate(*, rising: bool = False) -> Gate:
    made = Gate(COORDINATED, rising=rising)
    made.latest_ns = 2**62
    return made


def refused(through: Gate, arrival: Sample) -> str:
    """Why; empty if it is let through."""
    try:
        through.admit(arrival)
    except RefusedError as error:
        return error.why
    return ""


# The key and the attachment


@pytest.mark.parametrize(
    ("key", "topic", "flaw"),
    [
        ("fleet/run/1/adsb/0", "1/adsb/0", ""),
        ("fleet/run/*/cmd/2", "*/cmd/2", "several topics"),
        ("fleet/run/1/cmd/$*2", "1/cmd/$*2", "several topics"),
        ("fleet/run/**", "**", "several topics"),
        ("fleet/**", "fleet/**", "several topics"),
        ("fleet/r$*n/1/adsb/0", "fleet/r$*n/1/adsb/0", "several topics"),
        ("fleet/other/1/adsb/0", "fleet/other/1/adsb/0", "several topics"),
    ],
)
def test_a_topic_is_one_key_of_this_run(key: str, topic: str, flaw: str) -> None:
    arrival = sample_of("run", key, b"x", None)
    assert (arrival.topic, arrival.payload, arrival.flaw) == (topic, b"x", flaw)


@given(
    st.integers(1, 2**62),
    st.tuples(*3 * [st.floats(-1e7, 1e7)]) | st.none(),
    st.integers(0, HOUR_NS),
)
@fast
def test_an_attachment_says_when_from_where_and_how_long_a_round_took(
    put_ns: int, place: tuple[float, float, float] | None, round_ns: int
) -> None:
    mark = attachment(put_ns, place, round_ns)
    arrival = sample_of("run", "fleet/run/1/truth", b"", mark, put_ns + 5)
    assert (arrival.put_unix_ns, arrival.place, arrival.flaw) == (put_ns, place, "")
    assert arrival.round_ns == round_ns


@pytest.mark.parametrize(
    "mark",
    [
        struct.pack("<q", -1),
        struct.pack("<q", 2**63 - 1),
        struct.pack("<q", 10**18 + HOUR_NS + 1),
        struct.pack("<q", 10**18 - HOUR_NS - 1),
        struct.pack("<q3d", 0, float("nan"), 0.0, 0.0),
        struct.pack("<q3d", 0, 0.0, float("inf"), 0.0),
        struct.pack("<q3d", 0, 0.0, 0.0, -1.01e7),
        struct.pack("<qq", 0, -1),
        struct.pack("<qq", 0, HOUR_NS + 1),
        struct.pack("<q3dq", 0, 0.0, 0.0, 0.0, -1),
    ],
)
def test_an_attachment_out_of_bounds_is_a_flaw_of_its_message(mark: bytes) -> None:
    arrival = sample_of("run", "fleet/run/1/adsb/0", encode(adsb(1)), mark, 10**18)
    assert arrival.flaw == "attachment"
    assert refused(gate(), arrival) == "attachment"


# The gate


def test_made_up_topics_take_no_room_without_end() -> None:
    through = gate()
    for n in range(2 * KEYS_KEPT):
        assert refused(through, Sample(f"1/adsb/{n}", encode(adsb(1)))) == (
            "misattributed" * (n > 0)
        )
    for n in range(10):
        long = "x" * 300 + str(n)
        assert refused(through, Sample(f"1/adsb/{long}", encode(adsb(1)))) == "misattributed"
        assert sample_of("run", f"fleet/run/{long}", b"", None).topic == long
    assert len(through._parts) <= KEYS_KEPT
    assert not any(len(topic) > 200 for topic in through._parts)
    assert refused(through, came(adsb(2))) == ""


@pytest.mark.parametrize("topic", ["1/adsb/0/", "1//adsb/0", "01/adsb/0", "1/adsb", "1/adsb/"])
def test_only_the_one_way_to_write_a_topic_is_let_through(topic: str) -> None:
    assert refused(gate(), Sample(topic, encode(adsb(1)))) in {
        "misattributed",
        "malformed",
        "stranger",
    }


@pytest.mark.parametrize(
    ("arrival", "why"),
    [
        (came(adsb(1)), ""),
        (came(Heartbeat(0, 0, 0, 0)), ""),
        (came(adsb(99)), "stranger"),
        (Sample("replay/clock", b""), "stranger"),
        (Sample("99/adsb/0", b"", flaw="deletion"), "stranger"),
        (Sample("1/adsb/0", b"", flaw="deletion"), "deletion"),
        (Sample("*/adsb/0", encode(adsb(1)), flaw="several topics"), "several topics"),
        (Sample("1/adsb/0", encode(adsb(1))[:-1]), "malformed"),
        (Sample("1/adsb/0", encode(adsb(1)) + b"\x00"), "malformed"),
        (Sample("1/adsb/0", b""), "malformed"),
        (Sample("1/adsb/0", b"\x91" * 100_000), "malformed"),
        (Sample("1/truth", encode(adsb(1))), "malformed"),
        (Sample("1/nosuch", encode(adsb(1))), "malformed"),
        (Sample("1", encode(adsb(1))), "malformed"),
        (Sample("2/adsb/0", encode(adsb(1))), "misattributed"),
        (Sample("1/cmd/3", encode(command())), "misattributed"),
        (Sample("01/adsb/0", encode(adsb(1))), "stranger"),
        (Sample("/adsb/0", encode(adsb(1))), "stranger"),
        (Sample("0/late", encode(Late(0, 0, 0, 1))), "stranger"),
        (Sample("coordinator/adsb/0", encode(adsb(1))), "misattributed"),
    ],
)
def test_only_well_formed_messages_of_participants_pass(arrival: Sample, why: str) -> None:
    assert refused(gate(), arrival) == why


@given(st.lists(any_message().map(encode) | st.binary(max_size=30), max_size=8))
@fast
def test_whatever_arrives_is_let_through_whole_or_refused(payloads: list[bytes]) -> None:
    through = gate()
    for payload in payloads:
        arrival = Sample("3/late", payload)
        if not refused(through, arrival):
            message = through.admit(arrival)
            assert isinstance(message, Late)
            assert message.id == 3


def test_nothing_is_from_the_future() -> None:
    through = gate()
    through.latest_ns = 5 * S
    assert refused(through, came(adsb(1, t_ns=5 * S))) == ""
    assert refused(through, came(adsb(1, t_ns=5 * S + 1))) == "future"
    assert refused(through, came(adsb(1, t_ns=2**63 - 1))) == "future"


def test_where_they_come_in_order_numbers_rise_on_each_topic() -> None:
    through = gate(rising=True)
    order = [adsb(1, seq=4), adsb(2, seq=4), adsb(1, seq=5), adsb(1, seq=5), adsb(1, seq=4)]
    assert [refused(through, came(m)) for m in order] == ["", "", "", "repeated", "repeated"]
    assert refused(through, came(adsb(2, seq=4))) == "repeated"
    assert [refused(through, came(Done(1, 0, 0, -1, {}, {}))) for _ in range(2)] == ["", ""]


@pytest.mark.parametrize("t_ns", [0, 7 * S])
def test_terms_rise_no_faster_than_all_electors_can_raise_them(t_ns: int) -> None:
    """Four electors: each could begin four terms a tick for each of four groups."""
    believe, most = credible(COORDINATED), 25 * (t_ns // COORDINATED.tick_ns + 2)
    for term, possible in ((most, True), (most + 1, False), (2**52, False)):
        for message in (
            Heartbeat(0, 0, t_ns, term),
            Election(0, 0, t_ns, term, 1, (1, 2), 1, t_ns),
        ):
            assert believe(message, t_ns) is possible
    assert believe(command(term=2**52), t_ns)


def test_a_term_that_leaves_no_room_above_it_is_refused() -> None:
    assert refused(gate(), came(Heartbeat(0, 0, S, 2**52))) == "term"


def test_every_reason_fits_into_the_record() -> None:
    assert REFUSAL_TEXTS.keys() >= HARMLESS
    for why in REFUSAL_TEXTS:
        encode(Rejected(0, "x", why, 1))


# The intake of a lockstep participant


def taken(intake: Intake, listed: Sequence[Listed], *arriving: Message) -> list[Message]:
    """What is taken; it must not wait for more than what arrives."""
    more = iter([came(m) for m in arriving])
    return [message for _, message in intake.take(listed, lambda: next(more))]


@given(st.permutations([(uav, seq) for uav in (1, 2, 3) for seq in (4, 5)]))
@fast
def test_what_is_listed_is_taken_however_it_arrives(order: list[tuple[int, int]]) -> None:
    """Of one issuer in order of sending, as the bus keeps it; the next tick's may come early."""
    intake = Intake(gate())
    sent = {uav: iter([adsb(uav, seq=4), adsb(uav, seq=5)]) for uav in (1, 2, 3)}
    stream = iter([came(next(sent[uav])) for uav, _ in order])
    for seq in (4, 5):
        listed = [(uav, seq) for uav in (1, 2, 3)]
        got = [message for _, message in intake.take(listed, lambda: next(stream))]
        assert got == [adsb(uav, seq=seq) for uav in (1, 2, 3)]


def test_what_nobody_says_to_have_sent_takes_no_slot() -> None:
    intake = Intake(gate())
    ghost, stale, ahead = adsb(99, seq=0), adsb(1, seq=3), adsb(2, seq=70)
    genuine = [adsb(1, seq=4), adsb(2, seq=4)]
    assert taken(intake, [(1, 4), (2, 4)], ghost, stale, ahead, *genuine) == genuine
    later = [adsb(1, seq=5), adsb(2, seq=5)]
    assert taken(intake, [(1, 5), (2, 5)], adsb(1, seq=4), *later) == later


def test_of_two_with_one_number_one_is_taken_and_nothing_is_late() -> None:
    """Which one is genuine the receiver cannot tell; the simulation ends the run over it."""
    intake = Intake(gate())
    forged = adsb(1, seq=4, t_ns=1)
    assert taken(intake, [(1, 4)], forged) == [forged]
    assert taken(intake, [(1, 5)], adsb(1, seq=4), adsb(1, seq=5)) == [adsb(1, seq=5)]


def test_what_is_listed_twice_is_taken_once() -> None:
    intake = Intake(gate())
    assert taken(intake, [(1, 4), (1, 4)], adsb(1, seq=4)) == [adsb(1, seq=4)]


def test_what_was_offered_waits() -> None:
    intake = Intake(gate())
    for message in (adsb(1, seq=0), adsb(1, seq=1)):
        intake.offer(came(message))
    assert taken(intake, [(1, 0)]) == [adsb(1, seq=0)]
    assert taken(intake, [(1, 1)]) == [adsb(1, seq=1)]


def test_what_waits_for_a_manifest_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.node.intake.MOST_EARLY", 2)
    intake = Intake(gate())
    for seq in range(5):
        intake.offer(came(adsb(1, seq=seq)))
    assert intake.lacked_room == 3
    assert taken(intake, [(1, 0)]) == [adsb(1, seq=0)]
    # what is waited for has room
    assert taken(intake, [(2, 0)], adsb(3, seq=0), adsb(2, seq=0)) == [adsb(2, seq=0)]


def test_a_class_that_its_issuer_never_sends_is_no_message_of_the_run() -> None:
    through = gate()
    assert refused(through, came(heartbeat(0, 0))) == ""
    by_uav = msgspec.structs.replace(heartbeat(0, 0), id=1)
    assert refused(through, came(by_uav)) == "misattributed"
    state = msgspec.structs.replace(truth(1, (0.0, 0.0, -300.0), 0), id=0)
    by_coordinator = Sample("coordinator/truth", encode(state))
    assert refused(through, by_coordinator) == "misattributed"


def test_a_command_to_somebody_who_takes_no_part_is_no_message_of_the_run() -> None:
    through = gate()
    assert refused(through, came(command())) == ""
    assert refused(through, came(command(target=99))) == "misattributed"


# Cells

CELLED = msgspec.structs.replace(COORDINATED, surveillance=Surveillance(range_m=1000.0))
HERE, CELL = (2500.0, -100.0, -300.0), "2_-1"


@pytest.mark.parametrize(
    ("topic", "place", "why"),
    [
        ("1/adsb/2_-1", HERE, ""),
        ("1/adsb/0", HERE, "misattributed"),
        ("1/adsb/2_0", HERE, "misattributed"),
        ("1/adsb/2_-1", None, "misattributed"),
        ("1/adsb/2_-1", (0.0, 0.0, 0.0), "misattributed"),
        ("1/adsb", HERE, "misattributed"),
    ],
)
def test_with_a_range_a_broadcast_is_to_the_cell_where_its_radio_was(
    topic: str, place: Position | None, why: str
) -> None:
    through = Gate(CELLED)
    through.latest_ns = 2**62
    assert refused(through, Sample(topic, encode(adsb(1)), place=place)) == why
    assert refused(gate(), Sample(topic, encode(adsb(1)), place=place)) == (
        "" if topic == "1/adsb/0" else "misattributed"
    )


def test_what_is_not_told_to_all_by_a_uav_is_in_no_cell() -> None:
    through = Gate(CELLED)
    through.latest_ns = 2**62
    for message in (command(), truth(1, HERE, 0), heartbeat(0), election(4, (1, 2), 1, 0)):
        assert refused(through, came(message)) == ""
    own = encode(election(5, (1, 2), 1, 0, elector=1))
    assert refused(through, Sample(f"1/election/{CELL}", own, place=HERE)) == ""
    assert refused(through, Sample("1/election", own, place=HERE)) == "misattributed"


def test_numbers_rise_from_cell_to_cell() -> None:
    through = Gate(CELLED, rising=True)
    through.latest_ns = 2**62
    there = (0.0, 0.0, -300.0)
    assert refused(through, Sample("1/adsb/2_-1", encode(adsb(1, seq=5)), place=HERE)) == ""
    assert refused(through, Sample("1/adsb/0_0", encode(adsb(1, seq=5)), place=there)) == "repeated"
    assert refused(through, Sample("1/adsb/0_0", encode(adsb(1, seq=6)), place=there)) == ""


# The simulation's ear


def listener() -> tuple[Listener, RunRecorder, OwnMessages]:
    run_recorder, words = RunRecorder(COORDINATED, None), OwnMessages()
    return Listener(gate(rising=True), run_recorder, words, TICK_NS), run_recorder, words


def closing(name: int, *sent: Message) -> Message:
    account = Account((topic_of(m), encode(m)) for m in sent)
    return Done(name, 3, 300, 3, account.counts, account.digests)


def heard(by: Listener, *messages: Message) -> list[tuple[str, bytes, Message]]:
    items = [by.hear(came(m), 2**62) for m in messages]
    return [item for item in items if item is not None]


def test_strangers_are_counted_and_change_nothing() -> None:
    by, run_recorder, _ = listener()
    assert heard(by, adsb(99), adsb(1), adsb(99)) == heard(listener()[0], adsb(1))
    assert run_recorder.rejected == {("99/adsb/0", "stranger"): 2}


def test_what_is_in_a_participants_name_and_not_its_own_ends_the_run() -> None:
    for arrival in (
        Sample("1/adsb/0", b"junk"),
        Sample("2/adsb/0", encode(adsb(1))),
        Sample("1/adsb/0", encode(adsb(1)), flaw="attachment"),
    ):
        by, run_recorder, _ = listener()
        with pytest.raises(FleetStoppedError, match=arrival.topic):
            by.hear(arrival, 2**62)
        assert [topic for topic, _ in run_recorder.rejected] == [arrival.topic]


def test_the_range_knows_its_own_words_once() -> None:
    by, _, words = listener()
    words.say("sim/clock", b"tick")
    assert by.hear(Sample("sim/clock", b"tick"), 0) is None
    with pytest.raises(FleetStoppedError, match="sim/clock: somebody else"):
        by.hear(Sample("sim/clock", b"tick"), 0)


@pytest.mark.parametrize("topic", ["sim/clock", "sim/digest", "sim/abort", "sim/rejected"])
def test_nobody_else_speaks_in_the_name_of_the_range(topic: str) -> None:
    for arrival in (Sample(topic, b"x"), Sample(topic, b"", flaw="deletion")):
        by, run_recorder, words = listener()
        words.say(topic, b"")
        with pytest.raises(FleetStoppedError, match="in the name of the simulation"):
            by.hear(arrival, 0)
        assert run_recorder.rejected == {(topic, "not the simulation"): 1}


def test_its_own_abort_ends_the_run_with_its_reason() -> None:
    by, _, words = listener()
    words.say("sim/abort", b"process 2 ended early")
    with pytest.raises(FleetStoppedError, match=r"^process 2 ended early$"):
        by.hear(Sample("sim/abort", b"process 2 ended early"), 0)


ONE, TWO, OTHER = command(seq=0), command(seq=1), command(seq=0, number=9)
AUDITS: dict[str, tuple[list[Message], str]] = {
    "as told": ([ONE, TWO, closing(1, ONE, TWO)], ""),
    "one too many": ([ONE, TWO, closing(1, ONE)], "1/cmd/2"),
    "another in its place": ([OTHER, closing(1, ONE)], "1/cmd/2"),
    "from one who is not due": ([adsb(2), ONE, closing(1, ONE)], "2/adsb/0"),
    "the surplus first": (
        [adsb(2, seq=1), command(id=3, target=1), closing(2, adsb(2, seq=1)), closing(3)],
        "3/cmd/1",
    ),
}


@pytest.mark.parametrize("name", AUDITS)
def test_a_tick_is_what_everybody_says_to_have_sent(name: str) -> None:
    messages, topic = AUDITS[name]
    by, run_recorder, _ = listener()
    items = heard(by, *messages)
    if not topic:
        by.audit(items)
        return
    with pytest.raises(FleetStoppedError, match=f"a message on {topic}: its issuer does not say"):
        by.audit(items)
    assert run_recorder.rejected == {(topic, "unaccounted"): 1}


@pytest.mark.parametrize("name", ["as told", "one too many", "another in its place"])
def test_a_realtime_run_is_what_everybody_says_at_its_end(name: str) -> None:
    messages, topic = AUDITS[name]
    by, run_recorder, _ = listener()
    *items, last = heard(by, *messages)
    for item in items:
        by.enter(item, S)
    if topic:
        with pytest.raises(FleetStoppedError, match=f"a message on {topic}"):
            by.enter(last, S)
    else:
        by.enter(last, S)
    assert [t for t, _ in run_recorder.rejected] == [topic] * bool(topic)


def test_after_its_last_word_nobody_speaks() -> None:
    by, _, _ = listener()
    done, late = heard(by, closing(1), ONE)
    by.enter(done, S)
    with pytest.raises(FleetStoppedError, match="1/cmd/2"):
        by.enter(late, S)


def down(*nodes: int) -> Clock:
    return Clock(10, S, "plan", {}, down=nodes)


def test_nobody_speaks_for_the_dead() -> None:
    """One that is killed tells no account; what is told at its end is still its own."""
    by, run_recorder, _ = listener()
    last, forged = heard(by, command(seq=0, t_ns=S), command(seq=1, t_ns=2 * S))
    by.know(down(1), S)
    by.enter(last, 2 * S)
    with pytest.raises(FleetStoppedError, match="1/cmd/2: its issuer was stopped or dead"):
        by.enter(forged, 2 * S)
    assert run_recorder.rejected == {("1/cmd/2", "away"): 1}


@pytest.mark.parametrize("honest", [True, False])
def test_each_incarnation_has_its_own_account(honest: bool) -> None:
    by, run_recorder, _ = listener()
    old, new = command(seq=0, t_ns=S), command(seq=INCARNATION, t_ns=3 * S)
    first, again, done = heard(by, old, new, closing(1, new) if honest else closing(1, old, new))
    by.know(down(1), S)
    by.know(msgspec.structs.replace(down(), tick=20, t_ns=2 * S), 2 * S)
    by.enter(first, 2 * S)
    by.enter(again, 3 * S)
    done = (*done[:2], msgspec.structs.replace(done[2], t_ns=4 * S))
    if honest:
        by.enter(done, 4 * S)
    else:
        with pytest.raises(FleetStoppedError, match="1/cmd/2"):
            by.enter(done, 4 * S)
    assert [why for _, why in run_recorder.rejected] == ["unaccounted"] * (not honest)


@pytest.mark.parametrize("mode", ["held", "unmanned"])
def test_only_the_range_tells_where_an_aircraft_without_a_process_is(mode: str) -> None:
    by, _, _ = listener()
    (item,) = heard(by, msgspec.structs.replace(truth(1, (0.0, 0.0, -300.0), S), mode=mode))
    with pytest.raises(FleetStoppedError, match="in the name of the simulation"):
        by.enter(item, S)


def test_topics_from_outside_are_fit_to_be_shown_and_few() -> None:
    run_recorder = RunRecorder(COORDINATED, None)
    assert (
        run_recorder.refuse("9/\x1b[31m\u202e" + "x" * 300, "stranger")
        == ("9/?[31m?" + "x" * 300)[:200]
    )
    for n in range(1000):
        run_recorder.refuse(f"{n}/adsb/0", "stranger")
    assert len(run_recorder.rejected) == 101
    assert run_recorder.rejected["others", "stranger"] == 1001 - 100
