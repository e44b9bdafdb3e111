"""What happened in a run, as bars and moments on named rows: the timeline, and the list of events.

Rows are pairs at risk, computing UAVs, UAVs under command, and faults; times in s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import msgspec

from fleet.comms.messages import COORDINATOR, Ack, Cmd, Conflict, Decision, Election
from fleet.model.faults.plan import FaultRule
from fleet.model.groups import Pair
from fleet.model.tracks import CLIMBING, TURNING
from fleet.model.units import to_s
from fleet.report.curves import Interval, climb_words, flown_commands, speed_words
from fleet.report.risk import Risk
from fleet.report.story import Story

MOST_PAIRS = 20
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
class Moment:
    """Something that happened at once, at a process; `row` is where the timeline has it."""

    row: str
    time_s: float
    process: int
    kind: str
    text: str


@dataclass
class Timeline:
    """Rows from top to bottom, with what is on them."""

    rows: list[str] = field(default_factory=list)
    bars: list[Bar] = field(default_factory=list)
    moments: list[Moment] = field(default_factory=list)
    left_out: int = 0

    def add(self, bar: Bar) -> None:
        """Put a bar on its row."""
        self._row(bar.row)
        self.bars.append(bar)

    def mark(self, moment: Moment) -> None:
        """Put a moment on its row."""
        self._row(moment.row)
        self.moments.append(moment)

    def _row(self, name: str) -> None:
        if name not in self.rows:
            self.rows.append(name)


def name_of(process: int) -> str:
    """How a process is called."""
    return "coordinator" if process == COORDINATOR else f"UAV {process}"


def timeline_of(story: Story, risks: Mapping[Pair, Risk]) -> Timeline:
    """All that is worth a mark, in order of rows, then of time."""
    out = Timeline()
    found = pairs_at_risk(story, risks)
    for (a, b), spans in list(found.items())[:MOST_PAIRS]:
        for start, end in spans:
            text = f"{a}\N{EN DASH}{b} at risk"
            out.add(Bar(f"at risk: {a}\N{EN DASH}{b}", start, end, "risk", text))
    out.left_out = max(0, len(found) - MOST_PAIRS)
    for bar in mandates(story):
        out.add(bar)
    commanded = Timeline()
    for flown in flown_commands(story):
        text = f"{flown.words}, told by UAV {flown.command[1]} in term {flown.command[0]}"
        row = name_of(flown.uav)
        span = flown.start_s, flown.end_s
        commanded.add(Bar(row, *span, "command", text, flown.uav, flown.words))
    for moment in (*_commands(story), *_answers(story), *_unresolved(story)):
        commanded.mark(moment)
    out.rows += sorted(commanded.rows, key=lambda r: int(r.split()[1]))
    out.bars += commanded.bars
    out.moments += commanded.moments
    for bar in (*_faults(story), *_absences(story)):
        out.add(bar)
    return out


def pairs_at_risk(story: Story, risks: Mapping[Pair, Risk]) -> dict[Pair, list[Interval]]:
    """When which pair was at risk, as the coordinator had it; without one, from true states."""
    logged = story.of(Conflict)
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
        out.setdefault(pair, []).append((start, story.end_s))
    return dict(sorted(out.items(), key=lambda item: (item[1][0], item[0])))


def mandates(story: Story) -> list[Bar]:
    """Each term: from its first announcement until it runs out or a later one names its members."""
    longest_s = story.scenario.coordination.election_valid_s
    terms: dict[int, list[Election]] = {}
    for election in story.of(Election):
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
        end = max(start, min(end, story.end_s, *[t for t in later if t > last]))
        computing = said[0].computing
        named = ", ".join(map(str, said[0].members))
        text = f"term {term}: UAV {computing} computes for {named}, by {name_of(said[0].id)}"
        out.append(
            Bar(f"UAV {computing} computes", start, end, "mandate", text, computing, f"term {term}")
        )
    return sorted(out, key=lambda bar: (int(bar.row.split()[1]), bar.start_s))


def _commands(story: Story) -> Iterable[Moment]:
    seen: set[tuple[int, int, int]] = set()
    for cmd in story.of(Cmd):
        key = (cmd.term, cmd.id, cmd.number)
        kind = "repeated" if key in seen else "command"
        seen.add(key)
        text = f"UAV {cmd.id} tells UAV {cmd.target}: {command_words(cmd)} (term {cmd.term})"
        yield Moment(name_of(cmd.target), to_s(cmd.t_ns), cmd.id, kind, text)


def command_words(cmd: Cmd) -> str:
    """As in `turn to 300°`, `dive 2 m/s` or `speed 21 m/s`."""
    parts = []
    if cmd.manoeuvre in TURNING:
        parts.append(f"turn to {math.degrees(cmd.heading_rad) % 360.0:.0f}°")
    if cmd.manoeuvre in CLIMBING:
        parts.append(climb_words(cmd.climb_mps))
    if cmd.speed_mps is not None:
        parts.append(speed_words(cmd.speed_mps))
    return ", ".join(parts) or cmd.manoeuvre


def _answers(story: Story) -> Iterable[Moment]:
    for ack in story.of(Ack):
        kind = "accepted" if ack.accepted else "refused"
        if ack.reason == "duplicate":
            kind = "duplicate"
        why = f" ({ack.reason.replace('_', ' ')})" if ack.reason else ""
        text = f"UAV {ack.id} to UAV {ack.target}: {kind}{why if kind == 'refused' else ''}"
        yield Moment(name_of(ack.id), to_s(ack.t_ns), ack.id, kind, text)


def _unresolved(story: Story) -> Iterable[Moment]:
    for decision in story.of(Decision):
        for e in decision.encounters:
            if e.unresolved:
                text = f"UAV {decision.id} finds no safe option for UAV {e.target}"
                yield Moment(
                    name_of(e.target), to_s(decision.t_ns), decision.id, "unresolved", text
                )


def fault_words(rule: FaultRule) -> str:
    """A rule of the fault plan without what is as by default, as in `loss probability=0.3`."""
    given = [
        f"{f.encode_name}={value:g}" if isinstance(value, float) else f"{f.encode_name}={value}"
        for f in msgspec.structs.fields(rule)
        if (value := getattr(rule, f.name)) != f.default and f.name not in ("start_s", "end_s")
    ]
    return " ".join([rule.name, *given])


def _faults(story: Story) -> Iterable[Bar]:
    for rule in story.plan:
        end_s = story.end_s if rule.end_s is None else min(rule.end_s, story.end_s)
        if rule.start_s < end_s:
            text = fault_words(rule)
            yield Bar(f"fault: {text}", rule.start_s, end_s, "fault", text)


def _absences(story: Story) -> Iterable[Bar]:
    for (process, how), spans in sorted(story.absences.items()):
        for start, end in spans:
            name = name_of(process)
            yield Bar(f"{name} {how}", start, end, "absent", f"{name} is {how}")


def told_in_order(timeline: Timeline) -> list[Moment]:
    """Everything as moments, in order of time: what the list of events shows."""
    out = list(timeline.moments)
    for bar in timeline.bars:
        process = COORDINATOR if bar.uav is None else bar.uav
        text = f"UAV {bar.uav} flies {bar.text}" if bar.kind == "command" else bar.text
        out.append(Moment(bar.row, bar.start_s, process, bar.kind, f"begins: {text}"))
        out.append(Moment(bar.row, bar.end_s, process, bar.kind, f"ends: {text}"))
    return sorted(out, key=lambda m: m.time_s)
