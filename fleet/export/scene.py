"""What viewers show of a log: the tracks of all UAVs, and the separation of pairs.

Viewers want z up. Everything here is east, north, up (ENU) in metres from the scenario's origin:
x_east = y_ned, y_north = x_ned, z_up = -z_ned. Headings stay clockwise from north, in radians, and
times are simulated, in integer nanoseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import positions_of
from fleet.analysis.separation import PairCurve, nearness_of, pair_curve
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.model.types import Array
from fleet.model.units import to_ns
from fleet.protocol.messages import Clock, Message, Truth

Times = NDArray[np.int64]

NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Turns a row (north, east, down) into (east, north, up), and back: it is its own inverse."""

AHEAD_S = 12.0
"""A command is shown as an arrow to where the UAV would be so much later."""

MIN_RADIUS_M, ROOM = 1500.0, 1.2
"""How much of the scene is looked at first: at least, and times the radius of the fleet."""

TRAIL_NS = to_ns(60.0)
"""So much of where a UAV has been is bright."""

NEAREST_PAIRS = 12
"""Separations are shown for so many pairs, the nearest, and for all that lose it."""


@dataclass(frozen=True)
class Track:
    """The true flight of one UAV, a row a tick; `index` is its place in the fleet, for colours."""

    uav: int
    index: int
    t_ns: Times
    position_enu_m: Array
    velocity_enu_mps: Array
    heading_rad: Array
    commanded_heading_rad: Array
    commanded_climb_mps: Array
    modes: Sequence[str]
    commands: Sequence[tuple[int, int, int]]

    def intent_enu_mps(self, row: int) -> Array:
        """The velocity that the flight controller aims at, at the speed flown."""
        heading = self.commanded_heading_rad[row]
        speed = float(np.hypot(*self.velocity_enu_mps[row, :2]))
        climb = self.commanded_climb_mps[row]
        return np.array([speed * np.sin(heading), speed * np.cos(heading), climb])


@dataclass(frozen=True)
class Scene:
    """All of it. `routes_enu_m` has the start and the waypoints of each UAV by its number."""

    scenario: Scenario
    tracks: tuple[Track, ...]
    routes_enu_m: dict[int, Array]
    pairs: tuple[PairCurve, ...]
    t_ns: Times
    least_t_ns: Times
    least: Array
    """The least normalised separation of any pair, at each of `least_t_ns`.

    Those are the moments with two UAVs or more, and the one at which it was least.
    """

    @property
    def end_ns(self) -> int:
        """The last moment; 0 if nothing was flown."""
        return int(self.t_ns[-1]) if len(self.t_ns) else 0

    def lost(self) -> dict[int, frozenset[int]]:
        """At each time in ns with a loss of separation, then or on the way to the next: of whom."""
        who: dict[int, set[int]] = {}
        for pair in self.pairs:
            for t_ns in pair.t_ns[pair.lost].tolist():
                who.setdefault(t_ns, set()).update((pair.minimum.a, pair.minimum.b))
        return {t_ns: frozenset(uavs) for t_ns, uavs in who.items()}

    def focus(self) -> tuple[tuple[float, float, float], float]:
        """Where it was tightest, and a radius round it in m: what to look at first.

        That is the middle of all UAVs when the least separation of all was least.
        """
        if not len(self.least):
            return (0.0, 0.0, 0.0), MIN_RADIUS_M
        least_ns = self.least_t_ns[np.argmin(self.least)]
        t_ns = self.t_ns[np.searchsorted(self.t_ns, least_ns, "right") - 1]
        there = [t.position_enu_m[t.t_ns == t_ns] for t in self.tracks]
        places = np.concatenate(there)
        middle = places.mean(axis=0)
        radius = float(np.hypot(*(places - middle)[:, :2].T).max())
        east, north, up = middle.tolist()
        return (east, north, up), max(MIN_RADIUS_M, ROOM * radius)


def enu(ned: Array) -> Array:
    """Rows (north, east, down) as (east, north, up)."""
    rows: Array = ned @ NED_TO_ENU
    return rows


def scene_of(scenario: Scenario, messages: Iterable[Message | Clock]) -> Scene:
    """The scene that the true states in a log make."""
    uavs = uavs_of(scenario)
    flown: dict[int, list[Truth]] = {uav.id: [] for uav in uavs}
    for message in messages:
        if isinstance(message, Truth) and message.id in flown:
            flown[message.id].append(message)
    tracks = tuple(_track(uav.id, n, flown[uav.id]) for n, uav in enumerate(uavs))
    flown_to = {n: {t.t_ns: t.position_ned_m for t in own} for n, own in flown.items()}
    t_ns, positions = positions_of(tuple(flown), flown_to)
    required, zones = scenario.required(), scenario.zone_ratios()
    near = nearness_of(tuple(flown), t_ns, positions, required, zones)
    place = {track.uav: positions[track.index] for track in tracks}
    pairs = tuple(
        pair_curve(m, t_ns, place[m.a] - place[m.b], zones.of_pair(m.pair, required))
        for n, m in enumerate(near.minima)
        if n < NEAREST_PAIRS or m.lost
    )
    routes = {u.id: enu(np.array([u.position_ned_m, *u.waypoints_ned_m])) for u in uavs}
    return Scene(scenario, tracks, routes, pairs, t_ns, near.times_ns, near.least)


def _track(uav: int, index: int, truths: list[Truth]) -> Track:
    rows = sorted(truths, key=lambda t: t.t_ns)

    def column(values: Iterable[float]) -> Array:
        return np.fromiter(values, float, len(rows))

    return Track(
        uav,
        index,
        np.fromiter((t.t_ns for t in rows), np.int64, len(rows)),
        enu(np.array([t.position_ned_m for t in rows], float).reshape(-1, 3)),
        enu(np.array([t.velocity_ned_mps for t in rows], float).reshape(-1, 3)),
        column(t.heading_rad for t in rows),
        column(t.commanded_heading_rad for t in rows),
        column(t.commanded_climb_mps for t in rows),
        [t.mode for t in rows],
        [(t.command_term, t.command_issuer, t.command_number) for t in rows],
    )


def every(t_ns: Times, step_ns: int) -> NDArray[np.intp]:
    """Rows of the first time in each step, and of the last time: a thinner series."""
    if not len(t_ns):
        return np.zeros(0, np.intp)
    firsts = np.unique(t_ns // step_ns, return_index=True)[1]
    return np.union1d(firsts, [len(t_ns) - 1])
