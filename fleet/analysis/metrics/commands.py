"""Commands, and the rounds that issued them: what came of them, how fast, on how old a state."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np

from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.results import CommandMetrics, CommandRow, Spread
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_s
from fleet.protocol.messages import Ack, Command, StateBroadcast

KnowledgeKey = tuple[int, int, int]
"""Identity of a command: term, issuer, number."""

APPLIED, REFUSED, UNANSWERED = "applied", "refused", "unanswered"


def measure_commands(data: RunArrays) -> CommandMetrics:
    """All commands of a run."""
    sent: defaultdict[KnowledgeKey, list[Command]] = defaultdict(list)
    answers: defaultdict[KnowledgeKey, list[Ack]] = defaultdict(list)
    for command in data.commands:
        sent[command.term, command.id, command.number].append(command)
    for ack in data.acks:
        answers[ack.term, ack.target, ack.number].append(ack)
    known = Knowledge(data)
    rows = tuple(_row(key, told, answers[key], known) for key, told in sent.items())
    reasons = Counter(ack.reason for ack in data.acks if not ack.accepted)
    duplicates = reasons.pop("duplicate", 0)
    outcomes = Counter(row.outcome for row in rows)
    encounters = [(d, e) for d in data.decisions for e in d.encounters]
    ages = [known.age_s(d.id, e.target, d.t_ns, d.seq // INCARNATION) for d, e in encounters]
    return CommandMetrics(
        len(rows),
        len(data.commands),
        outcomes[APPLIED],
        outcomes[UNANSWERED],
        duplicates,
        reasons.total(),
        dict(sorted(reasons.items())),
        Spread.of(row.latency_s for row in rows if row.latency_s is not None),
        len(data.decisions),
        len({(d.term, e.target) for d, e in encounters if e.unresolved}),
        Spread.of(age for age in ages if age is not None),
        tuple(sorted(rows, key=lambda r: (r.issued_s, r.issuer, r.number))),
    )


def _row(
    key: KnowledgeKey, told: list[Command], answers: list[Ack], known: Knowledge
) -> CommandRow:
    first = min(told, key=lambda command: command.t_ns)
    accepted = [ack for ack in answers if ack.accepted]
    refusals = [ack.reason for ack in answers if not ack.accepted and ack.reason != "duplicate"]
    outcome = APPLIED if accepted else REFUSED if refusals else UNANSWERED
    latency_s = to_s(accepted[0].actuate_ns - first.t_ns) if accepted else None
    age_s = known.age_s(first.id, first.target, first.t_ns, first.seq // INCARNATION)
    return CommandRow(
        *key,
        first.target,
        first.manoeuvre,
        to_s(first.t_ns),
        len(told),
        outcome,
        refusals[-1] if refusals and not accepted else "",
        latency_s,
        age_s,
    )


class Knowledge:
    """What each participant had heard of each UAV's state, and how old that was."""

    def __init__(self, data: RunArrays) -> None:
        """Broadcasts that were received and believed."""
        self._heard: dict[KnowledgeKey, tuple[Ints, Ints]] = {}
        believed = [data.code("received"), data.code("altered")]
        for receiver in {command.id for command in data.commands} | {d.id for d in data.decisions}:
            r = data.receipts.get(receiver)
            if r is None:
                continue
            good = (r.kind == data.code(StateBroadcast.kind)) & np.isin(r.fate, believed)
            for src in np.unique(r.src[good]).tolist():
                for incarnation in np.unique(r.incarnation[good]).tolist():
                    own = good & (r.src == src) & (r.incarnation == incarnation)
                    newest_ns = np.maximum.accumulate(r.sent_ns[own])
                    self._heard[receiver, src, incarnation] = r.step_ns[own], newest_ns

    def age_s(self, receiver: int, uav: int, t_ns: int, incarnation: int) -> float | None:
        """Age at a step of the newest broadcast heard of a UAV; None of oneself, or if none."""
        step_ns, newest_ns = self._heard.get((receiver, uav, incarnation), (None, None))
        if step_ns is None or newest_ns is None:
            return None
        count = int(np.searchsorted(step_ns, t_ns, side="right"))
        return to_s(t_ns - int(newest_ns[count - 1])) if count else None
