"""An MCAP file for Foxglove and Lichtblick: foxglove schemas and numeric series, all as JSON.

The fixed frame `enu` is east, north, up from the scenario's origin. Each UAV has a frame `uav/N`
that moves with it and does not turn: zone, label and command arrow are fixed in it, and are written
only when they change. Each message shows everything of its topic, so that a viewer that jumps to
any moment needs none before it.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from typing import IO, NamedTuple

import msgspec
import numpy as np

from fleet.export import foxglove_types as fg
from fleet.export.foxglove_shapes import (
    FIXED,
    arrow_entity,
    colour,
    frame_of,
    route_entity,
    towards,
    trail_entity,
    update,
    vector,
    zone_entity,
)
from fleet.export.geodesy import geodetic
from fleet.export.lines import Line
from fleet.export.scene import NED_TO_ENU, TRAIL_NS, Scene, Track, every
from fleet.export.series import series_of
from fleet.log.foreign_writer import ForeignWriter
from fleet.model.units import to_ns
from fleet.model.words import AVOIDING

SCENE_STEP_NS = to_ns(0.1)
"""Frames, poses and series are written at most so often."""
SLOW_STEP_NS = to_ns(1.0)
"""Trails and geographic positions are written so often, and a trail has points as far apart."""


class TimedMessage(NamedTuple):
    """One message of the export."""

    topic: str
    schema: str
    t_ns: int
    message: msgspec.Struct


def write_foxglove(file: IO[bytes], scene: Scene, lines: Sequence[Line]) -> int:
    """Write it to an open file; returns how many messages it has. Raises OSError (disk full)."""
    count = 0
    with ForeignWriter(file) as writer:
        for item in messages(scene, lines):
            writer.write(*item)
            count += 1
    return count


def messages(scene: Scene, lines: Sequence[Line]) -> Iterator[TimedMessage]:
    """Every message, in order of time."""
    streams = [
        _routes(scene),
        _moving(scene),
        _zones_and_commands(scene),
        _trails(scene),
        *(_fixes(track, scene) for track in scene.tracks),
        _log(lines),
        *(map(TimedMessage._make, series) for series in series_of(scene, SCENE_STEP_NS)),
    ]
    return heapq.merge(*streams, key=lambda item: item.t_ns)


def _routes(scene: Scene) -> Iterator[TimedMessage]:
    """The plan of each UAV, once."""
    routes = [route_entity(track, scene.routes_enu_m[track.uav]) for track in scene.tracks]
    yield _scene_update("/routes", 0, routes)


def _log(lines: Sequence[Line]) -> Iterator[TimedMessage]:
    for line in lines:
        text = fg.LogLine(fg.time_of(line.t_ns), int(line.level), line.text, line.who, "", 0)
        yield TimedMessage("/log", "foxglove.Log", line.t_ns, text)


def _scene_update(topic: str, t_ns: int, entities: Sequence[fg.SceneEntity]) -> TimedMessage:
    return TimedMessage(topic, "foxglove.SceneUpdate", t_ns, update(t_ns, entities))


def _present(scene: Scene, step_ns: int) -> Iterator[tuple[int, list[tuple[Track, int]]]]:
    """The first moment in each step, and who is there in which row of its track."""
    rows = [dict(zip(t.t_ns.tolist(), range(len(t.t_ns)), strict=True)) for t in scene.tracks]
    for t_ns in scene.t_ns[every(scene.t_ns, step_ns)].tolist():
        found = zip(scene.tracks, (r.get(t_ns) for r in rows), strict=True)
        yield t_ns, [(track, row) for track, row in found if row is not None]


def _moving(scene: Scene) -> Iterator[TimedMessage]:
    """The frames of all UAVs, and their poses."""
    level = fg.Quaternion()
    for t_ns, there in _present(scene, SCENE_STEP_NS):
        stamp = fg.time_of(t_ns)
        places = [vector(track.position_enu_m[row]) for track, row in there]
        frames = tuple(
            fg.FrameTransform(stamp, FIXED, frame_of(track.uav), place, level)
            for (track, _), place in zip(there, places, strict=True)
        )
        poses = tuple(
            fg.Pose(place, towards(track.velocity_enu_mps[row]))
            for (track, row), place in zip(there, places, strict=True)
        )
        yield TimedMessage("/tf", "foxglove.FrameTransforms", t_ns, fg.FrameTransforms(frames))
        posed = fg.PosesInFrame(stamp, FIXED, poses)
        yield TimedMessage("/poses", "foxglove.PosesInFrame", t_ns, posed)


def _zones_and_commands(scene: Scene) -> Iterator[TimedMessage]:
    """Zones with labels, and arrows of the commands in force, whenever one of them changes."""
    sizes = {track.uav: scene.scenario.zone_of(track.uav) for track in scene.tracks}
    lost = scene.lost()
    shown: tuple[object, object] = (None, None)
    for t_ns, there in _present(scene, 1):
        hit = lost.get(t_ns, frozenset())
        zones = [(track.uav, track.modes[row], track.uav in hit) for track, row in there]
        flown = [(track, row) for track, row in there if track.modes[row] in AVOIDING]
        commands = [(track.uav, track.commands[row]) for track, row in flown]
        if zones != shown[0]:
            entities = [
                zone_entity(track, sizes[track.uav], t_ns, mode, lost=over)
                for (track, _), (_, mode, over) in zip(there, zones, strict=True)
            ]
            yield _scene_update("/zones", t_ns, entities)
        if commands != shown[1]:
            yield _scene_update("/commands", t_ns, [arrow_entity(*at) for at in flown])
        shown = (zones, commands)


def _trails(scene: Scene) -> Iterator[TimedMessage]:
    """The last minute of each track."""
    points = [(t, every(t.t_ns, SLOW_STEP_NS)) for t in scene.tracks]
    for t_ns in scene.t_ns[every(scene.t_ns, SLOW_STEP_NS)].tolist():
        entities = []
        for track, rows in points:
            begin, end = np.searchsorted(track.t_ns[rows], (t_ns - TRAIL_NS, t_ns), "right")
            recent = rows[begin:end]
            entities.append(trail_entity(track, track.position_enu_m[recent], t_ns))
        yield _scene_update("/trails", t_ns, entities)


def _fixes(track: Track, scene: Scene) -> Iterator[TimedMessage]:
    """Where on Earth a UAV is."""
    rows = every(track.t_ns, SLOW_STEP_NS)
    places = geodetic(track.position_enu_m[rows] @ NED_TO_ENU, scene.scenario.origin)
    for row, (latitude, longitude, altitude) in zip(rows, places.tolist(), strict=True):
        t_ns = int(track.t_ns[row])
        fix = fg.LocationFix(
            fg.time_of(t_ns),
            frame_of(track.uav),
            latitude,
            longitude,
            altitude,
            (0.0,) * 9,
            fg.COVARIANCE_UNKNOWN,
            float(track.heading_rad[row]),
            vector(track.velocity_enu_mps[row]),
            colour(track.index),
        )
        yield TimedMessage(f"/uav/{track.uav}/fix", "foxglove.LocationFix", t_ns, fix)
