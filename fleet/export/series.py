"""Numeric series for plots, as JSON: flights and separations, in degrees for people."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees

import msgspec
import numpy as np

from fleet.analysis.separation import PairCurve
from fleet.export.scene import Scene, Track, every

SeriesRow = tuple[str, str, int, msgspec.Struct]
"""Topic, name of the schema, simulated time in ns, message."""


class UavState(msgspec.Struct, frozen=True, gc=False):
    """One UAV: position from the origin, altitude and climb positive up, headings from north."""

    north_m: float
    east_m: float
    altitude_m: float
    ground_speed_mps: float
    climb_mps: float
    heading_deg: float
    commanded_heading_deg: float
    commanded_climb_mps: float
    mode: str


class PairSeparation(msgspec.Struct, frozen=True, gc=False):
    """One pair: normalised separation, lost below 1, and the two distances that make it."""

    normalised: float
    required: float
    horizontal_m: float
    vertical_m: float


class LeastSeparation(msgspec.Struct, frozen=True, gc=False):
    """The least normalised separation of all pairs; lost below 1."""

    normalised: float
    required: float


def series_of(scene: Scene, step_ns: int) -> list[Iterator[SeriesRow]]:
    """All series, each in order of time: a row in each step, and the least separation."""
    return [
        *(_states(track, step_ns) for track in scene.tracks),
        *(_separation(pair, step_ns) for pair in scene.pairs),
        _least(scene, step_ns),
    ]


def _least(scene: Scene, step_ns: int) -> Iterator[SeriesRow]:
    if not len(scene.least):
        return
    t_ns = scene.least_t_ns
    for row in np.union1d(every(t_ns, step_ns), [np.argmin(scene.least)]):
        least = LeastSeparation(float(scene.least[row]), 1.0)
        yield "/separation/least", "fleet_export.LeastSeparation", int(t_ns[row]), least


def _states(track: Track, step_ns: int) -> Iterator[SeriesRow]:
    topic = f"/uav/{track.uav}/state"
    for row in every(track.t_ns, step_ns):
        (east, north, up), velocity = track.position_enu_m[row], track.velocity_enu_mps[row]
        state = UavState(
            float(north),
            float(east),
            float(up),
            float(np.hypot(velocity[0], velocity[1])),
            float(velocity[2]),
            degrees(track.heading_rad[row]) % 360.0,
            degrees(track.commanded_heading_rad[row]) % 360.0,
            float(track.commanded_climb_mps[row]),
            track.modes[row],
        )
        yield topic, "fleet_export.UavState", int(track.t_ns[row]), state


def _separation(pair: PairCurve, step_ns: int) -> Iterator[SeriesRow]:
    topic = f"/separation/{pair.minimum.a}-{pair.minimum.b}"
    for row in np.union1d(every(pair.t_ns, step_ns), [pair.nearest]):
        values = (pair.normalised[row], 1.0, pair.horizontal_m[row], pair.vertical_m[row])
        separation = PairSeparation(*map(float, values))
        yield topic, "fleet_export.Separation", int(pair.t_ns[row]), separation
