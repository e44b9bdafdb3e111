"""Rules of what a UAV says: form, numbers, account, true states and broadcasts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise

from fleet.conformance.evidence import Evidence, HeardMessage
from fleet.conformance.rule import LOCKSTEP, NotTriedError, protocol_rule
from fleet.model.units import to_ns, to_s
from fleet.protocol.account import Account
from fleet.protocol.messages import Ack, Done, Message, StateBroadcast, Truth
from fleet.protocol.topics import issuer_name, topic_of

_WIRE = "wire-format.md"
_FOREIGN = "foreign.md"
_SAME = 1e-6
"""In m, m/s and rad: what a broadcast may differ from the true state."""


@protocol_rule("sends nothing that is malformed", f"{_WIRE}#encoding")
def _well_formed(e: Evidence) -> Iterator[str]:
    """Everything decodes."""
    for h in e.heard:
        if h.message is None:
            yield f"{h.sample.topic} in tick {h.tick}: {h.flaw}"


@protocol_rule("speaks on topics of its own", f"{_WIRE}#key-space")
def _own_topics(e: Evidence) -> Iterator[str]:
    """Issuer, class and target are those of the message."""
    for h, message in _messages(e):
        right = topic_of(message)
        if message.id != e.number:
            yield f"a message of id {message.id} came on {h.sample.topic}"
        elif h.sample.topic != right:
            yield f"what belongs on {right} came on {h.sample.topic}"


@protocol_rule("numbers the messages of each class from 0, without a gap", f"{_WIRE}#encoding")
def _without_gaps(e: Evidence) -> Iterator[str]:
    """True states and `done` go by the tick."""
    following: defaultdict[str, int] = defaultdict(int)
    for _, message in _messages(e):
        if isinstance(message, Truth | Done):
            continue
        due, following[message.kind] = following[message.kind], message.seq + 1
        if message.seq != due:
            yield f"{message.kind} number {message.seq} came where {due} was due"


@protocol_rule("marks messages with the time of the step", f"{_WIRE}#encoding", LOCKSTEP)
def _times(e: Evidence) -> Iterator[str]:
    """An answer has that of the delivery of the command."""
    tick_ns = e.scenario.tick_ns
    for h, message in _messages(e):
        now_ns = max(h.tick, 0) * tick_ns
        earliest_ns = now_ns - tick_ns + 1 if isinstance(message, Ack) else now_ns
        if not earliest_ns <= message.t_ns <= now_ns:
            yield f"{message.kind} of tick {h.tick} has t_ns {message.t_ns}"


@protocol_rule("says how much it has sent", f"{_WIRE}#done")
def _counts(e: Evidence) -> Iterator[str]:
    """By suffix: of a tick in lockstep, of all in realtime."""
    for done, account in _accounts(e):
        if done.sent != account.counts:
            told = {s: done.sent.get(s, 0) for s in {*done.sent, *account.counts}}
            wrong = next(s for s, n in sorted(told.items()) if account.counts.get(s, 0) != n)
            came = account.counts.get(wrong, 0)
            yield f"done of tick {done.tick} tells {told[wrong]} on {wrong}, {came} came"


@protocol_rule("tells the digests of what it has sent", f"{_WIRE}#done")
def _digests(e: Evidence) -> Iterator[str]:
    """BLAKE2b of 8 bytes over the payloads of a suffix, in order of sending."""
    for done, account in _accounts(e):
        for suffix, digest in account.digests.items():
            if done.digests.get(suffix) != digest:
                told = done.digests.get(suffix)
                yield f"done of tick {done.tick} tells {told} of {suffix}, it is {digest}"


@protocol_rule("numbers `done` by its tick", f"{_WIRE}#encoding")
def _done_by_tick(e: Evidence) -> Iterator[str]:
    """And gives it the time of that."""
    for done in e.of(Done):
        if done.tick >= 0 and (done.seq, done.t_ns) != (done.tick, done.tick * e.scenario.tick_ns):
            yield f"done of tick {done.tick} has seq {done.seq} and t_ns {done.t_ns}"


@protocol_rule("tells its true state once in every step", f"{_WIRE}#truth", LOCKSTEP)
def _true_states(e: Evidence) -> Iterator[str]:
    """Numbered by the tick."""
    told: defaultdict[int, int] = defaultdict(int)
    for truth in e.of(Truth):
        told[truth.t_ns] += 1
        if truth.seq * e.scenario.tick_ns != truth.t_ns:
            yield f"the true state of {to_s(truth.t_ns):g} s has number {truth.seq}"
    for t_ns in _steps(e):
        if told[t_ns] != 1:
            yield f"{told[t_ns]} true states of {to_s(t_ns):g} s"


@protocol_rule(
    "broadcasts whenever it is due, and then alone", f"{_FOREIGN}#how-it-may-fly", LOCKSTEP
)
def _on_time(e: Evidence) -> Iterator[str]:
    """A multiple of `surveillance.broadcast_s` has come since the last step."""
    period_ns, last_ns = to_ns(e.scenario.surveillance.broadcast_s), -1
    told = [m.t_ns for m in e.of(StateBroadcast)]
    for t_ns in _steps(e):
        due = t_ns // period_ns > last_ns // period_ns
        if told.count(t_ns) != due:
            yield f"{told.count(t_ns)} broadcasts at {to_s(t_ns):g} s, where {int(due)} was due"
        last_ns = t_ns


@protocol_rule("broadcasts its true state", f"{_FOREIGN}#how-it-may-fly")
def _as_it_is(e: Evidence) -> Iterator[str]:
    """Position, velocity, speed, heading and climb, to 1e-6."""
    true = {truth.t_ns: truth for truth in e.of(Truth)}
    if not any(e.of(StateBroadcast)):
        raise NotTriedError("it did not broadcast")
    for told in e.of(StateBroadcast):
        truth = true.get(told.t_ns)
        if truth is None:
            continue
        for name in ("position_ned_m", "velocity_ned_mps", "speed_mps", "heading_rad"):
            one, other = _numbers(getattr(told, name)), _numbers(getattr(truth, name))
            if max(abs(a - b) for a, b in zip(one, other, strict=True)) > _SAME:
                yield f"{name} at {to_s(told.t_ns):g} s is {one}, in truth {other}"


@protocol_rule("flies no faster than it says", f"{_FOREIGN}#how-it-may-fly")
def _plausible(e: Evidence) -> Iterator[str]:
    """From broadcast to broadcast, plus `surveillance.jump_m`; speeds change within limits."""
    told, jump_m = [*e.of(StateBroadcast)], e.scenario.surveillance.jump_m
    if len(told) < 2:
        raise NotTriedError("it did not broadcast twice")
    limit_mps2 = e.scenario.model(e.number).limits.acceleration_mps2
    for one, two in pairwise(told):
        span_s = to_s(two.t_ns - one.t_ns)
        moved_m = math.dist(one.position_ned_m, two.position_ned_m)
        if moved_m > max(one.speed_mps, two.speed_mps) * span_s + jump_m:
            yield f"{moved_m:.0f} m in {span_s:g} s at {two.speed_mps:g} m/s"
        if abs(two.speed_mps - one.speed_mps) > limit_mps2 * span_s + jump_m / 10:
            yield f"from {one.speed_mps:g} to {two.speed_mps:g} m/s in {span_s:g} s"


@protocol_rule("says the equipment that the scenario gives it", f"{_FOREIGN}#what-a-uav-has-to-do")
def _equipment(e: Evidence) -> Iterator[str]:
    """In its broadcasts."""
    right = next(u.equipment for u in e.scenario.uav if u.id == e.number)
    told = {m.equipment for m in e.of(StateBroadcast)}
    if not told:
        raise NotTriedError("it did not broadcast")
    if told != {right}:
        yield f"it says {', '.join(sorted(told))}, the scenario {right}"


def _messages(e: Evidence) -> Iterator[tuple[HeardMessage, Message]]:
    return ((h, h.message) for h in e.heard if h.message is not None)


def _numbers(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)


def _steps(e: Evidence) -> list[int]:
    """Times in ns of the steps that it was to make, as far as the play came; lockstep."""
    last = e.last_tick
    return [g.t_ns for g in e.grants if e.number not in g.held and g.tick <= last]


def _accounts(e: Evidence) -> Iterator[tuple[Done, Account]]:
    """Each `done`, with what has come since the one before."""
    account, any_done = Account(), False
    own = issuer_name(e.number)
    for h in e.heard:
        if isinstance(h.message, Done):
            any_done = True
            yield h.message, account
            account = Account()
        elif h.sample.topic.startswith(f"{own}/"):
            account.add(h.sample.topic, h.sample.payload)
    if not any_done:
        raise NotTriedError("no `done` came")
