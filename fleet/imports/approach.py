"""When straight flights come nearest to each other."""

from __future__ import annotations

import numpy as np

from fleet.model.types import Array

LONGEST_WAIT_S = 3600.0
"""What comes later is not waited for, as of two that fly nearly abreast."""


def latest_approach_s(places_m: Array, velocities_mps: Array, within_m: float) -> float:
    """Time of the latest closest point of approach of two of them, horizontally; 0 if none comes.

    Of pairs that come as near as `within_m` then; if no pair does, of all. Places and velocities
    are of shape (n, 2).
    """
    latest_near, latest = 0.0, 0.0
    for k in range(len(places_m) - 1):
        apart, faster = places_m[k + 1 :] - places_m[k], velocities_mps[k + 1 :] - velocities_mps[k]
        squared = (faster * faster).sum(axis=1)
        moving = squared > 1e-6
        times = np.zeros(len(apart))
        times[moving] = -(apart * faster).sum(axis=1)[moving] / squared[moving]
        times = np.maximum(times, 0.0)
        times[times > LONGEST_WAIT_S] = 0.0
        least = np.linalg.norm(apart + times[:, None] * faster, axis=1)
        latest = max(latest, float(times.max()))
        near = least <= within_m
        if near.any():
            latest_near = max(latest_near, float(times[near].max()))
    return latest_near or latest
