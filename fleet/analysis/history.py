"""What a run left behind, from a log or from memory: metrics and invariants begin with this."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fleet.analysis.participant_filter import ParticipantFilter
from fleet.config.scenario import Scenario
from fleet.faults.plan import FaultRule, plan_of
from fleet.log.reader import Record, Summary, read
from fleet.log.run_metadata import check_plan, not_understood, run_metadata_of
from fleet.protocol.topics import CLOCK, DIGEST, REJECTED


class RecordCollector:
    """A sink for `RunRecorder` that keeps what it is given."""

    def __init__(self) -> None:
        self.kept: list[Record] = []

    def write(self, topic: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Keep one message."""
        self.kept.append(Record(topic, payload, seq, sent_ns, log_ns))


@dataclass(frozen=True)
class History:
    """One run: what was flown, the fault plan at its end, and every message in order of the log.

    A plan that changes while the run is on only gains rules and ends some earlier, so that the last
    one tells the whole story. `digest` is the one that the run itself stated at its end, if any.
    """

    scenario: Scenario
    plan: tuple[FaultRule, ...]
    records: Sequence[Record]
    complete: bool = True
    realtime: bool = False
    digest: str = ""

    @classmethod
    def of_log(cls, path: Path) -> History:
        """The history that a log tells; raises LogError if it is not a fleet log."""
        summary = Summary(path)
        records = list(read(path, summary))
        about = run_metadata_of(path, summary.metadata)
        try:
            plan = last_plan(about.scenario, records)
        except ValueError as error:
            raise not_understood(path, summary.metadata["run"], error) from error
        check_plan(path, about, plan)
        complete = summary.complete and about.status == "complete"
        if not complete and not about.realtime:
            records = whole_ticks(records)
        return cls(about.scenario, plan, records, complete, about.realtime, about.digest or "")


def whole_ticks(records: list[Record]) -> list[Record]:
    """What was recorded up to the last digest: the tick after it may have been cut in two.

    What the simulation refused it recorded at once.
    """
    last = max((n for n, r in enumerate(records) if r.topic == DIGEST), default=-1)
    return records[: last + 1] + [r for r in records[last + 1 :] if r.topic == REJECTED]


def last_plan(scenario: Scenario, records: Sequence[Record]) -> tuple[FaultRule, ...]:
    """The fault plan in force at the end: the scenario's, or the last that the clock announced.

    Raises:
        ValueError: an announced plan is not understood.

    """
    plan, participant_filter = scenario.fault, ParticipantFilter(scenario)
    for record in records:
        clock = participant_filter.clock(record) if record.topic == CLOCK else None
        if clock is not None and clock.plan:
            plan = plan_of(clock.plan)
    return plan
