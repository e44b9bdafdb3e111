"""Trajectories compared in blocks: what is found is what comparing all samples finds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.conflict import blocks
from fleet.model.conflict.blocks import (
    BLOCK,
    chords_within,
    first_overlaps_s,
    in_blocks,
    in_blocks_s,
    least_separations,
)
from fleet.model.conflict.risk import (
    Growth,
    Required,
    chord_overlaps,
    first_overlap_s,
    normalised_separation,
)
from fleet.model.types import Array

REQUIRED = Required(400.0, 50.0)
SETTINGS = settings(deadline=None, derandomize=True, max_examples=80)
counts = st.sampled_from([2, 3, BLOCK, BLOCK + 1, BLOCK + 2, 41, 81])
seeds = st.integers(0, 2**32)


def curves(rng: np.random.Generator, many: int, count: int, spread_m: float) -> Array:
    """Trajectories (many, count, 3) that wind, climb and sometimes stand still."""
    start = rng.uniform(-spread_m, spread_m, (many, 1, 3)) * (1.0, 1.0, 0.05)
    heading = rng.uniform(-np.pi, np.pi, (many, 1)) + np.cumsum(
        rng.uniform(-0.2, 0.2, (many, count - 1)), axis=1
    )
    speed = rng.choice([0.0, 12.0, 40.0], (many, 1))
    climb = rng.uniform(-4.0, 4.0, (many, 1)) * np.ones((1, count - 1))
    steps = np.stack([speed * np.cos(heading), speed * np.sin(heading), climb], axis=-1)
    return np.concatenate([start, start + np.cumsum(steps, axis=1)], axis=1)


@given(seeds, counts, st.integers(1, 9), st.integers(0, 7), st.sampled_from([300.0, 3000.0]))
@SETTINGS
def test_first_overlaps_are_those_of_all_samples(
    seed: int, count: int, many: int, others: int, spread_m: float
) -> None:
    rng = np.random.default_rng(seed)
    one, other = curves(rng, many, count, spread_m), curves(rng, others, count, spread_m)
    times = np.linspace(0.0, count - 1.0, count)
    scale = Growth(5.0, 1.0).scale(REQUIRED, rng.uniform(0.0, 9.0, (others, 1)))
    for laid_on in (None, scale):
        relative = one[:, None] - other[None]
        wanted = first_overlap_s(
            relative if laid_on is None else relative * laid_on, times, REQUIRED
        )
        by_blocks = in_blocks_s(in_blocks(one[:, None]), in_blocks(other), times, REQUIRED, laid_on)
        assert by_blocks.tobytes() == wanted.tobytes()
        found = first_overlaps_s(one[:, None], other, times, REQUIRED, laid_on)
        assert found.tobytes() == wanted.tobytes()


@given(seeds, st.integers(1, 4), st.integers(1, 5))
@SETTINGS
def test_each_can_have_others_of_its_own(seed: int, many: int, others: int) -> None:
    rng = np.random.default_rng(seed)
    one = curves(rng, many, 41, 900.0)
    own = curves(rng, many * others, 41, 900.0).reshape(many, others, 41, 3)
    times = np.linspace(0.0, 40.0, 41)
    found = in_blocks_s(in_blocks(one[:, None]), in_blocks(own), times, REQUIRED)
    assert found.tolist() == first_overlap_s(one[:, None] - own, times, REQUIRED).tolist()


@given(seeds, counts, st.integers(1, 16), st.integers(1, 20), st.sampled_from([300.0, 3000.0]))
@SETTINGS
def test_the_least_separation_is_that_of_all_chords(
    seed: int, count: int, many: int, others: int, spread_m: float
) -> None:
    """Held against many points on every chord of every pair."""
    rng = np.random.default_rng(seed)
    one, other = curves(rng, many, count, spread_m), curves(rng, others, count, spread_m)
    relative = one[:, None] - other[None]
    share = blocks.BETWEEN[:, None]
    start, step = relative[:, :, :-1, None], np.diff(relative, axis=2)[:, :, :, None]
    wanted = normalised_separation(start + share * step, REQUIRED).min(axis=(1, 2, 3))
    found = least_separations(one, other, REQUIRED)
    assert found == pytest.approx(wanted, rel=1e-12)


def test_flights_that_stay_apart_are_not_compared_by_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows: list[int] = []

    def counted(relative_m: Array, required: Required) -> Any:
        rows.append(len(relative_m))
        return chord_overlaps(relative_m, required)

    monkeypatch.setattr(blocks, "chord_overlaps", counted)
    times = np.linspace(0.0, 80.0, 81)
    one = np.stack([25.0 * times, 0.0 * times, 0.0 * times - 300.0], axis=-1)
    across = np.stack([0.0 * times + 1000.0, 25.0 * times - 1000.0, 0.0 * times - 300.0], axis=-1)
    apart = across + np.array((0.0, 0.0, 2000.0))
    others = in_blocks(np.stack([across, apart]))
    first = in_blocks_s(in_blocks(one[None, None]), others, times, REQUIRED)
    assert first[0, 0] == pytest.approx(40.0 - 400.0 / (25.0 * 2**0.5))
    assert np.isinf(first[0, 1])
    assert sum(rows) < 6


@given(seeds, counts, st.integers(1, 9), st.integers(1, 9), st.sampled_from([0.5, 1.0, 3.0]))
@SETTINGS
def test_beyond_the_chords_within_a_separation_all_stay_apart(
    seed: int, count: int, many: int, others: int, separation: float
) -> None:
    rng = np.random.default_rng(seed)
    paths, far = curves(rng, many, count, 800.0), curves(rng, others, count, 1500.0)
    beyond = ~chords_within(paths, far, REQUIRED, separation)
    part = np.linspace(0.0, 1.0, 7)[:, None, None]
    relative = (paths[:, None] - far)[:, :, None]
    between = (1.0 - part) * relative[..., :-1, :] + part * relative[..., 1:, :]
    least = normalised_separation(between, REQUIRED).min(axis=(0, 2))
    assert (least[beyond] >= separation).all()
