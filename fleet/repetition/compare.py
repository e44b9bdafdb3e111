"""Comparing a log with a repetition of its run: the first tick and message that differ, and why.

Two things can be wrong. The log can contradict itself: then it has been altered since it was
written. Or its digests are others than those of the repetition: then the run itself went another
way, as with another version of the code.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from fleet.analysis.recorded_run import RecordedRun
from fleet.log.reader import Record
from fleet.protocol.codec import decode_clock, encode
from fleet.protocol.topics import CLOCK
from fleet.repetition.logged_ticks import (
    LoggedPlan,
    LoggedTick,
    announced_plan,
    may_become,
    scenario_flown,
    ticks_of,
)


@dataclass(frozen=True)
class UnlikeMessages:
    """A message that is not the same in both: by field, what the log and what the repetition has.

    One that only one of them has lists no fields. `byte` is the first that differs in the payload.
    """

    topic: str
    seq: int
    t_ns: int
    what: str
    fields: dict[str, tuple[Any, Any]]
    byte: int | None = None


@dataclass(frozen=True)
class Difference:
    """The first tick at which something is wrong, what it is, and the messages that are unlike."""

    tick: int
    t_ns: int
    why: str
    messages: list[UnlikeMessages]


@dataclass
class Comparison:
    """What came out: nothing, or how the log was altered, or where the repetition went another way.

    `ticks` counts what was compared.
    """

    ticks: int = 0
    altered: Difference | None = None
    differs: Difference | None = None

    @property
    def verdict(self) -> str:
        """Same, altered or different."""
        if self.altered:
            return "altered"
        return "different" if self.differs else "same"

    def __repr__(self) -> str:
        """The verdict, and the first tick that is not the same."""
        found = self.altered or self.differs
        where = f" at tick {found.tick}" if found else ""
        return f"<{self.verdict}{where}, {self.ticks} ticks compared>"


def compare_runs(run: RecordedRun, again: Iterable[LoggedTick]) -> Comparison:
    """Compare a run with the ticks of its repetition; raises LogError if it cannot be read."""
    found, chain, announced = Comparison(), _Chain(), _Announced(run)
    last, repeated = LoggedTick(()), iter(again)
    for tick in ticks_of(run.records):
        if tick.number < 0 and not run.complete:
            break  # what was refused in the tick in which the log ends
        announced.take(tick)
        other = next(repeated, LoggedTick(()))
        if tick.number != found.ticks:
            why = f"tick {found.ticks} is missing, or its digest"
            if tick.number < 0:
                why = "there is more after the last tick"
            found.altered = found.altered or _finding(found.ticks, tick, other, why)
            return found
        _compare(found, chain, tick, other)
        found.ticks += 1
        last = tick
    found.altered = found.altered or announced.misstated or _misstated(run, last)
    return found


def _misstated(run: RecordedRun, last: LoggedTick) -> Difference | None:
    """What is wrong with the digest stated at the end, which a repetition does not write."""
    stated = last.digest if run.about.digest is None else run.about.digest
    if not run.complete or stated == last.digest:
        return None
    why = f"the digest stated at the end is another, {stated}"
    return Difference(last.number, last.number * run.scenario.tick_ns, why, [])


class _Announced:
    """Looks whether every plan announced can have led to the one at the end."""

    def __init__(self, run: RecordedRun) -> None:
        self._final = scenario_flown(run).fault
        self._tick_ns = run.scenario.tick_ns
        self.misstated: Difference | None = None
        self._judge(0, run.scenario.fault)

    def take(self, tick: LoggedTick) -> None:
        """Look at the next tick."""
        for grant in tick.records:
            if grant.topic == CLOCK:
                self._judge(grant.seq, announced_plan(grant))

    def _judge(self, tick: int, plan: LoggedPlan | None) -> None:
        if self.misstated or (plan is not None and may_become(plan, self._final)):
            return
        why = "the fault plan announced cannot have become the one stated at the end"
        self.misstated = Difference(tick, tick * self._tick_ns, why, [])


class _Chain:
    """Digests computed again from the messages of a log."""

    def __init__(self) -> None:
        self._stated = self._computed = ""

    def follows(self, tick: LoggedTick) -> tuple[bool, str]:
        """Whether the digest of the next tick follows from its messages; what would follow.

        It follows also if only the digest before was altered: that is not this tick's fault.
        """
        bases = [b for b in (self._stated, self._computed) if b or not tick.number]
        results = [tick.chained(base) for base in bases]
        good = tick.digest in results
        computed = tick.digest if good else results[0]
        self._stated, self._computed = tick.digest, computed
        return good, computed


def _compare(found: Comparison, chain: _Chain, tick: LoggedTick, other: LoggedTick) -> None:
    """Compare one tick, unless what there is to find has been found."""
    follows, computed = chain.follows(tick)
    if not found.altered:
        if not follows:
            why = "the messages do not give the digest that was recorded with them"
            if computed == other.digest:
                why = "the digest that was recorded is not that of the messages"
            found.altered = _finding(tick.number, tick, other, why)
        elif tick.digest == other.digest and tick.records != other.records:
            why = "what no digest covers is not as the simulation writes it"
            finding = _finding(tick.number, tick, other, why)
            found.altered = finding if finding.messages else None
    if not found.differs and other.digest not in (tick.digest, computed):
        why = "the repetition went another way"
        found.differs = _finding(tick.number, tick, other, why)


def _finding(number: int, tick: LoggedTick, other: LoggedTick, why: str) -> Difference:
    first = (tick.records or other.records)[0]
    return Difference(number, first.log_ns, why, list(unlike(tick, other)))


def unlike(tick: LoggedTick, other: LoggedTick) -> Iterator[UnlikeMessages]:
    """The messages of a tick that differ, in order of topic and number."""
    mine, theirs = _by_identity(tick), _by_identity(other)
    for key in sorted(mine.keys() | theirs.keys()):
        (topic, seq, _), a, b = key, mine.get(key), theirs.get(key)
        if a and b:
            fields = _fields(_planless(a), _planless(b))
            if fields:
                yield UnlikeMessages(
                    topic, seq, a.sent_ns, "differs", fields, _byte(a.payload, b.payload)
                )
        else:
            there = a or b
            assert there is not None
            where = "the log" if a else "the repetition"
            yield UnlikeMessages(topic, seq, there.sent_ns, f"is only in {where}", {})


def _by_identity(tick: LoggedTick) -> dict[tuple[str, int, int], Record]:
    """Records by topic, number, and the how manieth of that number it is."""
    seen, found = Counter[tuple[str, int]](), dict[tuple[str, int, int], Record]()
    for record in tick.records:
        found[record.topic, record.seq, seen[record.topic, record.seq]] = record
        seen[record.topic, record.seq] += 1
    return found


def _planless(record: Record) -> Record:
    """A grant without the plan that it announces: a repetition has it from the beginning."""
    if record.topic != CLOCK:
        return record
    try:
        grant = decode_clock(record.payload)
    except ValueError:
        return record
    if not grant.plan:
        return record
    payload = encode(msgspec.structs.replace(grant, plan=""))
    return Record(record.topic, payload, record.seq, record.sent_ns, record.log_ns)


def _fields(a: Record, b: Record) -> dict[str, tuple[Any, Any]]:
    """The fields in which two messages differ, those of the record round them included."""
    mine, theirs = _decoded(a), _decoded(b)
    names = [*mine, *(n for n in theirs if n not in mine)]
    found = {n: (mine.get(n), theirs.get(n)) for n in names if mine.get(n) != theirs.get(n)}
    if not found and a.payload != b.payload:
        return {"payload": (a.payload.hex(), b.payload.hex())}
    return found


def _decoded(record: Record) -> dict[str, Any]:
    try:
        fields = msgspec.msgpack.decode(record.payload)
    except ValueError:
        fields = None
    if not isinstance(fields, dict):
        fields = {"payload": record.payload.hex()}
    round_it = {"publish time": record.sent_ns, "log time": record.log_ns}
    return {str(name): value for name, value in fields.items()} | round_it


def _byte(a: bytes, b: bytes) -> int | None:
    """Where two payloads differ first; None if they do not."""
    if a == b:
        return None
    shorter = min(len(a), len(b))
    return next((n for n in range(shorter) if a[n] != b[n]), shorter)
