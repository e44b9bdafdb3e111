"""Ranks of manoeuvres of which none is safe: those of all samples of all others."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.agents.geometry import Others
from fleet.agents.ranks import RANKED, ranks
from fleet.model.conflict.risk import Growth, Required
from fleet.model.types import Array

REQUIRED = Required(100.0, 30.0)


def lines(rng: np.random.Generator, count: int, spread_m: float) -> Array:
    """Straight trajectories (count, 41, 3)."""
    start = rng.uniform(-spread_m, spread_m, (count, 1, 3)) * (1.0, 1.0, 0.05)
    step = rng.uniform(-25.0, 25.0, (count, 1, 3)) * (1.0, 1.0, 0.05)
    return np.asarray(start + step * np.arange(41.0)[:, None])


def by_all(paths: Array, others: Others) -> list[float]:
    """Pair by pair: the least, and a fiftieth of the mean of what counts."""
    scale = np.ones((len(others), 1, 3)) if others.scale is None else others.scale
    out = []
    for path in paths:
        relative = (path - others.paths) * scale
        level = np.sqrt(relative[..., 0] ** 2 + relative[..., 1] ** 2) / 100.0
        nearest = np.maximum(level, np.abs(relative[..., 2]) / 30.0).min(axis=0)
        out.append(nearest.min() + 0.02 * np.minimum(nearest, RANKED).mean())
    return out


@pytest.mark.parametrize("spread_m", [200.0, 1000.0, 5000.0])
@pytest.mark.parametrize("grown", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_ranks(seed: int, grown: bool, spread_m: float) -> None:
    rng = np.random.default_rng(seed)
    paths, far = lines(rng, 12, 300.0), lines(rng, 15, spread_m)
    scale = Growth(5.0, 1.0).scale(REQUIRED, rng.uniform(0.0, 9.0, (15, 1))) if grown else None
    others = Others(far, scale)
    assert ranks(paths, others, REQUIRED) == pytest.approx(by_all(paths, others), rel=1e-12)
