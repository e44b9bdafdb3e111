"""Small probabilities by subset simulation, against limits whose probability is known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import norm

from benchmarks.coverage_cases import ball, plane
from fleet.errors import ArgumentError
from fleet.model.types import Array
from fleet.study.statistics.subset import Limit, RareEvent, SubsetPlan, subset_simulation

SMALL = SubsetPlan(points=200, repeats=5)


def steps(probability: float, dimensions: int) -> Limit:
    """As the plane, in steps: many runs come to the same performance."""
    smooth = plane(probability, dimensions)
    return lambda points: np.where(
        (s := np.asarray(smooth(points))) <= 0, 0.0, np.ceil(3 * np.maximum(s, 0)) / 3
    )


@pytest.mark.parametrize("limit", [plane, ball, steps])
@pytest.mark.parametrize(("probability", "dimensions"), [(1e-3, 5), (1e-5, 40)])
def test_the_estimate_is_about_the_truth(
    limit: Callable[[float, int], Limit], probability: float, dimensions: int
) -> None:
    """The means of 20 estimates, whose errors are 30 to 50 percent each, are near it."""
    found = [
        subset_simulation(limit(probability, dimensions), dimensions, seed, SMALL)
        for seed in range(20)
    ]
    mean = np.mean([event.estimate.value for event in found])
    assert mean == pytest.approx(probability, rel=0.25)
    assert sum(event.estimate.covers(probability) for event in found) >= 17
    # 1e-5 by counting would take ten million runs for this variation
    assert max(event.estimate.runs for event in found) < 7000
    assert np.median([event.variation for event in found]) < 0.45


def test_an_event_that_is_not_rare_is_counted() -> None:
    found = subset_simulation(plane(0.3, 2), 2, seed=1, plan=SMALL)
    assert found.estimate.value == pytest.approx(0.3, abs=0.05)
    assert found.estimate.runs == 5 * 200
    assert all(repeat.thresholds == (0.0,) for repeat in found.repeats)


def test_an_interval_is_never_narrower_than_the_bias_of_chains() -> None:
    """Though all repeats agree."""
    found = subset_simulation(lambda points: np.zeros(len(points)), 2, seed=1, plan=SMALL)
    assert (found.estimate.value, found.estimate.high, found.variation) == (1.0, 1.0, 0.0)
    assert found.estimate.low == pytest.approx(math.exp(-2.776 * 5 / 200), abs=1e-4)


def test_thresholds_fall_to_the_event_and_all_points_are_counted() -> None:
    asked: list[int] = []
    limit = plane(1e-4, 3)

    def counted(points: Array) -> object:
        asked.append(len(points))
        return limit(points)

    found = subset_simulation(counted, 3, seed=3, plan=SMALL)  # type: ignore[arg-type]
    for repeat in found.repeats:
        assert list(repeat.thresholds) == sorted(repeat.thresholds, reverse=True)
        assert repeat.thresholds[-1] == 0
        assert len(repeat.thresholds) == pytest.approx(4, abs=1)
    assert sum(asked) == found.estimate.runs == sum(r.evaluations for r in found.repeats)
    assert asked[0] == 5 * 200  # first all points of all repeats at once
    assert asked[1] == 5 * 20  # then one step of all chains of all repeats


def test_repeats_are_independent_of_who_is_beside_them() -> None:
    """The first of several repeats is the same, however many go on beside it."""
    few, more = (
        subset_simulation(ball(1e-3, 4), 4, 9, SubsetPlan(points=100, repeats=n)) for n in (2, 4)
    )
    assert few.repeats == more.repeats[:2]
    assert len({repeat.probability for repeat in more.repeats}) > 1


def test_what_cannot_be_found_is_not_called_impossible() -> None:
    def flat(points: Array) -> Array:
        return np.ones(len(points))

    found = subset_simulation(flat, 2, seed=1, plan=SMALL)
    assert (found.estimate.value, found.estimate.low, found.estimate.high) == (0.0, 0.0, 1.0)
    assert found.variation == math.inf
    far = SubsetPlan(points=100, repeats=2, most_subsets=3)
    assert subset_simulation(plane(1e-9, 2), 2, 1, far).estimate.high == 1.0


def test_some_repeats_may_miss_what_others_find() -> None:
    """A small island that most repeats never see: none may claim to know it well."""

    def island(points: Array) -> Array:
        return np.where((np.abs(points - 2.0) < 0.4).all(axis=1), 0.0, 1.0)

    chance = float((norm.cdf(2.4) - norm.cdf(1.6)) ** 2)
    found: RareEvent = subset_simulation(island, 2, 2, SubsetPlan(points=200, repeats=4))
    assert any(repeat.probability == 0 for repeat in found.repeats)
    assert found.estimate.value > 0
    assert found.estimate.covers(chance)
    assert found.estimate.high > 5 * found.estimate.low


def test_the_same_seed_gives_the_same_estimate() -> None:
    one, same, other = (subset_simulation(plane(1e-3, 6), 6, seed, SMALL) for seed in (5, 5, 6))
    assert one == same
    assert one.estimate.value != other.estimate.value


def test_a_limit_or_plan_that_is_none_is_refused() -> None:
    with pytest.raises(ArgumentError, match="one number for each of 1000 points"):
        subset_simulation(lambda points: points, 2, 1, SMALL)
    with pytest.raises(ArgumentError, match="none of them nan"):
        subset_simulation(lambda points: points[:, 0] * math.nan, 2, 1, SMALL)
    with pytest.raises(ArgumentError, match="dimensions: expected at least one"):
        subset_simulation(plane(0.1, 1), 0, 1, SMALL)
    for wrong in ({"repeats": 1}, {"points": 5}, {"share": 0.0}, {"share": 0.9}):
        with pytest.raises(ArgumentError):
            SubsetPlan(**wrong)
