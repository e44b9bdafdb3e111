"""What happened in a run, as bars and moments on named rows: the timeline, and the list of events.

Rows are pairs at risk, computing UAVs, UAVs under command, and faults; times in s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from fleet.model.types import COORDINATOR, Pair
from fleet.model.units import to_s
from fleet.model.words import CLIMBING, TURNING
from fleet.protocol.messages import Ack, Command, Conflict, Decision, Election
from fleet.report.curves import Interval, climb_words, flown_commands, speed_words
from fleet.report.risk import Risk
from fleet.report.run_data import RunData

PAIRS_IN_TIMELINE = 20
"""Rows for pairs at risk: those at risk first."""


@dataclass(frozen=True)
class Bar:
    """Something that lasts. `uav` gives its colour (None: none of them), `note` stands on it."""

    row: str
    start_s: float
    end_s: float
    kind: str
    text: str
    uav: int | None = None
    note: str = ""


@dataclass(frozen=True)
class EventMark:
    """Something that happened at once, at a process; `row` is where the timeline has it."""

    row: str
    time_s: float
    process: int
    kind: str
    text: str


@dataclass
class EventTimeline:
    """Rows from top to bottom, with what is on them."""

    rows: list[str] = field(default_factory=list)
    bars: list[Bar] = field(default_factory=list)
    moments: list[EventMark] = field(default_factory=list)
    left_out: int = 0

    def add(self, bar: Bar) -> None:
        """Put a bar on its row."""
        self._row(bar.row)
        self.bars.append(bar)

    def mark(self, moment: EventMark) -> None:
        """Put a moment on its row."""
        self._row(moment.row)
        self.moments.append(moment)

    def _row(self, name: str) -> None:
        if name not in self.rows:
            self.rows.append(name)


def name_of(process: int) -> str:
    """How a process is called."""
    return "coordinator" if process == COORDINATOR else f"UAV {process}"


def timeline_of(run_data: RunData, risks: Mapping[Pair, Risk]) -> EventTimeline:
    """All that is worth a mark, in order of rows, then of time."""
    out = EventTimeline()
    found = pairs_at_risk(run_data, risks)
    for (a, b), spans in list(found.items())[:PAIRS_IN_TIMELINE]:
        for start, end in spans:
            text = f"{a}\N{EN DASH}{b} at risk"
            out.add(Bar(f"at risk: {a}\N{EN DASH}{b}", start, end, "risk", text))
    out.left_out = max(0, len(found) - PAIRS_IN_TIMELINE)
    for bar in mandates(run_data):
        out.add(bar)
    commanded = EventTimeline()
    for flown in flown_commands(run_data):
        text = f"{flown.words}, told by UAV {flown.command_id[1]} in term {flown.command_id[0]}"
        row = name_of(flown.uav)
        span = flown.start_s, flown.end_s
        commanded.add(Bar(row, *span, "command", text, flown.uav, flown.words))
    for moment in (*_commands(run_data), *_answers(run_data), *_unresolved(run_data)):
        commanded.mark(moment)
    out.rows += sorted(commanded.rows, key=lambda r: int(r.split()[1]))
    out.bars += commanded.bars
    out.moments += commanded.moments
    for bar in (*_faults(run_data), *_absences(run_data)):
        out.add(bar)
    return out


def pairs_at_risk(run_data: RunData, risks: Mapping[Pair, Risk]) -> dict[Pair, list[Interval]]:
    """When which pair was at risk, as the coordinator had it; without one, from true states."""
    logged = run_data.of(Conflict)
    if not logged:
        return {pair: risk.planned for pair, risk in risks.items()}
    out: dict[Pair, list[Interval]] = {}
    since: dict[Pair, float] = {}
    for message in logged:
        now_s = to_s(message.t_ns)
        at_risk = {(a, b) for a, b in message.pairs}
        for pair in since.keys() - at_risk:
            out.setdefault(pair, []).append((since.pop(pair), now_s))
        for pair in sorted(at_risk - since.keys()):
            since[pair] = now_s
    for pair, start in since.items():
        out.setdefault(pair, []).append((start, run_data.end_s))
    return dict(sorted(out.items(), key=lambda item: (item[1][0], item[0])))


def mandates(run_data: RunData) -> list[Bar]:
    """Each term: from its first announcement until it runs out or a later one names its members."""
    longest_s = run_data.scenario.coordination.election_valid_s
    terms: dict[int, list[Election]] = {}
    for election in run_data.of(Election):
        terms.setdefault(election.term, []).append(election)
    out = []
    for term, said in terms.items():
        start, last = to_s(said[0].t_ns), to_s(said[-1].t_ns)
        # Said by the elector's own clock; but nobody holds a mandate for longer than this.
        end = last + min(to_s(said[-1].valid_until_ns) - last, longest_s)
        members = set(said[0].members)
        later = [
            to_s(first.t_ns)
            for first, *_ in terms.values()
            if first.t_ns > said[0].t_ns and members & set(first.members)
        ]
        end = max(start, min(end, run_data.end_s, *[t for t in later if t > last]))
        computing = said[0].computing
        named = ", ".join(map(str, said[0].members))
        text = f"term {term}: UAV {computing} computes for {named}, by {name_of(said[0].id)}"
        out.append(
            Bar(f"UAV {computing} computes", start, end, "mandate", text, computing, f"term {term}")
        )
    return sorted(out, key=lambda bar: (int(bar.row.split()[1]), bar.start_s))


def _commands(run_data: RunData) -> Iterable[EventMark]:
    seen: set[tuple[int, int, int]] = set()
    for command in run_data.of(Command):
        key = (command.term, command.id, command.number)
        kind = "repeated" if key in seen else "command"
        seen.add(key)
        told = one_command_words(command)
        text = f"UAV {command.id} tells UAV {command.target}: {told} (term {command.term})"
        yield EventMark(name_of(command.target), to_s(command.t_ns), command.id, kind, text)


def one_command_words(command: Command) -> str:
    """As in `turn to 300°`, `dive 2 m/s` or `speed 21 m/s`."""
    parts = []
    if command.manoeuvre in TURNING:
        parts.append(f"turn to {math.degrees(command.heading_rad) % 360.0:.0f}°")
    if command.manoeuvre in CLIMBING:
        parts.append(climb_words(command.climb_mps))
    if command.speed_mps is not None:
        parts.append(speed_words(command.speed_mps))
    return ", ".join(parts) or command.manoeuvre


def _answers(run_data: RunData) -> Iterable[EventMark]:
    for ack in run_data.of(Ack):
        kind = "accepted" if ack.accepted else "refused"
        if ack.reason == "duplicate":
            kind = "duplicate"
        why = f" ({ack.reason.replace('_', ' ')})" if ack.reason else ""
        text = f"UAV {ack.id} to UAV {ack.target}: {kind}{why if kind == 'refused' else ''}"
        yield EventMark(name_of(ack.id), to_s(ack.t_ns), ack.id, kind, text)


def _unresolved(run_data: RunData) -> Iterable[EventMark]:
    for decision in run_data.of(Decision):
        for e in decision.encounters:
            if e.unresolved:
                text = f"UAV {decision.id} leaves UAV {e.target} unresolved"
                yield EventMark(
                    name_of(e.target), to_s(decision.t_ns), decision.id, "unresolved", text
                )


def _faults(run_data: RunData) -> Iterable[Bar]:
    for rule in run_data.plan:
        end_s = run_data.end_s if rule.end_s is None else min(rule.end_s, run_data.end_s)
        if rule.start_s < end_s:
            text = rule.words()
            yield Bar(f"fault: {text}", rule.start_s, end_s, "fault", text)


def _absences(run_data: RunData) -> Iterable[Bar]:
    for (process, how), spans in sorted(run_data.absences.items()):
        for start, end in spans:
            name = name_of(process)
            yield Bar(f"{name} {how}", start, end, "absent", f"{name} is {how}")


def told_in_order(timeline: EventTimeline) -> list[EventMark]:
    """Everything as moments, in order of time: what the list of events shows."""
    out = list(timeline.moments)
    for bar in timeline.bars:
        process = COORDINATOR if bar.uav is None else bar.uav
        text = f"UAV {bar.uav} flies {bar.text}" if bar.kind == "command" else bar.text
        out.append(EventMark(bar.row, bar.start_s, process, bar.kind, f"begins: {text}"))
        out.append(EventMark(bar.row, bar.end_s, process, bar.kind, f"ends: {text}"))
    return sorted(out, key=lambda m: m.time_s)
