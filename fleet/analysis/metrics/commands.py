"""Commands, and the rounds that issued them: what came of them, how fast, on how old a state."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from fleet.analysis.metrics.data import RunArrays
from fleet.analysis.metrics.definition import Compared, MetricOf, MetricRow, Shown, metric_row
from fleet.analysis.metrics.knowledge import Knowledge
from fleet.analysis.metrics.values import Spread
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_s
from fleet.protocol.messages import Ack, Command

_Key = tuple[int, int, int]
"""Identity of a command: term, issuer, number."""

APPLIED, REFUSED, UNANSWERED = "applied", "refused", "unanswered"

DUPLICATE = "duplicate"
"""The refusal of a repetition of what is applied."""


@dataclass(frozen=True)
class CommandOnRecord:
    """One command: what its metrics are computed from. All `sent` are the same one."""

    data: RunArrays
    known: Knowledge
    sent: Sequence[Command]
    answers: Sequence[Ack]

    @property
    def first(self) -> Command:
        """Its first transmission."""
        return min(self.sent, key=lambda command: command.t_ns)

    @property
    def refusals(self) -> list[str]:
        """Why it was refused."""
        reasons = [ack.reason for ack in self.answers if not ack.accepted]
        return [reason for reason in reasons if reason != DUPLICATE]

    @property
    def acceptance(self) -> Ack | None:
        """The first."""
        return next((ack for ack in self.answers if ack.accepted), None)

    @property
    def outcome(self) -> str:
        """What came of it."""
        return APPLIED if self.acceptance else REFUSED if self.refusals else UNANSWERED

    @property
    def latency_s(self) -> float | None:
        """From its issue to its actuation."""
        return to_s(self.acceptance.actuate_ns - self.first.t_ns) if self.acceptance else None

    @property
    def state_age_s(self) -> float | None:
        """How old the newest state was that the issuer knew of the target."""
        first = self.first
        return self.known.age_s(first.id, first.target, first.t_ns, first.seq // INCARNATION)


command_metric = MetricOf[CommandOnRecord]()


@metric_row
class CommandRow(MetricRow[CommandOnRecord]):
    """One command, with all its repetitions and answers."""

    term: int = command_metric(
        "-",
        "its term",
        lambda command: command.first.term,
        source="docs/protocol, Command",
    )
    issuer: int = command_metric(
        "-",
        "the computing UAV",
        lambda command: command.first.id,
        source="docs/protocol, Command",
    )
    number: int = command_metric(
        "-",
        "its number",
        lambda command: command.first.number,
        source="docs/protocol, Command",
    )
    target: int = command_metric(
        "-",
        "the UAV commanded",
        lambda command: command.first.target,
        source="docs/protocol, Command",
    )
    manoeuvre: str = command_metric(
        "-",
        "turn, climb, turn_climb, speed or resume",
        lambda command: command.first.manoeuvre,
        source="docs/protocol, Command",
    )
    issued_s: float = command_metric(
        "s",
        "true time of the first transmission",
        lambda command: to_s(command.first.t_ns),
        symbol="t_I",
    )
    transmissions: int = command_metric(
        "1",
        "messages that carried it",
        lambda command: len(command.sent),
    )
    outcome: str = command_metric(
        "-",
        "applied, refused (and never accepted) or unanswered",
        lambda command: command.outcome,
    )
    reason: str = command_metric(
        "-",
        "of one that is refused: the last reason",
        lambda command: command.refusals[-1] if command.outcome == REFUSED else "",
        source="docs/protocol, Refusals",
    )
    latency_s: float | None = command_metric(
        "s",
        "issue to actuation, t_act - t_I: from the first transmission to the moment from "
        "which it was to be flown (`actuate_ns` of the acceptance). At least "
        "`commands.lead_s` where clocks are right",
        lambda command: command.latency_s,
        symbol="L",
    )
    state_age_s: float | None = command_metric(
        "s",
        "state age at decision, t_I - t_sent of the newest broadcast of the target that the "
        "issuer had received and believed in this incarnation; blank for its own commands",
        lambda command: command.state_age_s,
        symbol="A",
    )


@dataclass(frozen=True)
class CommandsOnRecord:
    """All commands of a run: what their metrics are computed from."""

    data: RunArrays
    known: Knowledge
    rows: tuple[CommandRow, ...]

    @cached_property
    def outcomes(self) -> Counter[str]:
        """How many came to what."""
        return Counter(row.outcome for row in self.rows)

    @cached_property
    def reasons(self) -> Counter[str]:
        """All answers that accept nothing, by their reason."""
        return Counter(ack.reason for ack in self.data.acks if not ack.accepted)

    @property
    def refusals(self) -> dict[str, int]:
        """These, but for repetitions of what is applied."""
        return {reason: n for reason, n in sorted(self.reasons.items()) if reason != DUPLICATE}

    @property
    def unresolved(self) -> int:
        """Encounters without a solution, each once in a term."""
        found = {
            (d.term, e.target) for d in self.data.decisions for e in d.encounters if e.unresolved
        }
        return len(found)

    @property
    def state_ages_s(self) -> list[float]:
        """How old the newest state of each UAV was that a decision was about."""
        ages = [
            self.known.age_s(d.id, e.target, d.t_ns, d.seq // INCARNATION)
            for d in self.data.decisions
            for e in d.encounters
        ]
        return [age for age in ages if age is not None]


def _issued_text(row: CommandMetrics) -> str:
    return (
        f"{row.issued} issued ({row.transmissions} transmissions), {row.applied} applied, "
        f"{row.unanswered} unanswered"
    )


def _refused_text(row: CommandMetrics) -> str:
    reasons = ", ".join(f"{reason} {n}" for reason, n in row.refused_by_reason.items())
    return f"{row.refused}" + (f" ({reasons})" if reasons else "")


commands_metric = MetricOf[CommandsOnRecord]()


@metric_row
class CommandMetrics(MetricRow[CommandsOnRecord]):
    """All commands of a run."""

    issued: int = commands_metric(
        "1",
        "commands",
        lambda run: len(run.rows),
        source="docs/protocol, Command",
        shown=Shown("commands", _issued_text),
        compared=Compared("commands_issued"),
    )
    transmissions: int = commands_metric(
        "1",
        "messages that carried them",
        lambda run: len(run.data.commands),
        source="docs/protocol, Command",
    )
    applied: int = commands_metric(
        "1",
        "commands that were accepted",
        lambda run: run.outcomes[APPLIED],
        source="docs/protocol, Ack",
        compared=Compared("commands_applied"),
    )
    unanswered: int = commands_metric(
        "1",
        "commands with neither an acceptance nor a refusal on record",
        lambda run: run.outcomes[UNANSWERED],
        compared=Compared("commands_unanswered"),
    )
    duplicates: int = commands_metric(
        "1",
        'answers "duplicate": a repetition came though the command was applied',
        lambda run: run.reasons[DUPLICATE],
        source="docs/protocol, Refusals",
    )
    refused: int = commands_metric(
        "1",
        "other refusals, each answer counted",
        lambda run: sum(run.refusals.values()),
        source="docs/protocol, Refusals",
        shown=Shown("refused", _refused_text),
        compared=Compared("commands_refused"),
    )
    refused_by_reason: dict[str, int] = commands_metric(
        "1",
        "these by reason",
        lambda run: run.refusals,
        source="docs/protocol, Refusals",
    )
    latency_s: Spread = commands_metric(
        "s",
        "[Spread](#spread) of the latency of applied commands",
        lambda run: Spread.of(row.latency_s for row in run.rows if row.latency_s is not None),
        symbol="L",
        shown=Shown("issue to actuation"),
        compared=Compared(
            "command_latency_s", lambda spread: {"p50": spread.p50, "max": spread.max}
        ),
    )
    rounds: int = commands_metric(
        "1",
        "rounds of the resolver that decided something new: `decision` messages",
        lambda run: len(run.data.decisions),
        source="docs/protocol, Decision",
    )
    unresolved: int = commands_metric(
        "1",
        "encounters for which a loss of separation was predicted whatever was done "
        "(`least_separation` below 1), one for each term and UAV",
        lambda run: run.unresolved,
        source="eq. 10 and 11; ours",
        shown=Shown("unresolved encounters"),
        compared=Compared(),
    )
    state_age_s: Spread = commands_metric(
        "s",
        "[Spread](#spread) of the state age over all encounters of all rounds but those of "
        "the computing UAV itself",
        lambda run: Spread.of(run.state_ages_s),
        symbol="A",
        shown=Shown("state age at decision"),
        compared=Compared(summary=lambda spread: {"mean": spread.mean}),
    )
    rows: tuple[CommandRow, ...] = commands_metric(
        "-",
        "each: [CommandRow](#commandrow)",
        lambda run: run.rows,
        source="-",
    )


def measure_commands(data: RunArrays) -> CommandMetrics:
    """All commands of a run."""
    sent: defaultdict[_Key, list[Command]] = defaultdict(list)
    answers: defaultdict[_Key, list[Ack]] = defaultdict(list)
    for command in data.commands:
        sent[command.term, command.id, command.number].append(command)
    for ack in data.acks:
        answers[ack.term, ack.target, ack.number].append(ack)
    known = Knowledge(data)
    rows = [CommandRow.of(CommandOnRecord(data, known, sent[key], answers[key])) for key in sent]
    rows.sort(key=lambda row: (row.issued_s, row.issuer, row.number))
    return CommandMetrics.of(CommandsOnRecord(data, known, tuple(rows)))
