"""A run that is to be repeated: what was flown, and its messages tick by tick."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import msgspec

from fleet.analysis.recorded_run import RecordedRun
from fleet.config.scenario import Scenario
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.log.reader import Record
from fleet.protocol.codec import decode_clock
from fleet.protocol.messages import Digest
from fleet.protocol.topics import DIGEST, ROUND_TIME, SIMULATION_TOPICS

LoggedPlan = tuple[Rule, ...]

_digests = msgspec.msgpack.Decoder(Digest)


@dataclass(frozen=True)
class LoggedTick:
    """All records of a tick in order of the log; `number` and `digest` are those of the last one.

    A tick that the log does not close has the number -1 and no digest.
    """

    records: tuple[Record, ...]
    number: int = -1
    digest: str = ""

    @property
    def messages(self) -> list[Record]:
        """What was sent in it: all that the digest covers, in its order."""
        sent = [r for r in self.records if r.topic not in SIMULATION_TOPICS]
        return sorted(sent, key=lambda r: (r.topic, r.seq))

    def chained(self, before: str) -> str:
        """The digest that follows from the messages and the digest of the tick before."""
        chain = hashlib.blake2b(bytes.fromhex(before), digest_size=16)
        for message in self.messages:
            chain.update(message.topic.encode())
            chain.update(message.payload)
        return chain.hexdigest()


def ticks_of(records: Iterable[Record]) -> Iterator[LoggedTick]:
    """The ticks of a lockstep run, and at the end what is left, if anything.

    How long rounds took is left out: it was measured, and is never the same.
    """
    open_: list[Record] = []
    for record in records:
        if record.topic == ROUND_TIME:
            continue
        open_.append(record)
        if record.topic == DIGEST:
            yield LoggedTick(tuple(open_), record.seq, _digest(record))
            open_ = []
    if open_:
        yield LoggedTick(tuple(open_))


def _digest(record: Record) -> str:
    """The digest that closes a tick; empty if it is none."""
    try:
        digest = _digests.decode(record.payload).digest
        bytes.fromhex(digest)
    except ValueError:
        return ""
    return digest


def scenario_flown(run: RecordedRun) -> Scenario:
    """The scenario with the fault plan at the end of the run: flown from the start it is the same.

    Of a run that was cut short it is as long as the log has whole ticks.
    """
    stated = run.about.fault_plan
    plan = run.plan if stated is None else stated
    scenario = msgspec.structs.replace(run.scenario, fault=plan)
    if run.complete or run.realtime:
        return scenario
    last_ns = (run.ticks - 1) * scenario.tick_ns
    duration_s = max(last_ns, scenario.tick_ns / 2) / 1e9
    return msgspec.structs.replace(scenario, duration_s=duration_s)


def announced_plan(grant: Record) -> LoggedPlan | None:
    """The plan that a grant announces, of no rules if it does not; None if it cannot be read."""
    try:
        text = decode_clock(grant.payload).plan
        return plan_of(text) if text else ()
    except ValueError:
        return None


def may_become(plan: LoggedPlan, final: LoggedPlan) -> bool:
    """Whether live changes, which only add rules and end rules earlier, can make `final` of it."""
    early = zip(plan, final, strict=False)
    return len(plan) <= len(final) and all(_endless(a) == _endless(b) for a, b in early)


def _endless(rule: Rule) -> Rule:
    return msgspec.structs.replace(rule, end_s=None)
