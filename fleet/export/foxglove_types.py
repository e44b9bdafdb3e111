"""The foxglove schemas that exports use (https://docs.foxglove.dev/docs/sdk/schemas), as structs.

Field names, units and meanings are theirs: metres, seconds and nanoseconds, colours from 0 to 1, x
forward. The JSON schema of each is made from the class. What a scene entity can have and ours do
not (cubes, spheres, triangles, models) is there as an empty list, as their schema demands.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from fleet.model.units import NS_PER_S

Natural = Annotated[int, Meta(ge=0)]
Nanoseconds = Annotated[int, Meta(ge=0, le=999_999_999)]
Enumerated = Annotated[int, Meta(ge=0, le=5)]
Covariance = Annotated[tuple[float, ...], Meta(min_length=9, max_length=9)]

LINE_STRIP = 0
DELETE_ALL = 1
COVARIANCE_UNKNOWN = 0


class JsonObject(Struct, frozen=True, gc=False):
    """An object of JSON."""


class Time(JsonObject, frozen=True):
    """A moment, or a duration."""

    sec: Natural
    nsec: Nanoseconds


class Vector3(JsonObject, frozen=True):
    """A position or a size in m, or a velocity in m/s."""

    x: float
    y: float
    z: float


class Quaternion(JsonObject, frozen=True):
    """An orientation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(JsonObject, frozen=True):
    """Position and orientation."""

    position: Vector3
    orientation: Quaternion = Quaternion()


class Color(JsonObject, frozen=True):
    """Red, green, blue and opacity, from 0 to 1."""

    r: float
    g: float
    b: float
    a: float


class KeyValuePair(JsonObject, frozen=True):
    """Named text."""

    key: str
    value: str


class ArrowPrimitive(JsonObject, frozen=True):
    """An arrow along +x of its pose."""

    pose: Pose
    shaft_length: float
    shaft_diameter: float
    head_length: float
    head_diameter: float
    color: Color


class CylinderPrimitive(JsonObject, frozen=True):
    """A cylinder round the z axis of its pose; `size` is that of its bounding box."""

    pose: Pose
    size: Vector3
    bottom_scale: float
    top_scale: float
    color: Color


class LinePrimitive(JsonObject, frozen=True):
    """Lines through points; `thickness` is in pixels if `scale_invariant`, else in m."""

    type: Enumerated
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: tuple[Vector3, ...]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[Natural, ...] = ()


class TextPrimitive(JsonObject, frozen=True):
    """A label that turns to the camera; `font_size` is in pixels if `scale_invariant`."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


class Unused(JsonObject, frozen=True):
    """A primitive that we never write."""


class SceneEntity(JsonObject, frozen=True, kw_only=True):
    """Something in the scene; it replaces what has the same `id` on the same topic."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time = Time(0, 0)
    frame_locked: bool = False
    metadata: tuple[KeyValuePair, ...] = ()
    arrows: tuple[ArrowPrimitive, ...] = ()
    cubes: tuple[Unused, ...] = ()
    spheres: tuple[Unused, ...] = ()
    cylinders: tuple[CylinderPrimitive, ...] = ()
    lines: tuple[LinePrimitive, ...] = ()
    triangles: tuple[Unused, ...] = ()
    texts: tuple[TextPrimitive, ...] = ()
    models: tuple[Unused, ...] = ()


class SceneEntityDeletion(JsonObject, frozen=True):
    """Removes entities of the same topic: all of them, or the one with this `id`."""

    timestamp: Time
    type: Enumerated
    id: str


class SceneUpdate(JsonObject, frozen=True):
    """Deletions, then entities."""

    deletions: tuple[SceneEntityDeletion, ...]
    entities: tuple[SceneEntity, ...]


class PosesInFrame(JsonObject, frozen=True):
    """Poses of several things at one moment."""

    timestamp: Time
    frame_id: str
    poses: tuple[Pose, ...]


class FrameTransform(JsonObject, frozen=True):
    """Where the origin of a child frame is in its parent frame."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class FrameTransforms(JsonObject, frozen=True):
    """Several of them."""

    transforms: tuple[FrameTransform, ...]


class LocationFix(JsonObject, frozen=True):
    """A geographic position: degrees, and m above the ellipsoid; heading in rad from north."""

    timestamp: Time
    frame_id: str
    latitude: float
    longitude: float
    altitude: float
    position_covariance: Covariance
    position_covariance_type: Enumerated
    heading: float
    velocity: Vector3
    color: Color
    metadata: tuple[KeyValuePair, ...] = ()


class LogLine(JsonObject, frozen=True):
    """A line of text; levels from 1 (debug) to 5 (fatal)."""

    timestamp: Time
    level: Enumerated
    message: str
    name: str
    file: str
    line: Natural


def time_of(t_ns: int) -> Time:
    """A time in nanoseconds."""
    return Time(*divmod(t_ns, NS_PER_S))
