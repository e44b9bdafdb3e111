"""The index over a run, made in one pass, on which every invariant is a small function."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain
from sys import intern

import msgspec
from msgspec import Struct

from fleet.analysis.clock_offsets import ClockAccount, ClockOffsets
from fleet.analysis.invariants.absences import SLACK_NS, Absences
from fleet.analysis.invariants.receivers import Receivers
from fleet.analysis.recorded_run import RecordedRun
from fleet.config.traffic import uavs_of
from fleet.faults.channel import Fate
from fleet.faults.clock import LocalClock
from fleet.faults.draws import LinkMessage
from fleet.faults.links import LinkRule
from fleet.log.reader import Record
from fleet.model.conflict.contact import INCARNATION
from fleet.model.election import Terms
from fleet.model.equipment import hears
from fleet.model.types import COORDINATOR, Position
from fleet.model.words import UNMANNED, ArrivalFate, ClockState
from fleet.node.altered import read_altered
from fleet.node.gate import credible
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import (
    Ack,
    Command,
    Conflict,
    DeliveryReport,
    Done,
    Election,
    Message,
    Outage,
    StateBroadcast,
    Truth,
)
from fleet.protocol.topics import CLOCK, OUTAGE, issuer_of

MessageKey = tuple[int, str, int]
"""Identity of a message that was sent: issuer, class, sequence number."""

BELIEVED_FATES = frozenset({ArrivalFate.RECEIVED, ArrivalFate.ALTERED})
ARRIVED_FATES = frozenset(ArrivalFate)

_outage = msgspec.msgpack.Decoder(Outage)
_WITH_ABSENT = (ClockState.RUN, ClockState.PLAN)
"""An epoch does not say who is away."""


class SentMessage(Struct, frozen=True, gc=False):
    """A message as it was sent, and in which tick (realtime: when the simulation had it)."""

    message: Message
    log_ns: int
    topic: str
    payload: bytes
    key: MessageKey

    def link_message(self, receiver: int) -> LinkMessage:
        """Its way to a receiver."""
        m = self.message
        return LinkMessage(m.id, receiver, m.kind, m.seq, m.t_ns, 8 * len(self.payload))


class Receipt(Struct, frozen=True, gc=False):
    """An entry of a delivery report: what became of one message at one receiver.

    `at_ns` is the true time at which the receiver acted on it. `message` is what it then read, and
    None for what did not reach it or was never sent.
    """

    at_ns: int
    delivered_ns: int
    fate: str
    key: MessageKey
    sent_ns: int
    message: Message | None

    @property
    def kind(self) -> str:
        """Its class."""
        return self.key[1]


class Step(Struct, frozen=True):
    """One step of a process: what it received, in order, and which elections it then announced."""

    t_ns: int
    incarnation: int
    received: list[Receipt]
    elected: list[Election]


Fates = dict[int, dict[MessageKey, Fate]]
"""By receiver and message; only of what a receiver had taken when it stepped."""


class Index:
    """A run, sorted by who sent and who received what."""

    def __init__(self, run: RecordedRun, fates_of: Callable[[Index], Fates]) -> None:
        """`fates_of` computes the fates of all messages; it is asked once, when they are needed."""
        self.run = run
        self._fates_of = fates_of
        self.scenario = run.scenario
        self.tick_ns = self.scenario.tick_ns
        self.fleet = uavs_of(self.scenario)
        self.uavs = tuple(u.id for u in self.fleet)
        self.equipment: dict[int, str] = {}
        coordinated = self.scenario.coordination.electors == "coordinator"
        self.nodes = ((COORDINATOR,) if coordinated else ()) + self.uavs
        self.terms = Terms(self.uavs)
        self._credible = credible(self.scenario)
        self.sent: dict[MessageKey, SentMessage] = {}
        self.clashes: list[tuple[SentMessage, SentMessage]] = []
        self.garbled: list[Record] = []
        self.elections: list[Election] = []
        self.conflicts: list[Conflict] = []
        self.commands: list[Command] = []
        self.acks: list[Ack] = []
        self.missing: dict[int, int] = {}
        self.absences = Absences(self.nodes, realtime=run.realtime)
        self.participant_filter = run.participant_filter()
        self._deliveries: list[Record] = []
        self._clock_offsets = ClockOffsets(self.tick_ns, frozenset(self.nodes))
        self._stepped: defaultdict[int, set[int]] = defaultdict(set)
        self._clocks = {n: LocalClock(run.plan, n) for n in self.nodes}
        self.places: dict[tuple[int, int], Position] = {}
        self.truths: dict[int, list[Truth]] = {uav: [] for uav in self.uavs}
        self.unmanned: dict[int, dict[int, Truth]] = {uav: {} for uav in self.uavs}
        self.broadcasts: dict[tuple[int, int], StateBroadcast] = {}
        self._read()

    def equipped(self, uav: int) -> str:
        """What a UAV can do, as it says itself; one that says nothing as the scenario has it."""
        planned = {u.id: u.equipment for u in self.fleet}
        return self.equipment.get(uav, planned[uav])

    def keeps_time(self, node: int) -> bool:
        """Whether a participant's clock is always right."""
        return self._clocks[node].clean

    def local_ns(self, node: int, true_ns: int) -> int:
        """What a participant's own clock shows."""
        clock = self._clocks[node]
        return true_ns if clock.clean else max(0, true_ns + clock.shift_ns(true_ns))

    @cached_property
    def wall_clocks(self) -> ClockAccount:
        """How far the wall clocks were apart; of a lockstep run nothing is known, or needed."""
        return self._clock_offsets.account()

    @cached_property
    def fates(self) -> Fates:
        """What the fault plan makes of each message; empty if no rule is about links."""
        return self._fates_of(self)

    def fate(self, receiver: int, key: MessageKey) -> Fate | None:
        """What the fault plan makes of a message on its way to a receiver; None if unknown."""
        known = self.fates.get(receiver)
        return known.get(key) if known else None

    @cached_property
    def link_rules(self) -> tuple[LinkRule, ...]:
        """The rules of the plan that are about links."""
        return tuple(rule for rule in self.run.plan if isinstance(rule, LinkRule))

    @cached_property
    def rules_by_order(self) -> tuple[LinkRule, ...]:
        """Those that go by the order of messages."""
        return tuple(rule for rule in self.link_rules if rule.by_order)

    @cached_property
    def rules_by_moment(self) -> tuple[LinkRule, ...]:
        """Those that go by order or distance: what they do depends on when a message comes."""
        return tuple(rule for rule in self.link_rules if rule.by_order or rule.by_distance)

    @cached_property
    def measures_distance(self) -> bool:
        """Whether any rule goes by distance."""
        return any(rule.by_distance for rule in self.link_rules)

    @cached_property
    def longest_payload_bits(self) -> int:
        """Of all that was sent."""
        return 8 * max(len(sent.payload) for sent in self.sent.values())

    @cached_property
    def receivers(self) -> Receivers:
        """Who is to hear what; broadcasts do not return to their issuer."""
        deaf = frozenset(u for u in self.uavs if not hears(self.equipped(u)))
        stopped = frozenset(n for n, spans in self.absences.stops.items() if spans)
        unsure = stopped if self.run.realtime else None
        return Receivers(self.scenario, lambda: chain(*self.truths.values()), deaf, unsure)

    def due_to(
        self, receiver: int, *, surely: bool = True
    ) -> Iterable[tuple[MessageKey, SentMessage]]:
        """All messages that a receiver must hear; or, where radio range leaves that open, may."""
        if not self.receivers.limited:
            may_hear = self.receivers.may_hear
            return (one for one in self.sent.items() if may_hear(receiver, one[1].message))
        return (self._sure if surely else self._possible)[receiver]

    @cached_property
    def _sure(self) -> dict[int, list[tuple[MessageKey, SentMessage]]]:
        return self._heard(surely=True)

    @cached_property
    def _possible(self) -> dict[int, list[tuple[MessageKey, SentMessage]]]:
        return self._heard(surely=False)

    def _heard(self, *, surely: bool) -> dict[int, list[tuple[MessageKey, SentMessage]]]:
        out: dict[int, list[tuple[MessageKey, SentMessage]]] = {n: [] for n in self.nodes}
        for key, sent in sorted(self.sent.items(), key=lambda one: one[1].message.t_ns):
            for node in self.receivers.of(sent.message, surely=surely):
                out[node].append((key, sent))
        return out

    def belongs(self, election: Election) -> bool:
        """Whether an election is of its issuer's own terms, and for it to hold."""
        own = election.id in (COORDINATOR, election.computing)
        return own and election.term > 0 and self.terms.elector_of(election.term) == election.id

    @property
    def plan_is_known(self) -> bool:
        """Whether it is on record what plan each participant went by at each moment.

        In realtime a plan that was changed during the run reaches everybody at another time.
        """
        return not self.run.realtime or self.run.plan == self.scenario.fault

    @property
    def settled_ns(self) -> int:
        """What happened until then is on record as a whole, though a realtime log may be cut."""
        cut = self.run.realtime and not self.run.complete
        return self.absences.end_ns - SLACK_NS if cut else self.absences.end_ns

    @cached_property
    def stepped(self) -> dict[int, list[int]]:
        """When each process stepped."""
        return {node: sorted(self._stepped[node]) for node in self.nodes}

    def steps_between(self, node: int, after_ns: int, before_ns: int | None) -> list[int]:
        """When a process stepped after one time and before another (None: the end)."""
        times = self.stepped[node]
        first = bisect_right(times, after_ns)
        return times[first : None if before_ns is None else bisect_left(times, before_ns)]

    @cached_property
    def steps(self) -> dict[int, list[Step]]:
        """The steps of each process in which it received or elected, in order of time.

        Reports are decoded anew for it: of an hour of flight, all at once would take gigabytes.
        """
        examination: dict[tuple[int, int, int], Step] = {}

        def step(node: int, t_ns: int, incarnation: int) -> Step:
            return examination.setdefault(
                (node, t_ns, incarnation), Step(t_ns, incarnation, [], [])
            )

        out: dict[int, list[Step]] = {n: [] for n in self.nodes}
        for record in self._deliveries:
            report = self.participant_filter.decode(record)
            if isinstance(report, DeliveryReport) and report.id in out:
                received = step(report.id, report.t_ns, report.seq // INCARNATION).received
                received.extend(self._receipts(report))
        for election in self.elections:
            if election.id in out:
                step(election.id, election.t_ns, election.seq // INCARNATION).elected.append(
                    election
                )
        for (node, _, _), one in sorted(examination.items(), key=lambda item: item[0]):
            out[node].append(one)
        return out

    def receipts(self) -> Iterator[tuple[int, Step, Receipt]]:
        """Every entry of every delivery report, with receiver and step."""
        for node in self.nodes:
            for step in self.steps[node]:
                for receipt in step.received:
                    yield node, step, receipt

    def _read(self) -> None:
        wanted = AUDIBLE | {Conflict.kind, DeliveryReport.kind, Truth.kind}
        for record in self.run.records:
            self.absences.end_ns = max(self.absences.end_ns, record.sent_ns)
            kind = codec.kind_of(record.topic)
            if record.topic == CLOCK:
                clock = self.participant_filter.clock(record)
                if clock is None:
                    self.garbled.append(record)
                elif clock.state in _WITH_ABSENT:
                    self.absences.tell(clock)
            elif record.topic == OUTAGE:
                self._note_outage(record)
            elif kind == Done.kind:
                self._note_step(record)
            elif kind in wanted:
                self._note(record)

    def _note_outage(self, record: Record) -> None:
        """When nothing was heard of a participant."""
        try:
            outage = _outage.decode(record.payload)
        except ValueError:
            self.garbled.append(record)
            return
        self.absences.tell_outage(outage)

    def _note_step(self, record: Record) -> None:
        """Only when it was done matters: that need not be decoded."""
        issuer = issuer_of(record.topic)
        node = int(issuer) if issuer.isdecimal() else COORDINATOR
        self._stepped[node].add(record.sent_ns)

    def _note(self, record: Record) -> None:
        message = self.participant_filter.decode(record)
        if message is None:
            self.garbled.append(record)
            return
        match message:
            case DeliveryReport():
                self._deliveries.append(record)
                self._clock_offsets.add_report(message)
                self._stepped[message.id].add(message.t_ns)
                return
            case Truth():
                self._note_truth(message)
                return
            case Conflict():
                self.conflicts.append(message)
                return
        self._sort(message)
        key = (message.id, message.kind, message.seq)
        sent = SentMessage(message, record.log_ns, record.topic, record.payload, key)
        earlier = self.sent.setdefault(key, sent)
        if earlier is not sent:
            self.clashes.append((earlier, sent))

    def _sort(self, message: Message) -> None:
        match message:
            case StateBroadcast():
                self.equipment.setdefault(message.id, message.equipment)
                self.broadcasts[message.id, message.t_ns] = message
            case Election():
                self.elections.append(message)
            case Command():
                self.commands.append(message)
            case Ack():
                self.acks.append(message)

    def _note_truth(self, truth: Truth) -> None:
        if truth.id in self.truths:
            self.truths[truth.id].append(truth)
        self.places[truth.id, truth.t_ns] = truth.position_ned_m
        if truth.mode not in UNMANNED:
            self._stepped[truth.id].add(truth.t_ns)
        elif truth.id in self.unmanned:
            self.unmanned[truth.id][truth.t_ns] = truth

    def _receipts(self, report: DeliveryReport) -> Iterator[Receipt]:
        resumed_ns = self._resumed_ns(report)
        columns = (
            report.src,
            report.kinds,
            report.seqs,
            report.sent_ns,
            report.delivered_ns,
            report.fates,
        )
        for src, kind, seq, told_ns, delivered_ns, fate in zip(*columns, strict=True):
            key, sent_ns, message = (src, kind, seq), told_ns, None
            sent = self.sent.get(key)
            if sent is not None:
                key = sent.key  # the same object for all receivers: there are millions
                sent_ns = sent.message.t_ns if sent.message.t_ns == told_ns else told_ns
                if fate in ARRIVED_FATES:
                    message = self._as_read(sent, report.id, fate)
            at_ns = max(delivered_ns, resumed_ns)
            yield Receipt(at_ns, delivered_ns, intern(fate), key, sent_ns, message)

    def _resumed_ns(self, report: DeliveryReport) -> int:
        """Before this moment a UAV acted on nothing that it received in a step.

        That is its last step; after a pause, which it notices by its clock, it is the step itself.
        The coordinator takes in everything at the time of delivery.
        """
        if report.id == COORDINATOR:
            return 0
        begun_ns, _ = self.absences.incarnation_of(report.id, report.t_ns)
        times = self.stepped[report.id]
        place = bisect_left(times, report.t_ns)
        before_ns = max(0, begun_ns - self.tick_ns)
        if place:
            before_ns = max(before_ns, times[place - 1])
        return report.t_ns if report.t_ns - before_ns > self.tick_ns else before_ns

    def _as_read(self, sent: SentMessage, receiver: int, fate: str) -> Message | None:
        """What a receiver read: the message, or what flipped bits made of it."""
        if fate == ArrivalFate.RECEIVED:
            return sent.message
        known = self.fate(receiver, sent.key)
        flips = known.deliveries[0].flips if known and known.deliveries else ()
        if not flips:
            return None if fate == ArrivalFate.ALTERED else sent.message
        return self.read_as(sent, flips)

    def read_as(self, sent: SentMessage, flips: Sequence[float]) -> Message | None:
        """What flipped bits make of a message, if it can still be taken for one."""
        return read_altered(sent.topic, sent.payload, flips, self._credible, sent.message.t_ns)
