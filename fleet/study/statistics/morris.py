"""Which of many factors matter at all: Morris's elementary effects, with few runs a factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fleet.errors import ArgumentError
from fleet.model.types import Array
from fleet.study.statistics.estimate import numbers_of

GRID_VALUES = 4
"""How many values a factor has in the design: 0, 1/3, 2/3 and 1."""
JUMP = 2 / 3
"""How far a factor is moved at once, as Morris chose: half the values, plus half a step."""


@dataclass(frozen=True, slots=True)
class ElementaryEffect:
    """How an outcome changes as one factor goes from 0 to 1, in the unit of the outcome."""

    factor: str
    size: float
    """Mean absolute change (Morris's mu*); 0 if the factor does nothing."""
    mean: float
    """Mean change (mu); nearer to 0 than the size where the sign of the effect varies."""
    deviation: float
    """Standard deviation of changes (sigma): of interactions and curvature."""


def morris_points(factors: int, trajectories: int, seed: int) -> Array:
    """The design for `elementary_effects`, from 0 to 1: (trajectories (factors + 1), factors).

    In each trajectory each factor is moved once by `JUMP`, in random order, from a random start.

    Source: M. D. Morris, Technometrics 33 (1991), 161.

    Raises:
        ArgumentError: no factor, or fewer than two trajectories.
    """
    if factors < 1 or trajectories < 2:
        raise ArgumentError(
            f"expected factors and at least two trajectories, not {factors} and {trajectories}"
        )
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(trajectories):
        point = rng.integers(GRID_VALUES, size=factors) / (GRID_VALUES - 1)
        rows.append(point)
        for factor in rng.permutation(factors):
            point = point.copy()
            point[factor] += JUMP if point[factor] < 0.5 else -JUMP
            rows.append(point)
    return np.array(rows)


def elementary_effects(
    factors: Sequence[str], points: Array, outcome: ArrayLike
) -> tuple[ElementaryEffect, ...]:
    """What each factor does, from a Morris design and one outcome for each of its points.

    Fly all points with one seed, or what the seed does is taken for an effect.
    Few trajectories tell which factors matter, not how much: there is no interval.

    Source: F. Campolongo, J. Cariboni and A. Saltelli, Environmental Modelling & Software 22
    (2007), 1509, on the size.

    Raises:
        ArgumentError: points of another design, or numbers that are not finite.
    """
    count, given = len(factors), numbers_of("outcome", outcome)
    if points.shape != (len(given), count) or len(given) % (count + 1):
        raise ArgumentError(
            f"outcome: expected one for each of the points of {count} factors, "
            f"not {len(given)} of {points.shape}"
        )
    moves = np.diff(points.reshape(-1, count + 1, count), axis=1)
    changes = np.diff(given.reshape(-1, count + 1), axis=1)
    moved = np.abs(moves) > 0
    if not (moved.sum(axis=2) == 1).all() or not (moved.sum(axis=1) == 1).all():
        raise ArgumentError("points: expected trajectories that move each factor once")
    effects = np.einsum("tm,tmf->tf", changes, np.where(moved, 1 / np.where(moved, moves, 1), 0))
    return tuple(
        ElementaryEffect(
            name,
            float(np.abs(of_one).mean()),
            float(of_one.mean()),
            float(of_one.std(ddof=1)),
        )
        for name, of_one in zip(factors, effects.T, strict=True)
    )
