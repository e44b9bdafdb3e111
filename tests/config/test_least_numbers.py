"""Bounds of a scenario's numbers: what is divided by is never next to nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

import fleet
from fleet.config.scenario import Scenario
from fleet.study.study_file import Study


def _from_nothing(schema: Any, where: str = "") -> Iterator[str]:
    """The places at which a schema has a number that may be as small as one likes, but not 0."""
    if isinstance(schema, dict):
        if schema.get("exclusiveMinimum") == 0.0:
            yield where
        for key, value in schema.items():
            yield from _from_nothing(value, f"{where}/{key}")
    elif isinstance(schema, list):
        for value in schema:
            yield from _from_nothing(value, where)


@pytest.mark.parametrize("kind", [Scenario, Study])
def test_no_positive_number_may_be_next_to_nothing(kind: type) -> None:
    assert [*_from_nothing(msgspec.json.schema(kind))] == []


@pytest.mark.parametrize(
    "key",
    [
        "performance.max_bank_deg",
        "performance.max_flight_path_deg",
        "performance.max_flight_path_rate_degps",
        "performance.max_acceleration_mps2",
        "performance.min_speed_share",
        "zone.radius_m",
        "guidance.climb_mps",
        "guidance.level_off_s",
        "resolution.horizon_s",
        "resolution.turn_cost",
        "surveillance.range_m",
        "duration_s",
    ],
)
def test_the_least_number_there_is_is_refused_by_its_key(key: str) -> None:
    with pytest.raises(fleet.ScenarioError, match=key):
        fleet.load_scenario("head_on", {key: 5e-324})
