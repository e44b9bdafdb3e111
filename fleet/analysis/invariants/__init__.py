"""The protocol's invariants, checked from what a run left behind (docs/invariants.md).

`check(RecordedRun.of_log(path))` judges a log; a run in memory is judged without a file, from a
`RunRecorder` that writes into `RecordCollector`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from os import PathLike

from fleet.analysis.invariants.accounting import answers, losses, name, receipts
from fleet.analysis.invariants.applied import plan_applied
from fleet.analysis.invariants.authorship import authors
from fleet.analysis.invariants.belief import plausibility
from fleet.analysis.invariants.commanding import mandated, repeated_in_need
from fleet.analysis.invariants.commands import (
    in_time,
    issuer,
    once,
    own_group,
    repetitions,
    stale_terms,
)
from fleet.analysis.invariants.eligibility import computing_is_lowest, elected_in_need
from fleet.analysis.invariants.fates import fates_of
from fleet.analysis.invariants.flight import flown_as_commanded
from fleet.analysis.invariants.grouping import grouped
from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.leaders import one_leader, terms_rise
from fleet.analysis.invariants.presence import processes
from fleet.analysis.invariants.record import record_intact
from fleet.analysis.invariants.recovery import leader_again, recovery_limit_s
from fleet.analysis.invariants.refusals import refusals
from fleet.analysis.invariants.sensing import clocks, positions
from fleet.analysis.invariants.verdict import (
    Examination,
    InvariantResult,
    Verdict,
    Verdicts,
    Witness,
    worst,
)
from fleet.analysis.invariants.views import views_of
from fleet.analysis.recorded_run import RecordCollector, RecordedRun, run_from
from fleet.protocol.topics import topic_of

__all__ = (
    "InvariantResult",
    "RecordCollector",
    "RecordedRun",
    "Verdict",
    "Verdicts",
    "Witness",
    "check",
    "recovery_limit_s",
    "worst",
)


OF_EVERY_CLASS = frozenset({"received was sent", "nothing lost silently", "fault plan applied"})
"""Invariants that are about all messages on links, of whatever class."""


NOT_OF_OTHERS = frozenset({"sent by its issuer", "one leader a term"})
"""Invariants that no message which is missing can excuse."""


def _not_known(run: RecordedRun) -> str:
    """Which classes of a log this fleet lacks."""
    names = [f"'{one.kind}'" for one in run.unknown]
    if len(names) == 1:
        return f"message class {names[0]} is not known here"
    return f"message classes {', '.join(names)} are not known here"


def check(source: RecordedRun | str | PathLike[str]) -> Verdicts:
    """Judge a run, or that of a log: whether it was faithful to the protocol, as far as it tells.

    Raises:
        LogError: the log cannot be read. ArgumentError: it is neither a run nor a path.

    """
    run = run_from(source, "check")
    index = Index(run.in_memory(), fates_of)
    clocks = index.wall_clocks
    verdicts = _judged(run, index)
    if clocks.degraded and verdicts.overall is Verdict.VALID:
        why = "wall clocks were more than a tick apart, so that times told do not fit together"
        verdicts = replace(verdicts, overall=Verdict.UNKNOWN, why=why)
    return replace(verdicts, warning=clocks.words())


def _judged(run: RecordedRun, index: Index) -> Verdicts:
    """The verdicts, whatever the wall clocks showed."""
    found = (_finding(*one, run) for one in _all(index))
    findings = tuple(_where_sent(index, finding) for finding in found)
    if index.missing:
        findings = tuple(_as_far_as_told(index, finding) for finding in findings)
    if any(f.verdict is Verdict.INVALID for f in findings):
        return Verdicts(Verdict.INVALID, "", findings)
    if not run.complete:
        return Verdicts(
            Verdict.UNKNOWN, "the run was not completed, or its log is cut short", findings
        )
    if run.unknown:
        return Verdicts(Verdict.UNKNOWN, _not_known(run), findings)
    if not index.elections and not index.commands:
        return Verdicts(Verdict.UNKNOWN, "there was no election and no command", findings)
    return Verdicts(Verdict.VALID, "", findings)


def _all(index: Index) -> Iterator[tuple[str, str, Examination]]:
    """Every invariant: its name, what it examines, and what it found."""
    views = views_of(index)
    yield "one leader a term", "announcements", one_leader(index)
    yield "terms rise", "announcements", terms_rise(index)
    yield "lowest eligible leads", "announcements", computing_is_lowest(index)
    yield "groups belong together", "elections by the coordinator", grouped(index)
    yield "UAVs elect in need", "elections by UAVs", elected_in_need(index)
    yield "commanded by mandate", "commands", mandated(index, views)
    yield "newest term obeyed", "commands obeyed", stale_terms(views)
    yield "issuer computes", "commands obeyed", issuer(views)
    yield "own group obeyed", "commands obeyed", own_group(views)
    yield "obeyed in time", "commands obeyed", in_time(views)
    yield "obeyed once, in order", "commands obeyed", once(views)
    yield "refused for a reason", "commands refused", refusals(index, views)
    yield "flown as obeyed", "true states", flown_as_commanded(index, views)
    yield "repetitions identical", "commands repeated", repetitions(index)
    yield "repeated in need", "commands repeated", repeated_in_need(index)
    yield "received was sent", "receipts", receipts(index)
    yield "nothing lost silently", "messages on links", losses(index)
    yield "fault plan applied", "receipts under faults", plan_applied(index)
    yield "answers have commands", "answers", answers(views)
    yield "processes as planned", "ticks", processes(index)
    yield "positions as sensed", "broadcasts", positions(index)
    yield "clocks as planned", "times told", clocks(index)
    yield "only plausible believed", "broadcasts", plausibility(index)
    yield "a leader again", "pairs in conflict", leader_again(index, views)
    yield "sent by its issuer", "messages", authors(index)
    yield "record intact", "ticks", record_intact(index)


def _as_far_as_told(index: Index, finding: InvariantResult) -> InvariantResult:
    """After an outage that cost messages: what seems wrong may have its reason among them."""
    if finding.verdict is not Verdict.INVALID or finding.name in NOT_OF_OTHERS:
        return finding
    lacking = ", ".join(f"{count} of {name(node)}" for node, count in index.missing.items())
    why = f"messages are missing after outages: {lacking}"
    return replace(finding, verdict=Verdict.UNKNOWN, why=why, violations=0, witnesses=())


def _where_sent(index: Index, finding: InvariantResult) -> InvariantResult:
    """With cells: what is shown has the topic on which it is in the log."""
    if not finding.witnesses or index.scenario.cells() is None:
        return finding
    sent = {(topic_of(s.message), s.message.t_ns): s.topic for s in index.sent.values()}
    return replace(
        finding,
        witnesses=tuple(
            replace(one, topic=sent.get((one.topic, one.t_ns), one.topic))
            for one in finding.witnesses
        ),
    )


def _finding(title: str, of: str, examination: Examination, run: RecordedRun) -> InvariantResult:
    if examination.violations:
        first, count = examination.violations[0], len(examination.violations)
        witnesses = first.witnesses
        return InvariantResult(
            title, Verdict.INVALID, examination.examined, of, first.what, count, witnesses
        )
    why = examination.unknown or ("" if examination.examined else f"no {of}")
    if not why and not run.complete:
        why = "cut short"
    if not why and run.unknown and title in OF_EVERY_CLASS:
        why = _not_known(run)
    return InvariantResult(
        title, Verdict.UNKNOWN if why else Verdict.VALID, examination.examined, of, why
    )
