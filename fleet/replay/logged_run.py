"""The log of a run that is to be repeated: what was flown, and its messages tick by tick."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from fleet.config.scenario import Scenario
from fleet.faults.plan import FaultRule, plan_of
from fleet.log.reader import Record, Summary, read
from fleet.log.run_metadata import RunMetadata, run_metadata_of
from fleet.protocol.codec import decode_clock
from fleet.protocol.messages import Digest
from fleet.protocol.topics import CLOCK, DIGEST, SIMULATION_TOPICS

LoggedPlan = tuple[FaultRule, ...]

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
    """The ticks of a lockstep run, and at the end what is left, if anything."""
    open_: list[Record] = []
    for record in records:
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


@dataclass(frozen=True)
class LoggedRun:
    """What a log says of its run; messages are read anew each time, so that any log fits.

    The scenario has the fault plan at the end of the run: flown from the start it does the same.
    `plans` were in force from a tick on, None where it cannot be read. `ticks` is how many the log
    has whole.
    """

    path: Path
    scenario: Scenario
    ticks: int
    complete: bool
    about: RunMetadata
    plans: list[tuple[int, LoggedPlan | None]] = field(default_factory=list)

    @property
    def realtime(self) -> bool:
        """Whether it was flown on wall clocks."""
        return self.about.realtime

    @classmethod
    def of_log(cls, path: Path) -> LoggedRun:
        """Read a log through.

        Raises:
            LogError: it is no fleet log, or its scenario is not understood.

        """
        summary, closed, plans = Summary(path), 0, list[tuple[int, LoggedPlan | None]]()
        for record in read(path, summary):
            closed += record.topic == DIGEST
            if record.topic == CLOCK:
                plans += _announced(record)
        about = run_metadata_of(path, summary.metadata)
        plan, flown = about.fault_plan, about.scenario
        plans.insert(0, (0, flown.fault))
        if plan is None:  # the log has no end
            plan = next(p for _, p in reversed(plans) if p is not None)
        return cls(
            path,
            msgspec.structs.replace(flown, fault=plan),
            closed,
            summary.complete and about.status == "complete",
            about,
            plans,
        )

    def records(self) -> Iterator[Record]:
        """Every message; raises LogError as `of_log` does."""
        return read(self.path)

    def whole_records(self) -> Iterator[Record]:
        """The same without the tick in which a log of a lockstep run was cut, if it was."""
        if self.complete or self.realtime:
            return self.records()
        whole = itertools.takewhile(lambda tick: tick.number >= 0, ticks_of(self.records()))
        return itertools.chain.from_iterable(tick.records for tick in whole)

    def until_its_end(self) -> Scenario:
        """The scenario, as long as the log has whole ticks of it."""
        if self.complete or self.realtime:
            return self.scenario
        last_ns = (self.ticks - 1) * self.scenario.tick_ns
        duration_s = max(last_ns, self.scenario.tick_ns / 2) / 1e9
        return msgspec.structs.replace(self.scenario, duration_s=duration_s)

    def misannounced(self) -> int | None:
        """The first tick whose announced plan cannot have led to the one at the end.

        Live changes only add rules, and end rules earlier.
        """
        final = self.scenario.fault
        for tick, plan in self.plans:
            if plan is None or len(plan) > len(final):
                return tick
            if any(_endless(a) != _endless(b) for a, b in zip(plan, final, strict=False)):
                return tick
        return None


def _announced(grant: Record) -> list[tuple[int, LoggedPlan | None]]:
    """The plan that a grant announces, if it does."""
    try:
        text = decode_clock(grant.payload).plan
        return [(grant.seq, plan_of(text))] if text else []
    except ValueError:
        return [(grant.seq, None)]


def _endless(rule: FaultRule) -> FaultRule:
    return msgspec.structs.replace(rule, end_s=None)
