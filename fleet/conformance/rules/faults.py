"""Rules of what a UAV does about the fault plan, and how it reports what came."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

from fleet.conformance import script
from fleet.conformance.evidence import Evidence, MessageFates, MessageName, SaidMessage
from fleet.conformance.rule import LOCKSTEP, Judge, NotTriedError, protocol_rule
from fleet.conformance.script import TICK_NS
from fleet.faults.channel import Channel
from fleet.faults.draws import LinkMessage
from fleet.model.elementary import dist
from fleet.model.words import ArrivalFate
from fleet.protocol.classes import AUDIBLE, DELIVERY_ORDER
from fleet.protocol.messages import DeliveryReport

_FAULTS = "faults.md#from-a-message-to-its-deliveries"
_KINDS = "faults.md#kinds-about-links"
_RECEIVED = ArrivalFate.RECEIVED.value


@lru_cache(maxsize=2)
def expected(e: Evidence) -> MessageFates:
    """What it has to report, as the plan says, by the end of the play."""
    channel = Channel(e.plan, e.scenario.seed, TICK_NS)
    last_ns = e.last_tick * TICK_NS
    out: MessageFates = {}
    heard = [s for s in e.said if s.listed and s.message.is_for(e.number)]
    heard.sort(key=lambda s: (s.message.t_ns, s.message.id, s.message.kind, s.message.seq))
    for said in heard:
        m = said.message
        taken_ns = _step(m.t_ns + TICK_NS)
        if taken_ns > last_ns:
            continue
        bits, distance_m = 8 * len(said.payload), _distance_m(e, said)
        link = LinkMessage(m.id, e.number, m.kind, m.seq, m.t_ns, bits, distance_m)
        fate = channel.fate(link)
        at_ns = [m.t_ns + max(d.delay_ns, TICK_NS) for d in fate.deliveries]
        rows = [(max(_step(ns), taken_ns), ns, _RECEIVED) for ns in at_ns]
        rows += [(taken_ns, 0, fate.dropped_by)] if fate.dropped_by else []
        out[m.kind, m.id, m.seq] = sorted(row for row in rows if row[0] <= last_ns)
    return out


@protocol_rule("reports all that it takes in, as of when it was delivered", _FAULTS, LOCKSTEP)
def _reports(e: Evidence) -> Iterator[str]:
    """Before any fault: each message once, a tick after it was sent."""
    yield from _differences(e, 0, script.FAULTS_BEGIN)


@protocol_rule("uses nothing of strangers, and no garbage", "clocks.md#who-may-speak", LOCKSTEP)
def _garbage(e: Evidence) -> Iterator[str]:
    """What it does not report it does not use."""
    if e.last_tick < script.STRANGE + 1:
        raise NotTriedError("the play did not come so far")
    due = expected(e).keys()
    for kind, src, seq in e.rows.keys() - due:
        if (kind, src, seq) != _unlisted(e):
            yield f"it reports {kind} {seq} of {src}, which nobody had to use"


@protocol_rule("reports in the order in which it handles", _FAULTS, LOCKSTEP)
def _order(e: Evidence) -> Iterator[str]:
    """By time of delivery, source, class, number; at the end what was dropped."""
    if not any(e.of(DeliveryReport)):
        raise NotTriedError("it did not report")
    rank = {kind: n for n, kind in enumerate(DELIVERY_ORDER)}
    for report in e.of(DeliveryReport):
        columns = (report.delivered_ns, report.src, report.kinds, report.seqs, report.sent_ns)
        keys = [
            (0, at, src, rank.get(kind, 9), seq) if at else (1, sent, src, rank.get(kind, 9), seq)
            for at, src, kind, seq, sent in zip(*columns, strict=True)
        ]
        came = [key for key in keys if not key[0]]
        if came != sorted(came) or [k[0] for k in keys] != sorted(k[0] for k in keys):
            yield f"the report of {report.t_ns / 1e9:g} s is in another order"


def _applies(n: int, kind: str) -> Judge:
    def judge(e: Evidence) -> Iterator[str]:
        begin = script.FAULTS_BEGIN + n * script.FAULT_TICKS
        if e.last_tick < begin + script.FAULT_TICKS:
            raise NotTriedError("the play did not come so far")
        yield from _differences(e, begin, begin + script.FAULT_TICKS)

    judge.__doc__ = f"What is sent while the plan has `{kind}`."
    return judge


for _n, (_kind, _) in enumerate(script.PLAN_KEYS):
    protocol_rule(f"applies faults of kind `{_kind}`", _KINDS, LOCKSTEP)(_applies(_n, _kind))


@protocol_rule(
    "tells where it is while the plan has a rule of `range`",
    "wire-format.md#deliveryreport",
    LOCKSTEP,
)
def _placed(e: Evidence) -> Iterator[str]:
    """In the attachment of each message that others hear."""
    if e.last_tick < script.FAULTS_BEGIN:
        raise NotTriedError("the play did not come so far")
    for h in e.heard:
        truth = e.truth(h.tick)
        heard = h.message is not None and h.message.kind in AUDIBLE
        if h.tick < script.FAULTS_BEGIN or truth is None or not heard:
            continue
        if h.sample.place is None:
            yield f"{h.sample.topic} of tick {h.tick} has no place"
        elif math.dist(h.sample.place, truth.position_ned_m) > 1e-6:
            yield f"{h.sample.topic} of tick {h.tick} has another place than its true state"


def _differences(e: Evidence, begin: int, end: int) -> Iterator[str]:
    """What it reports otherwise than it has to, of what is sent in ticks [begin, end)."""
    told, due = e.rows, expected(e)
    if not due:
        raise NotTriedError("the play did not come so far")
    sent = {(s.message.kind, s.message.id, s.message.seq): s.message.t_ns for s in e.said}
    for name, rows in due.items():
        kind, src, seq = name
        if begin * TICK_NS <= sent[name] < end * TICK_NS and sorted(told.get(name, [])) != rows:
            came, wanted = _words(told.get(name, [])), _words(rows)
            yield f"{kind} {seq} of {src}: it reports {came}, due is {wanted}"


def _words(rows: list[tuple[int, int, str]]) -> str:
    shown = [f"{fate} at {ns / 1e9:g} s" if ns else fate for _, ns, fate in sorted(rows)]
    steps = {step_ns for step_ns, _, _ in rows}
    told = f" in the step of {min(steps) / 1e9:g} s" if len(steps) == 1 else ""
    return (" and ".join(shown) or "nothing") + told


def _unlisted(e: Evidence) -> MessageName:
    """What another rule is about."""
    said = [s.message for s in e.labelled(script.UNLISTED.label)]
    return (said[0].kind, said[0].id, said[0].seq) if said else ("", 0, 0)


def _step(t_ns: int) -> int:
    """The first step at or after a time, in ns; it makes none while it is held."""
    tick = -(-t_ns // TICK_NS)
    return (script.HELD.stop if tick in script.HELD else tick) * TICK_NS


def _distance_m(e: Evidence, said: SaidMessage) -> float | None:
    truth = e.truth(said.message.t_ns // TICK_NS)
    if said.place is None or truth is None:
        return None
    return dist(said.place, truth.position_ned_m)
