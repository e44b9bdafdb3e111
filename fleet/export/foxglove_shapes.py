"""What the fleet looks like in foxglove primitives: zones, command arrows, trails and routes.

Positions are east, north, up (ENU) in m; colours are those of the palette.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fleet.analysis.palette import rgb_of
from fleet.config.scenario import Zone
from fleet.export import foxglove_types as fg
from fleet.export.scene import AHEAD_S, Track
from fleet.model.types import Array
from fleet.model.words import AS_PLANNED, Mode

FIXED = "enu"
CALM, LOST, TRAIL, ROUTE = 0.25, 0.6, 0.9, 0.4
"""Opacities: of a zone, of one that another overlaps, of trails and of routes."""
TRAIL_PX, ROUTE_PX, LABEL_PX = 3.0, 1.0, 16.0
WHITE = fg.Color(1.0, 1.0, 1.0, 1.0)
UNMANNED_GREY = (0.6, 0.6, 0.6)
"""An aircraft that nobody flies is grey."""
"""Modes that a label does not mention."""


def frame_of(uav: int) -> str:
    """The frame that moves with a UAV and does not turn."""
    return f"uav/{uav}"


def colour(index: int, opacity: float = 1.0) -> fg.Color:
    """The colour of a UAV by its place in the fleet."""
    red, green, blue = (part / 255.0 for part in rgb_of(index))
    return fg.Color(red, green, blue, opacity)


def vector(row: Array) -> fg.Vector3:
    """A row of three numbers."""
    return fg.Vector3(*row.tolist())


def towards(direction_enu: Array) -> fg.Quaternion:
    """The orientation whose x axis points there and whose y axis is level (x forward, y left)."""
    east, north, up = direction_enu.tolist()
    yaw, pitch = math.atan2(north, east), -math.atan2(up, math.hypot(east, north))
    sin_yaw, cos_yaw = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    sin_pitch, cos_pitch = math.sin(pitch / 2.0), math.cos(pitch / 2.0)
    return fg.Quaternion(
        -sin_yaw * sin_pitch, cos_yaw * sin_pitch, sin_yaw * cos_pitch, cos_yaw * cos_pitch
    )


def update(t_ns: int, entities: Sequence[fg.SceneEntity]) -> fg.SceneUpdate:
    """These entities and no others on the topic."""
    deletion = fg.SceneEntityDeletion(fg.time_of(t_ns), fg.DELETE_ALL, "")
    return fg.SceneUpdate((deletion,), tuple(entities))


def zone_entity(track: Track, size: Zone, t_ns: int, mode: str, *, lost: bool) -> fg.SceneEntity:
    """The protected cylinder, fixed to its UAV, with the number and what it does above it."""
    box = fg.Vector3(2.0 * size.radius_m, 2.0 * size.radius_m, 2.0 * size.half_height_m)
    middle, above = fg.Vector3(0.0, 0.0, 0.0), fg.Vector3(0.0, 0.0, 2.0 * size.half_height_m)
    opacity = LOST if lost else CALM
    paint = (
        fg.Color(*UNMANNED_GREY, opacity) if mode == Mode.UNMANNED else colour(track.index, opacity)
    )
    label = f"{track.uav}" if mode in AS_PLANNED else f"{track.uav} {mode}"
    return fg.SceneEntity(
        timestamp=fg.time_of(t_ns),
        frame_id=frame_of(track.uav),
        id=f"zone/{track.uav}",
        frame_locked=True,
        metadata=(fg.KeyValuePair("mode", mode), fg.KeyValuePair("lost", str(lost).lower())),
        cylinders=(fg.CylinderPrimitive(fg.Pose(middle), box, 1.0, 1.0, paint),),
        texts=(_text(fg.Pose(above), label),),
    )


def arrow_entity(track: Track, row: int) -> fg.SceneEntity:
    """A command: from the UAV to where it would be `AHEAD_S` later if it flew it already."""
    intent = track.intent_enu_mps(row)
    length = AHEAD_S * float(np.linalg.norm(intent))
    head, thick = 0.15 * length, 0.04 * length
    pose = fg.Pose(fg.Vector3(0.0, 0.0, 0.0), towards(intent))
    paint = colour(track.index)
    return fg.SceneEntity(
        timestamp=fg.time_of(int(track.t_ns[row])),
        frame_id=frame_of(track.uav),
        id=f"command/{track.uav}",
        frame_locked=True,
        arrows=(fg.ArrowPrimitive(pose, length - head, thick, head, 2.5 * thick, paint),),
    )


def trail_entity(track: Track, points_enu_m: Array, t_ns: int) -> fg.SceneEntity:
    """Where a UAV has been."""
    line = _line(points_enu_m, colour(track.index, TRAIL), TRAIL_PX)
    return _still(f"trail/{track.uav}", t_ns, line)


def route_entity(track: Track, points_enu_m: Array) -> fg.SceneEntity:
    """Where a UAV was to go: its start and its waypoints."""
    return _still(
        f"route/{track.uav}", 0, _line(points_enu_m, colour(track.index, ROUTE), ROUTE_PX)
    )


def _still(name: str, t_ns: int, line: fg.LinePrimitive) -> fg.SceneEntity:
    return fg.SceneEntity(timestamp=fg.time_of(t_ns), frame_id=FIXED, id=name, lines=(line,))


def _text(pose: fg.Pose, label: str) -> fg.TextPrimitive:
    return fg.TextPrimitive(
        pose, billboard=True, font_size=LABEL_PX, scale_invariant=True, color=WHITE, text=label
    )


def _line(points_enu_m: Array, paint: fg.Color, thickness_px: float) -> fg.LinePrimitive:
    points = tuple(fg.Vector3(*p) for p in points_enu_m.tolist())
    pose = fg.Pose(fg.Vector3(0.0, 0.0, 0.0))
    return fg.LinePrimitive(
        fg.LINE_STRIP, pose, thickness_px, scale_invariant=True, points=points, color=paint
    )
