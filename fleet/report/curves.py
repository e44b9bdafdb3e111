"""Curves of a run: separation of pairs, what was commanded, and curves made light.

Pure functions. Times in s, lengths in m, angles in rad unless a name says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.separation import PairMinimum, pair_curve
from fleet.analysis.words import separation_text
from fleet.model.types import Array, Indices
from fleet.model.units import wrap_angle
from fleet.model.words import CLIMBING, TURNING, Manoeuvre, Mode
from fleet.protocol.messages import Command
from fleet.report.run_data import Flight, RunData

Interval = tuple[float, float]
MERGED_HEADING_RAD = 0.02


def kept(times_s: Array, values: Array, tolerance: float) -> Indices:
    """Which samples of a curve (n,) or (n, k) to keep so that lines between them are near enough.

    At each time left out the line is at most `tolerance` away (Douglas and Peucker, by time). Of
    samples that are NaN one is kept in each gap, so that a line breaks there.
    """
    table = values.reshape(len(times_s), -1)
    there = np.all(np.isfinite(table), axis=1)
    keep = np.zeros(len(times_s), dtype=np.bool_)
    for first, last in true_spans(there):
        keep[[first, last]] = True
        _keep_bends(times_s, table, tolerance, (first, last), keep)
        if last + 1 < len(times_s):
            keep[last + 1] = True
    return np.flatnonzero(keep)


def _keep_bends(
    times_s: Array, table: Array, tolerance: float, span: tuple[int, int], keep: NDArray[np.bool_]
) -> None:
    waiting = [span]
    while waiting:
        a, b = waiting.pop()
        if b - a < 2:
            continue
        share = ((times_s[a + 1 : b] - times_s[a]) / (times_s[b] - times_s[a]))[:, None]
        off = np.abs(table[a + 1 : b] - table[a] - share * (table[b] - table[a])).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = a + 1 + worst
            keep[middle] = True
            waiting += [(a, middle), (middle, b)]


def true_spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last place of each run of true flags."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def intervals(times_s: Array, flags: NDArray[np.bool_]) -> list[Interval]:
    """When flags are up: from the first sample that has it to the first that no longer has it."""
    last = len(times_s) - 1
    return [(float(times_s[a]), float(times_s[min(b + 1, last)])) for a, b in true_spans(flags)]


@dataclass(frozen=True)
class DrawnPair:
    """Distances of two UAVs over their common times, and where they are nearest (normalised)."""

    a: Flight
    b: Flight
    minimum: PairMinimum
    times_s: Array
    horizontal_m: Array
    vertical_m: Array
    normalised: Array
    nearest: int

    @property
    def ids(self) -> tuple[int, int]:
        """Both numbers, the lower first."""
        return self.a.id, self.b.id

    @property
    def label(self) -> str:
        """As in `1-2`."""
        return f"{self.a.id}\N{EN DASH}{self.b.id}"

    @property
    def least(self) -> float:
        """Least normalised separation; below 1 is a loss."""
        return self.minimum.least_separation

    @property
    def least_text(self) -> str:
        """The same for people."""
        return separation_text(self.least)

    def kept(self, values: Array, tolerance: float) -> Indices:
        """Which rows of a curve to draw; that of the minimum is one of them."""
        return np.union1d(kept(self.times_s, values, tolerance), [self.nearest])


def pair_curves(run_data: RunData, most: int) -> list[DrawnPair]:
    """The pairs that came nearest, nearest first, and at most so many."""
    return [_pair(run_data, minimum) for minimum in run_data.minima[:most]]


def pairs_lost(run_data: RunData) -> int:
    """How many pairs lost separation, of all."""
    return sum(minimum.lost for minimum in run_data.minima)


def _pair(run_data: RunData, minimum: PairMinimum) -> DrawnPair:
    a, b = (run_data.flights[run_data.index_of(uav)] for uav in (minimum.a, minimum.b))
    required = run_data.scenario.required_of(minimum.pair)
    curve = pair_curve(minimum, run_data.times_ns, a.ned_m - b.ned_m, required)
    columns = curve.horizontal_m, curve.vertical_m, curve.normalised, curve.nearest
    return DrawnPair(a, b, minimum, curve.times_s, *columns)


@dataclass(frozen=True)
class FlownCommand:
    """A command in force at one UAV, from when to when, and what it told (tc, cc)."""

    uav: int
    index: int
    start_s: float
    end_s: float
    manoeuvre: str
    turn_rad: float
    climb_mps: float
    command_id: tuple[int, int, int]
    speed_mps: float = math.nan

    @property
    def words(self) -> str:
        """As in `turn +30°` or `dive 2 m/s`."""
        return manoeuvre_words(self.manoeuvre, self.turn_rad, self.climb_mps, self.speed_mps)


def manoeuvre_words(
    manoeuvre: str, turn_rad: float, climb_mps: float, speed_mps: float = math.nan
) -> str:
    """As in `turn +30°, climb 2 m/s` or `speed 21 m/s`; empty for a manoeuvre of none of these."""
    parts = []
    if manoeuvre in TURNING:
        parts.append(f"turn {math.degrees(turn_rad):+.0f}°")
    if manoeuvre in CLIMBING:
        parts.append(climb_words(climb_mps))
    if manoeuvre == Manoeuvre.SPEED:
        parts.append(speed_words(speed_mps))
    return ", ".join(parts)


def speed_words(speed_mps: float) -> str:
    """As in `speed 21 m/s`."""
    return f"speed {speed_mps:.3g} m/s"


def climb_words(climb_mps: float) -> str:
    """As in `climb 2 m/s` and `dive 2 m/s`."""
    return f"{'dive' if climb_mps < 0.0 else 'climb'} {abs(climb_mps):.2g} m/s"


def flown_commands(run_data: RunData) -> list[FlownCommand]:
    """What was commanded and flown, in order of UAV and time, from the true states."""
    told = {(c.term, c.id, c.number): c for c in run_data.of(Command)}
    return [f for flight in run_data.flights for f in _flown_by(run_data, flight, told)]


def _flown_by(
    run_data: RunData, flight: Flight, told: dict[tuple[int, int, int], Command]
) -> list[FlownCommand]:
    obeying = (flight.commands[:, 2] > 0) & (flight.modes != Mode.UNMANNED) & (flight.modes != "")
    numbers = np.where(obeying[:, None], flight.commands, 0)
    changes = np.flatnonzero(np.any(np.diff(numbers, axis=0), axis=1)) + 1
    edges = [0, *changes.tolist(), len(numbers) - 1] if len(numbers) else []
    out: list[FlownCommand] = []
    for first, after in pairwise(edges):
        term, issuer, number = (int(n) for n in numbers[first])
        command = told.get((term, issuer, number))
        if not number or command is None or after == first:
            continue
        start_s, end_s = float(run_data.times_s[first]), float(run_data.times_s[after])
        turn = _turn_of(command, flight, first, out[-1] if out else None, told)
        key = (term, issuer, number)
        flown = FlownCommand(
            flight.id,
            flight.index,
            start_s,
            end_s,
            command.manoeuvre,
            turn,
            command.climb_mps,
            key,
            command.speed_mps or math.nan,
        )
        out.append(flown)
    return out


def _turn_of(
    command: Command,
    flight: Flight,
    at: int,
    before: FlownCommand | None,
    told: dict[tuple[int, int, int], Command],
) -> float:
    """The tc of a command; one that only makes a manoeuvre last longer does not say it again."""
    if command.manoeuvre not in TURNING:
        return 0.0
    if command.turn_rad:
        return command.turn_rad
    if before is not None:
        same = wrap_angle(told[before.command_id].heading_rad - command.heading_rad)
        if abs(same) < MERGED_HEADING_RAD:
            return before.turn_rad
    return wrap_angle(command.heading_rad - float(flight.guidance[at, 0]))


def steps(flown: Sequence[FlownCommand], values: Sequence[float]) -> tuple[Array, Array]:
    """A curve from 0 to a value and back for each command in force; a gap (NaN) in between."""
    times, heights = list[float](), list[float]()
    for item, value in zip(flown, values, strict=True):
        if times and times[-1] == item.start_s:
            del times[-1], heights[-1]  # straight from one value to the next
        else:
            times += [math.nan, item.start_s]
            heights += [math.nan, 0.0]
        times += [item.start_s, item.end_s, item.end_s]
        heights += [value, value, 0.0]
    return np.array(times[1:]), np.array(heights[1:])
