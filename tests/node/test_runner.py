"""Node runners: what a node is handed, when, in which order, and what it is told to have got."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from hashlib import blake2b

import msgspec
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.faults.channel import Channel
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.range import Range
from fleet.faults.rules import Rule
from fleet.model.conflict.tracks import Tracks
from fleet.model.types import Integers, Truths
from fleet.node.broadcasts import BroadcastArrivals, Broadcasts, Reception
from fleet.node.holding import LockstepTiming, RealtimeTiming, Timing
from fleet.node.node import InboxMessage
from fleet.node.runner import NodeRunner
from fleet.protocol.account import Account
from fleet.protocol.classes import DELIVERY_ORDER
from fleet.protocol.codec import encode, on_wire
from fleet.protocol.messages import DeliveryReport, Done, Late, Message, StateBroadcast
from fleet.protocol.topics import topic_of
from tests.support.samples import MS, SAMPLES, S, adsb, command, election, head_on

TICK_NS = 100 * MS
fast = settings(deadline=None, derandomize=True, max_examples=100)


class Listener:
    """A node that remembers its inboxes and sends what it is given."""

    id = 5
    hears = ("adsb/0",)
    position_ned_m = (0.0, 0.0, -300.0)
    doing = "listening"
    takes_together = True

    def __init__(self) -> None:
        self.tracks = Tracks(head_on().track_rules())
        self.together: list[InboxMessage] = []
        self.inboxes: list[tuple[int, list[InboxMessage]]] = []
        self.outbox: list[Message] = []
        self.implausible: list[tuple[int, int]] = []
        self.plans: list[Sequence[Rule]] = []
        self.stopwatch: Callable[[], int] = int
        self.round_ns = 0

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        heard = sorted([*self.together, *inbox], key=InboxMessage.order)
        self.inboxes.append((now_ns, heard))
        self.together = []
        return self.outbox

    def hearing_ns(self, delivered_ns: int, _now_ns: int) -> int:
        return delivered_ns

    def take_broadcast(self, message: StateBroadcast, _sent: StateBroadcast, local_ns: int) -> None:
        self.together.append(InboxMessage(local_ns, message))

    def hearing_times_ns(self, _delivered_ns: Integers, _now_ns: int) -> Integers:
        raise AssertionError("its tracks are no columns")

    def answering(self, _broadcasts: Broadcasts) -> Truths:
        raise AssertionError("its tracks are no columns")

    def took_broadcasts(self, _arrivals: BroadcastArrivals) -> None:
        raise AssertionError("its tracks are no columns")

    def doubts(self, _message: StateBroadcast) -> None:
        raise AssertionError("its tracks are no columns")

    def replan(self, plan: Sequence[Rule]) -> None:
        self.plans.append(plan)

    def heard(self) -> list[Message]:
        return [i.message for _, inbox in self.inboxes for i in inbox]


TWICE = Duplicate(probability=1.0, delay_s=0.2)
LOSES = Loss(probability=1.0)


class AtOnce:
    """What realtime needs to hold messages: here, none is held."""

    def __init__(self) -> None:
        self.held: list[InboxMessage] = []

    def hold(self, incoming: InboxMessage) -> None:
        self.held.append(incoming)

    def due(self, _now_ns: int) -> list[InboxMessage]:
        out, self.held = self.held, []
        return out


def runner(
    *faults: Rule, timing: Timing | None = None, incarnation: int = 0, measured: bool = False
) -> tuple[NodeRunner, Listener]:
    node = Listener()
    channel = Channel(faults, 1, TICK_NS)
    holding = AtOnce() if measured else None
    timing = timing or LockstepTiming(TICK_NS)
    return NodeRunner(node, timing, channel, holding, incarnation=incarnation), node


def take(to: NodeRunner, *messages: Message) -> None:
    for message in messages:
        to.accept(Reception(topic_of(message), encode(message), message))


def stamp(message: Message, uav: int, seq: int, tick: int) -> Message:
    return msgspec.structs.replace(message, id=uav, seq=seq, t_ns=tick * TICK_NS)


HEARD_SAMPLES = [m for m in SAMPLES if m.kind in DELIVERY_ORDER]
traffic = st.lists(
    st.builds(
        stamp,
        st.sampled_from(HEARD_SAMPLES),
        st.integers(1, 4),
        st.integers(0, 4),
        st.integers(0, 2),
    ),
    max_size=12,
    unique_by=lambda m: (m.id, m.kind, m.seq),
)


@given(st.data())
@fast
def test_the_inbox_does_not_depend_on_the_order_of_arrival(data: st.DataObject) -> None:
    sent = data.draw(traffic)
    arrived = data.draw(st.permutations(sent))
    receiver, node = runner()
    take(receiver, *arrived)
    for tick in range(5):
        receiver.step(tick * TICK_NS)
    assert node.heard() == sorted(
        sent, key=lambda m: (m.t_ns, m.id, DELIVERY_ORDER.index(m.kind), m.seq)
    )


def test_an_election_is_handed_over_before_the_commands_of_its_term() -> None:
    receiver, node = runner()
    elected = election(3, (1, 2), 1, 5 * S, elector=1)
    take(receiver, command(t_ns=0), elected)
    receiver.step(TICK_NS)
    assert [m.kind for m in node.heard()] == ["election", "cmd"]


@given(traffic)
@fast
def test_every_message_is_delivered_one_tick_after_it_was_sent(sent: list[Message]) -> None:
    receiver, node = runner()
    for tick in range(5):
        receiver.step(tick * TICK_NS)
        take(receiver, *[m for m in sent if m.t_ns == tick * TICK_NS])
    assert len(node.heard()) == len(sent)
    for now_ns, inbox in node.inboxes:
        assert all(i.delivered_ns == now_ns == i.message.t_ns + TICK_NS for i in inbox)


def test_a_message_is_held_until_it_is_due() -> None:
    receiver, node = runner()
    take(receiver, adsb(1, t_ns=TICK_NS))
    receiver.step(2 * TICK_NS - 1)
    assert node.heard() == []
    receiver.step(2 * TICK_NS)
    assert node.heard() == [adsb(1, t_ns=TICK_NS)]
    receiver.step(3 * TICK_NS)
    assert len(node.heard()) == 1


def test_realtime_delivers_on_arrival_and_in_that_order() -> None:
    receiver, node = runner(timing=RealtimeTiming())
    for uav, arrived_ns in ((1, 30), (2, 20), (3, 31)):
        sent = adsb(uav, t_ns=7)
        receiver.accept(Reception(topic_of(sent), encode(sent), sent, arrived_ns=arrived_ns))
    receiver.step(30)
    assert [(i.message.id, i.delivered_ns) for i in node.inboxes[0][1]] == [(2, 20), (1, 30)]


def test_a_link_may_lose_or_duplicate() -> None:
    lost, deaf = runner(LOSES)
    take(lost, adsb(1))
    lost.step(10 * TICK_NS)
    assert deaf.heard() == []
    twice, node = runner(TWICE)
    take(twice, adsb(1))
    twice.step(10 * TICK_NS)
    assert node.heard() == [adsb(1), adsb(1)]


def test_different_messages_with_one_sequence_number_do_not_break_the_inbox() -> None:
    receiver, node = runner()
    take(receiver, Late(1, 0, 0, 1), Late(1, 0, 0, 2))
    receiver.step(TICK_NS)
    assert set(node.heard()) == {Late(1, 0, 0, 1), Late(1, 0, 0, 2)}


def reports(sent: list[Message]) -> list[DeliveryReport]:
    return [m for m in sent if isinstance(m, DeliveryReport)]


@given(traffic)
@fast
def test_the_delivery_report_lists_what_was_consumed(sent: list[Message]) -> None:
    receiver, node = runner()
    take(receiver, *sent)
    steps = [receiver.step(now_ns) for now_ns in (0, 2 * TICK_NS, 5 * TICK_NS)]
    found = [report for step in steps for report in reports(step)]
    busy = [(now_ns, inbox) for now_ns, inbox in node.inboxes if inbox]
    assert [r.seq for r in found] == list(range(len(busy)))
    for report, (now_ns, inbox) in zip(found, busy, strict=True):
        columns = (report.src, report.kinds, report.seqs, report.sent_ns, report.delivered_ns)
        assert set(report.fates) == {"received"}
        assert (report.id, report.t_ns) == (Listener.id, now_ns)
        assert list(zip(*columns, strict=True)) == [
            (i.message.id, i.message.kind, i.message.seq, i.message.t_ns, i.delivered_ns)
            for i in inbox
        ]


def test_a_report_names_what_the_node_did_not_believe() -> None:
    """A broadcast is named by who sent it and its number, an altered one by those as sent."""
    receiver, node = runner()
    node.implausible = [(1, 4), (2, 4)]
    take(receiver, adsb(1, seq=4), adsb(1, seq=5), adsb(2, seq=4), Late(1, 4, 0, 1))
    (report,) = reports(receiver.step(TICK_NS))
    fates = dict(
        zip(zip(report.src, report.kinds, report.seqs, strict=True), report.fates, strict=True)
    )
    assert fates == {
        (1, "adsb", 4): "implausible",
        (1, "adsb", 5): "received",
        (2, "adsb", 4): "implausible",
        (1, "late", 4): "received",
    }


def test_a_report_names_the_fault_that_kept_a_message_away() -> None:
    receiver, _ = runner(Loss(probability=1.0, src="1"))
    take(receiver, adsb(1), adsb(2))
    (report,) = reports(receiver.step(TICK_NS))
    columns = (report.src, report.sent_ns, report.delivered_ns, report.fates)
    assert list(zip(*columns, strict=True)) == [(2, 0, TICK_NS, "received"), (1, 0, 0, "loss")]


def test_nothing_is_measured_in_simulated_time() -> None:
    receiver, _ = runner(Latency(base_s=0.3))
    receiver.accept(Reception("1/adsb/0", encode(adsb(1)), adsb(1), arrived_ns=77, transit_ns=5))
    (report,) = reports(receiver.step(10 * TICK_NS))
    assert (report.transit_ns, report.delay_ns, report.slip_ns) == ((), (), ())


def test_realtime_reports_what_was_measured_for_every_message() -> None:
    plan = (Latency(base_s=0.3, src="1"), Loss(probability=1.0, src="3"))
    receiver, _ = runner(*plan, timing=RealtimeTiming(), measured=True)
    for uav, arrived_ns in ((1, 30), (2, 40), (3, 50)):
        sent = adsb(uav)
        receiver.accept(
            Reception(topic_of(sent), encode(sent), sent, arrived_ns=arrived_ns, transit_ns=uav)
        )
    (report,) = reports(receiver.step(10 * TICK_NS))
    columns = (report.src, report.delivered_ns, report.transit_ns, report.delay_ns, report.fates)
    assert list(zip(*columns, strict=True)) == [
        (1, 30 + 300 * MS, 1, 300 * MS, "received"),
        (2, 40, 2, 0, "received"),
        (3, 0, 0, 0, "loss"),
    ]


def test_without_reporting_nothing_is_reported_then_or_later() -> None:
    receiver, node = runner(Loss(probability=1.0, src="1"))
    receiver.reporting = False
    take(receiver, adsb(1), adsb(2))
    assert receiver.step(TICK_NS) == []
    assert node.heard() == [adsb(2)]
    receiver.reporting = True
    take(receiver, adsb(2, seq=1))
    (report,) = reports(receiver.step(2 * TICK_NS))
    assert report.fates == ("received",)


def test_a_new_incarnation_counts_its_reports_from_a_thousand_million_on() -> None:
    receiver, _ = runner(incarnation=2)
    for tick in (1, 2):
        take(receiver, adsb(1, t_ns=tick * TICK_NS))
    found = [reports(receiver.step(tick * TICK_NS)) for tick in (2, 3)]
    assert [r.seq for (r,) in found] == [2 * 10**9, 2 * 10**9 + 1]


def test_a_new_plan_reaches_the_links_and_the_node() -> None:
    receiver, node = runner()
    receiver.replan((LOSES,))
    take(receiver, adsb(1))
    receiver.step(10 * TICK_NS)
    assert node.heard() == []
    assert node.plans == [(LOSES,)]


def test_where_a_radio_is_is_told_only_where_a_fault_asks_for_it() -> None:
    assert runner(LOSES)[0].place is None
    sender, _ = runner(Range(max_m=1000.0))
    assert sender.place == Listener.position_ned_m


def test_a_range_goes_by_the_place_that_came_with_the_message() -> None:
    receiver, node = runner(Range(max_m=1000.0))
    for uav, north_m in ((1, 999.0), (2, 1001.0)):
        sent = adsb(uav)
        receiver.accept(Reception(topic_of(sent), encode(sent), sent, place=(north_m, 0.0, -300.0)))
    receiver.step(TICK_NS)
    assert node.heard() == [adsb(1)]


def test_nothing_consumed_is_not_reported() -> None:
    receiver, _ = runner()
    take(receiver, adsb(1))
    assert receiver.step(0) == []


def test_what_the_node_sends_goes_out_in_its_order_on_its_topics() -> None:
    sender, node = runner()
    node.outbox = [adsb(5, t_ns=3), Late(5, 0, 3, 1), adsb(5, t_ns=4)]
    sent = sender.step(TICK_NS)
    assert sent == node.outbox
    assert [topic_of(message) for message in sent] == ["5/adsb/0", "5/late", "5/adsb/0"]


def test_a_tick_is_closed_with_the_account_of_what_it_sent() -> None:
    sender, node = runner()
    node.outbox = [adsb(5), Late(5, 0, 0, 1), adsb(5, seq=1)]
    account = Account(on_wire(message) for message in sender.step(7 * TICK_NS))
    digests = {
        "adsb/0": blake2b(encode(adsb(5)) + encode(adsb(5, seq=1)), digest_size=8).hexdigest(),
        "late": blake2b(encode(Late(5, 0, 0, 1)), digest_size=8).hexdigest(),
    }
    done = Done(5, 7, 7 * TICK_NS, 7, {"adsb/0": 2, "late": 1}, digests)
    assert sender.done(7, 7 * TICK_NS, account) == done


@given(st.lists(st.tuples(st.integers(0, 30), st.sampled_from(["adsb/0", "cmd/2", "cmd/11", "z"]))))
@fast
def test_accounts_are_by_topic_without_issuer(sent: list[tuple[int, str]]) -> None:
    found = Account((f"{issuer}/{suffix}", b"") for issuer, suffix in sent)
    assert found.counts == Counter(suffix for _, suffix in sent)
    assert [*found.counts] == [*found.digests] == sorted(found.counts)


def test_accounts_differ_by_a_count_a_byte_or_an_order() -> None:
    one, two = ("1/cmd/2", b"one"), ("1/cmd/2", b"two")
    own = Account([one, two, ("1/truth", b"x")])
    for other, topic in (
        ([one, two, ("1/truth", b"x")], ""),
        ([two, one, ("1/truth", b"x")], "cmd/2"),
        ([one, ("1/truth", b"x")], "cmd/2"),
        ([one, two, ("1/truth", b"y")], "truth"),
        ([one, two], "truth"),
        ([one, two, ("1/truth", b"x"), ("1/late", b"")], "late"),
    ):
        told = Account(other)
        assert own.differs(told.counts, told.digests) == topic
