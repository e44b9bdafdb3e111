"""What happened, a line of text each: elections, commands, refusals, faults, lost separation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from fleet.analysis.separation import PairCurve
from fleet.export.scene import Scene
from fleet.faults.rules import Rule
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns, to_s
from fleet.model.words import CLIMBING, TURNING, ClockState
from fleet.protocol.messages import Ack, Clock, Command, Decision, Election, Message
from fleet.protocol.topics import issuer_name


class LineLevel(IntEnum):
    """How much a line matters; the numbers are those of foxglove.Log."""

    INFO = 2
    WARNING = 3
    ERROR = 4


class Line(NamedTuple):
    """One line: simulated time, how much it matters, whose it is, and what it says."""

    t_ns: int
    level: LineLevel
    who: str
    text: str


def lines_of(messages: Iterable[Message | Clock], plan: Sequence[Rule], scene: Scene) -> list[Line]:
    """All lines of a run in order of time."""
    lines = [line for rule in plan for line in _fault(rule)]
    lines += _said(messages)
    lines += [line for pair in scene.pairs for line in _losses(pair)]
    return sorted((line for line in lines if line.t_ns <= scene.end_ns), key=lambda x: x.t_ns)


def _said(messages: Iterable[Message | Clock]) -> Iterator[Line]:
    """What messages tell; repetitions of an election or a command are not told again."""
    told: set[tuple[object, ...]] = set()
    absent: dict[int, str] = {}
    for message in messages:
        if isinstance(message, Clock):
            if message.state not in (ClockState.RUN, ClockState.PLAN):
                continue
            now = dict.fromkeys(message.held, "stopped") | dict.fromkeys(message.down, "down")
            yield from _processes(message.t_ns, absent, now)
            absent = now
            continue
        for key, line in _lines(message):
            if key not in told:
                told.add(key)
                yield line


def _lines(message: Message) -> Iterator[tuple[tuple[object, ...], Line]]:
    """The lines of a message, each with what tells it from others."""
    who = _name(message.id)
    match message:
        case Election():
            members = ", ".join(map(str, message.members))
            text = f"UAV {message.computing} computes for {members} (term {message.term})"
            election = ("election", message.id, message.term, message.computing, message.members)
            yield election, Line(message.t_ns, LineLevel.INFO, who, text)
        case Command():
            text = f"command {message.number} to UAV {message.target}: {manoeuvre_text(message)}"
            command = ("cmd", message.term, message.id, message.number)
            yield command, Line(message.t_ns, LineLevel.INFO, who, text)
        case Ack(accepted=False):
            text = f"refuses command {message.number} of UAV {message.target}: {message.reason}"
            refusal = ("ack", *_command_of(message), message.id, message.reason)
            yield refusal, Line(message.t_ns, LineLevel.WARNING, who, text)
        case Decision():
            for encounter in message.encounters:
                if encounter.unresolved:
                    text = f"finds no way to keep UAV {encounter.target} apart"
                    line = Line(message.t_ns, LineLevel.WARNING, who, text)
                    yield ("decision", message.id, message.t_ns, encounter.target), line


def _command_of(ack: Ack) -> tuple[int, int, int]:
    return ack.term, ack.target, ack.number


def manoeuvre_text(command: Command) -> str:
    """A command in words: degrees and m/s."""
    parts = []
    if command.manoeuvre in TURNING:
        heading = math.degrees(command.heading_rad) % 360.0
        parts.append(f"turn {math.degrees(command.turn_rad):+.0f} deg to heading {heading:.0f} deg")
    if command.manoeuvre in CLIMBING:
        way = "dive" if command.climb_mps < 0.0 else "climb"
        parts.append(f"{way} {abs(command.climb_mps):.1f} m/s")
    if command.speed_mps is not None:
        parts.append(f"speed {command.speed_mps:.1f} m/s")
    if not parts:
        return command.manoeuvre
    return f"{', '.join(parts)}, until {to_s(command.manoeuvre_end_ns):.1f} s at the latest"


def _processes(t_ns: int, before: dict[int, str], now: dict[int, str]) -> Iterator[Line]:
    for number in sorted(before.keys() | now.keys()):
        if before.get(number) != now.get(number):
            text = f"its process is {now.get(number, 'running again')}"
            yield Line(t_ns, LineLevel.WARNING, _name(number), text)


def _fault(rule: Rule) -> Iterator[Line]:
    if rule.end_s is not None and rule.end_s <= rule.start_s:
        return  # ended by a live change before it began
    text = rule.words()
    yield Line(to_ns(rule.start_s), LineLevel.WARNING, "faults", f"begins: {text}")
    if rule.end_s is not None:
        yield Line(to_ns(rule.end_s), LineLevel.INFO, "faults", f"ends: {text}")


def _losses(pair: PairCurve) -> Iterator[Line]:
    """When a pair loses its separation, and when it has it again; to the moment on record."""
    a, b = pair.minimum.a, pair.minimum.b
    edges = np.diff(np.concatenate([[False], pair.lost, [False]]))
    for first, after in np.flatnonzero(edges).reshape(-1, 2).tolist():
        inside = first + np.flatnonzero(pair.normalised[first:after] < 1.0)
        row, where = first, "between two moments on record"
        if len(inside):
            row = int(inside[0])
            where = f"{pair.horizontal_m[row]:.0f} m, {pair.vertical_m[row]:.0f} m vertically"
        text = f"UAV {a} and UAV {b} have lost separation: {where}"
        yield Line(int(pair.t_ns[row]), LineLevel.ERROR, "separation", text)
        if after < len(pair.t_ns):
            text = f"UAV {a} and UAV {b} are apart again"
            yield Line(int(pair.t_ns[after]), LineLevel.INFO, "separation", text)


def _name(number: int) -> str:
    return issuer_name(number) if number == COORDINATOR else f"UAV {number}"
