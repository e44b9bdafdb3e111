"""What factors do to an outcome: Sobol indices, and main effects of grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.errors import ArgumentError
from fleet.model.types import Array
from fleet.study.statistics.main_effects import main_effects
from fleet.study.statistics.sensitivity import saltelli_points, sobol_shares


def ishigami(unit: Array) -> Array:
    """The function that sensitivity methods are tried on, with a = 7 and b = 0.1."""
    x = math.pi * (2 * unit - 1)
    return np.asarray(
        np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    )


def ishigami_indices() -> tuple[tuple[float, float], ...]:
    """First and total index of each factor, in closed form (Ishigami and Homma 1990)."""
    a, b, pi = 7.0, 0.1, math.pi
    one = (1 + b * pi**4 / 5) ** 2 / 2
    two, both = a * a / 8, 8 * b * b * pi**8 / 225
    total = one + two + both
    return (one / total, (one + both) / total), (two / total,) * 2, (0.0, both / total)


def test_sobol_indices_of_a_known_function_are_found_within_their_intervals() -> None:
    found = sobol_shares("xyz", ishigami(saltelli_points(3, 2048, seed=1)), seed=2)
    for share, (first, total) in zip(found, ishigami_indices(), strict=True):
        assert share.first.covers(first)
        assert share.total.covers(total)
        assert share.first.value == pytest.approx(first, abs=0.02)
        assert share.total.value == pytest.approx(total, abs=0.02)
        assert 0.01 < share.first.half_width < 0.06
    assert [share.factor for share in found] == ["x", "y", "z"]
    assert found[0].first.runs == 2048 * 5


def test_a_saltelli_design_exchanges_one_column_at_a_time() -> None:
    points = saltelli_points(3, 8, seed=4).reshape(5, 8, 3)
    for k in range(3):
        others = [j for j in range(3) if j != k]
        assert (points[2 + k][:, k] == points[1][:, k]).all()
        assert (points[2 + k][:, others] == points[0][:, others]).all()
    assert (saltelli_points(3, 8, seed=4) == points.reshape(-1, 3)).all()
    # each eighth of a factor has one point of A
    assert (np.sort(np.floor(8 * points[0]), axis=0) == np.arange(8)[:, None]).all()


def test_where_nothing_changes_no_factor_has_a_share() -> None:
    (alone,) = sobol_shares(["latency"], np.full(24, 3.0), seed=1)
    assert math.isnan(alone.first.value)
    assert (alone.total.low, alone.total.high) == (0.0, 1.0)


def test_the_interval_stays_the_same_with_the_seed() -> None:
    outcome = ishigami(saltelli_points(3, 64, seed=1))
    assert sobol_shares("xyz", outcome, seed=2) == sobol_shares("xyz", outcome, seed=2)
    assert sobol_shares("xyz", outcome, seed=2) != sobol_shares("xyz", outcome, seed=3)


@pytest.mark.parametrize("rows", [0, 15, 26, 30])
def test_another_number_of_rows_than_that_of_a_design_is_refused(rows: int) -> None:
    with pytest.raises(ArgumentError, match="a power of two times 5 rows"):
        sobol_shares("xyz", np.arange(float(rows)), seed=1)
    with pytest.raises(ArgumentError, match="power of two as size"):
        saltelli_points(3, 12, seed=1)


def grid(seed: int, runs: int = 40, noise: float = 3.0, common: float = 5.0) -> Array:
    """Effects of two factors and both together, with noise, and what a run adds everywhere."""
    rng = np.random.default_rng(seed)
    one, other = np.arange(4)[:, None, None], np.arange(3)[None, :, None]
    of_run = common * rng.normal(size=runs)
    own = noise * rng.normal(size=(4, 3, runs))
    return np.asarray(one + 2 * other + 0.5 * one * other + of_run + own)


def test_shares_of_a_grid_without_noise_are_those_of_its_effects() -> None:
    found = main_effects(["a", "b"], grid(1, noise=0.0), seed=1)
    assert found.factors["a"].value == pytest.approx(2.8125 / 8.0625)
    assert found.factors["b"].value == pytest.approx(2.75**2 * 2 / 3 / 8.0625)
    assert found.interactions.value == pytest.approx(1 - (2.8125 + 2.75**2 * 2 / 3) / 8.0625)
    assert found.between_conditions.value == pytest.approx(math.sqrt(8.0625))


def test_noise_of_runs_makes_no_effect() -> None:
    """On average nothing is left between conditions that differ by their runs alone."""
    rng = np.random.default_rng(3)
    left, lower = [], []
    for _ in range(100):
        y = rng.normal(size=(3, 2, 10)) + 4 * rng.normal(size=10)
        found = main_effects(["a", "b"], y, seed=1, resamples=60)
        left.append(found.between_conditions.value)
        lower.append(found.between_conditions.low)
    assert np.mean([v == 0 for v in left]) > 0.4  # as often below nothing as above
    assert np.mean(np.square(left)) < 0.05  # the means alone differ by 0.1
    assert np.mean([v == 0 for v in lower]) > 0.9


def test_shares_of_a_noisy_grid_are_covered() -> None:
    truth = (2.8125 / 8.0625, 2.75**2 * 2 / 3 / 8.0625)
    covered = np.zeros(2)
    for seed in range(40):
        found = main_effects(["a", "b"], grid(seed), seed=seed, resamples=200)
        covered += [e.covers(t) for e, t in zip(found.factors.values(), truth, strict=True)]
    assert (covered >= 35).all()


def test_what_is_no_grid_is_refused() -> None:
    for outcome in (np.zeros((3, 4)), np.zeros((3, 1, 5)), np.zeros((3, 4, 1)), np.zeros(7)):
        with pytest.raises(ArgumentError, match="an axis of at least two values for each of 2"):
            main_effects(["a", "b"], outcome, seed=1)
    with pytest.raises(ArgumentError, match="finite"):
        main_effects(["a"], [[1.0, math.inf], [1.0, 2.0]], seed=1)
    still = main_effects(["a"], np.zeros((3, 4)), seed=1)
    assert math.isnan(still.factors["a"].value)
