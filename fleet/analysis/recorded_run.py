"""A run on record, from its log or from memory: the one reading that everything else begins with.

What is read is verified, and goes up to the first damage: a run without gaps.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

from fleet.analysis.participant_filter import ParticipantFilter
from fleet.arguments import path_of, require
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.errors import ArgumentError, LogError
from fleet.extras import import_extra
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.html_tables import facts_html
from fleet.log.columns import Columns
from fleet.log.foreign import ForeignTopic
from fleet.log.reader import Record, Summary, read
from fleet.log.run_metadata import RunMetadata, check_plan, not_understood, run_metadata_of
from fleet.log.store import Log
from fleet.log.unknown import UnknownClass
from fleet.model.words import ClockMode
from fleet.protocol.codec import decode_clock
from fleet.protocol.messages import Clock, Message
from fleet.protocol.topics import CLOCK, DIGEST, REJECTED


class RecordCollector:
    """A sink for `RunRecorder` that keeps what it is given."""

    def __init__(self) -> None:
        self.kept: list[Record] = []

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Keep one message."""
        self.kept.append(Record(topic, payload, seq, sent_ns, log_ns))


@dataclass(frozen=True, repr=False)
class RecordedRun:
    """One run: how it was started and ended, the fault plan at its end, and all its messages.

    `records` are in order of the log; those of a file are read anew each time, so that any log
    fits. `plan` is the last one that the clock announced: a plan that changes while the run is on
    only gains rules and ends some earlier, so that it tells the whole story. `ticks` is how many
    lockstep ticks are on record, `damage` what is missing of the run, in words; empty if nothing.
    `foreign` are the topics of other programs in its log, whose messages are not among the records;
    `unknown` the message classes among them that are not known here.
    """

    about: RunMetadata
    plan: tuple[Rule, ...]
    records: Iterable[Record]
    ticks: int = 0
    damage: str = ""
    path: Path | None = None
    foreign: tuple[ForeignTopic, ...] = ()
    unknown: tuple[UnknownClass, ...] = ()

    @classmethod
    def of_log(cls, path: str | PathLike[str], *, lenient: bool = False) -> RecordedRun:
        """The run that a log tells of; the log is read through once.

        `lenient` passes over announced plans that are not understood.

        Raises:
            LogError: it cannot be read, is no fleet log, or its scenario or plan is not understood.

        """
        path = Path(path)
        summary, grants, count, ticks, whole = Summary(path), list[Record](), 0, 0, 0
        for record in read(path, summary):
            count += 1
            if record.topic == DIGEST:
                ticks, whole = ticks + 1, count
            elif record.topic == CLOCK and _announces(record):
                grants.append(record)
        about = run_metadata_of(path, summary.metadata)
        try:
            plan = last_plan(about.scenario, grants, lenient=lenient)
        except ValueError as error:
            raise not_understood(path, summary.metadata["run"], error) from error
        if not lenient:
            check_plan(path, about, plan)
        damage = _damage(about, whole=summary.complete)
        cut = bool(damage) and not about.realtime
        records = _LogRecords(path, whole if cut else count)
        return cls(about, plan, records, ticks, damage, path, summary.foreign, summary.unknown)

    @classmethod
    def of_records(
        cls,
        scenario: Scenario,
        records: Iterable[Record],
        *,
        plan: tuple[Rule, ...] | None = None,
        complete: bool = True,
        realtime: bool = False,
        digest: str = "",
    ) -> RecordedRun:
        """A run in memory, as of a `RunRecorder` that writes into `RecordCollector`."""
        status = "complete" if complete else ""
        clock = ClockMode.REALTIME if realtime else ClockMode.LOCKSTEP
        about = RunMetadata(scenario=scenario, clock=clock, status=status, digest=digest)
        plan = scenario.fault if plan is None else plan
        return cls(about, plan, records, damage=_damage(about, whole=True))

    def participant_filter(self) -> ParticipantFilter:
        """What tells which messages can be of this run."""
        return ParticipantFilter(self.scenario, frozenset(one.kind for one in self.unknown))

    @property
    def scenario(self) -> Scenario:
        """What was flown, with the fault plan at its start."""
        return self.about.scenario

    @property
    def complete(self) -> bool:
        """Whether the run was completed and its log is whole."""
        return not self.damage

    @property
    def realtime(self) -> bool:
        """Whether it was flown on wall clocks."""
        return self.about.realtime

    @property
    def digest(self) -> str:
        """The digest that the run itself stated at its end; empty if it did not."""
        return self.about.digest or ""

    def __repr__(self) -> str:
        state = self.damage or f"digest {self.digest}"
        return f"<run {self.scenario.name}: {self.ticks} ticks, {state}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        s = self.scenario
        uavs = [uav.id for uav in uavs_of(s)]
        plan = [rule.words(when=True) for rule in self.plan]
        return facts_html(
            {
                "run of": f"{s.name}: {s.description}" if s.description else s.name,
                "UAVs": ", ".join(map(str, uavs[:20])) + (" ..." if len(uavs) > 20 else ""),
                "time": f"{s.duration_s:g} s, {self.about.clock}, {self.ticks} ticks on record",
                "faults": "; ".join(plan) or "none",
                "record": self.damage or "complete",
                "digest": self.digest,
            }
        )

    def plot(self, figure: str = "plan") -> Any:
        """A Matplotlib figure: plan, separation, pairs, commands, trajectories or candidates.

        Raises:
            ArgumentError: there is no such figure. MissingExtraError: Matplotlib is not installed.
            LogError: there is nothing to draw.
        """
        import_extra("matplotlib", "report", "a figure")
        return import_module("fleet.report.paper_figure").figure_of(self, figure)

    def animate(self, speed: float = 10.0) -> Any:
        """The plan view as it moves, at so many times real time; a notebook shows what it returns.

        Its `html` is a page of its own, which asks nothing of the network.

        Raises:
            ArgumentError: the speed is not above 0.
        """
        require(speed, Real, "speed", "a number")
        if not speed > 0.0:
            raise ArgumentError(f"speed: {speed} is not above 0")
        return import_module("fleet.live.animation").animated(self, speed)

    @cached_property
    def log(self) -> Log:
        """All that is good of the log, also after the first damage; raises LogError without one."""
        if self.path is None:
            raise LogError("this run has no log")
        return Log(self.path)

    def __getitem__(self, topic: str) -> Columns:
        """All messages of a topic of the log as columns; raises LogError as `Log.columns` does."""
        return self.log[topic]

    def messages(self) -> Iterator[Message | Clock]:
        """Every message that can be of this run, decoded, in order of the log."""
        participant_filter = self.participant_filter()
        for record in self.records:
            clock = record.topic == CLOCK
            read_one = participant_filter.clock if clock else participant_filter.decode
            message = read_one(record)
            if message is not None:
                yield message

    def in_memory(self) -> RecordedRun:
        """The same with all records kept, for who goes through them several times."""
        kept = isinstance(self.records, Sequence)
        return self if kept else replace(self, records=list(self.records))


@dataclass(frozen=True)
class _LogRecords:
    """The first so many records of a log, read anew each time.

    Of a lockstep run that was cut those are the ones up to the last digest: the tick after it may
    have been cut in two. What the simulation refused it recorded at once: that is all taken.
    """

    path: Path
    whole: int

    def __iter__(self) -> Iterator[Record]:
        yield from whole_records(read(self.path), self.whole)


def whole_records(records: Iterable[Record], whole: int) -> Iterator[Record]:
    """The first so many, and after them what was refused."""
    return (r for n, r in enumerate(records) if n < whole or r.topic == REJECTED)


def last_plan(
    scenario: Scenario, grants: Iterable[Record], *, lenient: bool = False
) -> tuple[Rule, ...]:
    """The fault plan in force at the end: the scenario's, or the last that the clock announced.

    Raises:
        ValueError: an announced plan is not understood, and not passed over (`lenient`).

    """
    plan, participant_filter = scenario.fault, ParticipantFilter(scenario)
    for record in grants:
        clock = participant_filter.clock(record)
        try:
            plan = plan_of(clock.plan) if clock is not None and clock.plan else plan
        except ValueError:
            if not lenient:
                raise
    return plan


def _announces(grant: Record) -> bool:
    try:
        return bool(decode_clock(grant.payload).plan)
    except ValueError:
        return False


def _damage(about: RunMetadata, *, whole: bool) -> str:
    """What is wrong with a log or its run, in words; empty if nothing is."""
    if not whole:
        return "This log is damaged or cut short."
    if about.status == "complete":
        return ""
    if not about.status:
        return "The recorder was stopped before the end of the run."
    return f"The run is {about.status}{f' ({about.why})' if about.why else ''}."


def run_from(source: RecordedRun | str | PathLike[str], where: str) -> RecordedRun:
    """A run as it is given to `where`: itself, or by the path of its log.

    Raises:
        LogError: as `open_log`. ArgumentError: it is neither.

    """
    if isinstance(source, RecordedRun):
        return source
    return RecordedRun.of_log(path_of(source, where, "a run, or the path of its log"))


def open_log(path: str | PathLike[str]) -> RecordedRun:
    """The run that a log tells of: `fleet.open_log("run.mcap")`.

    The log is read through once and verified, and nothing of it is kept. `run["1/truth"]` are the
    messages of a topic as columns, `run.messages()` all of them; times in ns of simulated time.

    Raises:
        LogError: it cannot be read, is no fleet log, or its scenario or plan is not understood.
        ArgumentError: it is no path.

    """
    return RecordedRun.of_log(path_of(path, "open_log", "the path of a log"))
