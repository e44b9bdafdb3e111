"""Collision risk by geometric intersection of protected cylinders (eq. 4, 8, 9).

Two zones overlap when the horizontal distance is below r_i + r_j and the vertical one below
h_i + h_j at the same time. Trajectories come as samples; between two samples the relative position
is taken as linear and its overlap with the cylinder is solved exactly. The true path leaves that
chord by at most a dt^2 / 8 for each UAV, a being its greatest acceleration, and the cylinder is
widened by that much: nothing slips between samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fleet.model.elementary import hypot
from fleet.model.types import Array
from fleet.model.vehicle.limits import Limits

FAR = 100.0
"""Normalised separation from nobody."""


@dataclass(frozen=True, slots=True)
class Required:
    """Least horizontal and vertical distance of two UAVs: the sums of their zones' sizes."""

    horizontal_m: float
    vertical_m: float

    def widened(
        self, limits: Limits, speed_mps: float, step_s: float, faster_mps2: float = 0.0
    ) -> Required:
        """Allowing for the curvature of both paths between samples `step_s` apart.

        And for changes of their speeds, by `faster_mps2` at most.
        """
        turn = hypot(limits.turn_rate_radps(speed_mps) * speed_mps, faster_mps2)
        pull = limits.pitch_rate_radps(speed_mps) * speed_mps
        sagitta = 2.0 * step_s * step_s / 8.0
        return Required(self.horizontal_m + turn * sagitta, self.vertical_m + pull * sagitta)


@dataclass(frozen=True, slots=True)
class Growth:
    """How fast the distances required of a pair grow with the age of what is known of it."""

    horizontal_mps: float = 0.0
    vertical_mps: float = 0.0

    def __bool__(self) -> bool:
        """Whether anything grows."""
        return self.horizontal_mps > 0.0 or self.vertical_mps > 0.0

    def scale(self, required: Required, ages_s: Array, ratios: Array | None = None) -> Array:
        """Factors (..., 3) on relative positions that turn a grown cylinder into the required one.

        `ages_s` (...) are those of both UAVs together. What is laid on the required cylinder
        afterwards (margin, widening) grows in proportion. With `ratios` (..., 2) pairs require so
        many times as much before anything grows, horizontally and vertically.
        """
        many = np.ones(2) if ratios is None else ratios
        horizontal = required.horizontal_m * many[..., 0] + self.horizontal_mps * ages_s
        vertical = required.vertical_m * many[..., 1] + self.vertical_mps * ages_s
        level, upright = required.horizontal_m / horizontal, required.vertical_m / vertical
        return np.stack([level, level, upright], axis=-1)


NO_GROWTH = Growth()


def normalised_separation(relative_m: Array, required: Required) -> Array:
    """max(horizontal / required, vertical / required) of positions (..., 3); < 1 is a loss."""
    north, east = relative_m[..., 0], relative_m[..., 1]
    horizontal = np.sqrt(north * north + east * east)
    return np.maximum(
        horizontal / required.horizontal_m, np.abs(relative_m[..., 2]) / required.vertical_m
    )


def first_overlap_s(relative_m: Array, times_s: Array, required: Required) -> Array:
    """Time of the first overlap along relative trajectories (..., n, 3); inf where there is none.

    `times_s` has shape (n,), increasing. Risk (eq. 9) is `isfinite` of the result.
    """
    shape = relative_m.shape[:-2]
    flat = relative_m.reshape(-1, len(times_s), 3)
    row, chord, enter = chord_overlaps(flat, required)
    first = np.full(len(flat), np.inf)
    steps_s = times_s[1:] - times_s[:-1]
    np.minimum.at(first, row, times_s[chord] + enter * steps_s[chord])
    return first.reshape(shape)


def chord_overlaps(
    relative_m: Array, required: Required
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Overlaps on the chords of relative trajectories (m, n, 3): row, chord, fraction at entry."""
    step = relative_m[:, 1:] - relative_m[:, :-1]
    row, chord = np.nonzero(_possible(relative_m, step, required))
    if not len(row):
        return row, chord, np.empty(0)
    enter, leave = _overlap_fraction(relative_m[row, chord], step[row, chord], required)
    hit = enter < leave
    return row[hit], chord[hit], enter[hit]


def _possible(start: Array, step: Array, required: Required) -> NDArray[np.bool_]:
    """Cheap test: intervals whose chord can come near enough at all, shape (rows, n-1)."""
    reach = np.abs(step[..., 0]) + np.abs(step[..., 1]) + required.horizontal_m
    north, east = start[:, :-1, 0], start[:, :-1, 1]
    near = north * north + east * east < reach * reach
    return near & (np.abs(start[:, :-1, 2]) < np.abs(step[..., 2]) + required.vertical_m)


def _overlap_fraction(start: Array, step: Array, required: Required) -> tuple[Array, Array]:
    """Fractions of the chord at which it enters and leaves the cylinder (enter >= leave: never)."""
    (north, east), (to_north, to_east) = start[:, :2].T, step[:, :2].T
    a = to_north * to_north + to_east * to_east
    b = north * to_north + east * to_east
    c = north * north + east * east - required.horizontal_m * required.horizontal_m
    root = b * b - a * c
    inside = np.where(c < 0.0, np.inf, -np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.sqrt(np.maximum(root, 0.0))
        moving = (a > 1e-12) & (root > 0.0)
        enter_h = np.where(moving, (-b - half) / a, -inside)
        leave_h = np.where(moving, (-b + half) / a, inside)
        rise = step[:, 2]
        bound = required.vertical_m
        t1, t2 = (-bound - start[:, 2]) / rise, (bound - start[:, 2]) / rise
    level = np.abs(rise) < 1e-12
    inside_v = np.where(np.abs(start[:, 2]) < bound, np.inf, -np.inf)
    enter_v = np.where(level, -inside_v, np.minimum(t1, t2))
    leave_v = np.where(level, inside_v, np.maximum(t1, t2))
    return (
        np.maximum(np.maximum(enter_h, enter_v), 0.0),
        np.minimum(np.minimum(leave_h, leave_v), 1.0),
    )


def sample_times(horizon_s: float, step_s: float) -> Array:
    """0 to `horizon_s` in equal steps of at most `step_s`."""
    return np.linspace(0.0, horizon_s, max(1, math.ceil(horizon_s / step_s)) + 1)
