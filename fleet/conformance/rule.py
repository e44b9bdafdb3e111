"""A rule of the protocol as the conformance test knows it: a name, a page, and who judges."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from fleet.conformance.evidence import Evidence
from fleet.model.words import ClockMode

Judge = Callable[[Evidence], Iterator[str]]
"""Yields what was seen against the rule; raises `NotTriedError` where nothing can be said."""

BOTH = frozenset(ClockMode)
LOCKSTEP = frozenset({ClockMode.LOCKSTEP})
REALTIME = frozenset({ClockMode.REALTIME})


class Outcome(StrEnum):
    """What a play says of a rule."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_TRIED = "not tried"


class NotTriedError(Exception):
    """The play did not come so far, or the UAV gave no occasion."""


@dataclass(frozen=True)
class ProtocolRule:
    """What the documents ask of a UAV; `page` is where, under docs/protocol."""

    name: str
    page: str
    clocks: frozenset[ClockMode]
    judge: Judge


@dataclass(frozen=True)
class RuleFinding:
    """What became of a rule on one clock, and what was seen if it is not kept."""

    name: str
    clock: ClockMode
    outcome: Outcome
    seen: str
    page: str


RULES: list[ProtocolRule] = []
"""All rules, in the order of the documents; the modules of `rules` enter theirs."""


def protocol_rule(
    name: str, page: str, clocks: frozenset[ClockMode] = BOTH
) -> Callable[[Judge], Judge]:
    """Enter a function as the judge of a rule."""

    def enter(judge: Judge) -> Judge:
        RULES.append(ProtocolRule(name, page, clocks, judge))
        return judge

    return enter


def judged(evidence: Evidence, rules: Iterable[ProtocolRule]) -> Iterator[RuleFinding]:
    """What the evidence says of each rule of its clock."""
    for rule in rules:
        if evidence.clock in rule.clocks:
            outcome, seen = _outcome(rule, evidence)
            yield RuleFinding(rule.name, evidence.clock, outcome, seen, rule.page)


def _outcome(rule: ProtocolRule, evidence: Evidence) -> tuple[Outcome, str]:
    if not evidence.heard:
        return Outcome.NOT_TRIED, "nothing came"
    try:
        breaches = [*rule.judge(evidence)]
    except NotTriedError as error:
        return Outcome.NOT_TRIED, str(error)
    if not breaches:
        return Outcome.KEPT, ""
    more = f" (and {len(breaches) - 1} more)" if breaches[1:] else ""
    return Outcome.BROKEN, f"{breaches[0]}{more}"
