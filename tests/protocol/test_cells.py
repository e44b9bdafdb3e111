"""Cells: whoever is within range is in a cell that is listened to, and no message has two."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.model.radio import RadioRange
from fleet.model.types import COORDINATOR, Position
from fleet.protocol.cells import Cells, cells_for, is_cell, names_in
from fleet.protocol.topics import cell_in, in_cells, subscribed, topic_of, topics_for
from tests.support.samples import SAMPLES, adsb, election, heartbeat

coordinates = st.floats(-1e6, 1e6)
KINDS = ("adsb", "heartbeat", "election", "cmd", "ack")
"""Classes whose subscriptions are told here, one by one; there may be further ones."""
ranges = st.sampled_from([0.5, 30.0, 500.0, 5000.0, 1e8])


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ((0.0, 0.0, -300.0), "0_0"),
        ((999.9, 1000.0, -300.0), "0_1"),
        ((-0.1, 2500.0, -300.0), "-1_2"),
        ((-1000.0, -1000.1, -300.0), "-1_-2"),
    ],
)
def test_cells_are_numbered_from_the_origin_north_and_east(place: Position, name: str) -> None:
    assert Cells(1000.0, 1100.0).name(place) == name
    assert is_cell(name)


@pytest.mark.parametrize("name", ["", "0", "1_", "01_0", "-0_0", "1_2_3", "*_*", "a_b", "1.5_0"])
def test_no_other_text_names_a_cell(name: str) -> None:
    assert not is_cell(name)


@given(
    st.tuples(coordinates, coordinates, coordinates), ranges, st.floats(0.0, 1.0), st.floats(0, 7)
)
def test_who_is_within_range_and_margin_is_in_a_cell_that_is_listened_to(
    here: Position, range_m: float, part: float, bearing_rad: float
) -> None:
    cells = cells_for(RadioRange(range_m, None, margin_m=62.5))
    assert cells is not None
    away_m = part * (range_m + 62.5)
    north_m, east_m = away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad)
    listened = [*names_in(cells.block(here))]
    assert cells.name((here[0] + north_m, here[1] + east_m, 0.0)) in listened
    assert len(listened) == len({*listened}) <= 5 * 5


def test_without_a_range_there_are_no_cells() -> None:
    assert cells_for(RadioRange(None, 1000.0, 50.0)) is None
    assert subscribed(3, topics_for(3), None) == [*topics_for(3)]


def test_a_uav_subscribes_to_cells_and_to_what_the_coordinator_says() -> None:
    topics = [t for t in topics_for(3) if t.partition("/")[0] in KINDS]
    assert subscribed(3, topics, ["1_0", "0_0"]) == [
        *("adsb/0_0", "adsb/1_0", "heartbeat"),
        *("election", "election/0_0", "election/1_0", "cmd/3", "ack/3"),
    ]
    topics = [t for t in topics_for(COORDINATOR) if t.partition("/")[0] in KINDS]
    assert subscribed(COORDINATOR, topics, ["1_0"]) == ["adsb/*"]
    assert subscribed(3, (), ["1_0"]) == []


def test_what_uavs_tell_all_others_goes_to_cells_and_nothing_else_does() -> None:
    own = election(5, (2, 3), 2, 0, elector=2)
    assert topic_of(own, "3_-2") == "2/election/3_-2"
    assert topic_of(election(4, (2, 3), 2, 0), "3_-2") == "coordinator/election"
    assert topic_of(adsb(7), "3_-2") == "7/adsb/3_-2"
    assert topic_of(heartbeat(0), "3_-2") == "coordinator/heartbeat"
    assert [in_cells(m) for m in (adsb(7), heartbeat(0))] == [True, False]
    for message in SAMPLES:
        if not in_cells(message):
            assert topic_of(message, "3_-2") == topic_of(message)
        else:
            assert cell_in(topic_of(message, "3_-2")) == "3_-2"
