"""What is logged of a choice: the candidates, with what was found of each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fleet.agents.advisory import Advisory, Candidate
from fleet.agents.decision_log import logged
from fleet.model.types import Array
from fleet.protocol import codec
from fleet.protocol.advisories import MOST_CANDIDATES, LoggedAdvisory
from fleet.protocol.messages import Decision
from tests.agents.test_geometric import craft, resolve

SPEED_MPS, AHEAD_S = 25.0, 80.0
TURN_RATE_RADPS = 9.80665 * math.tan(math.radians(30.0)) / SPEED_MPS
TIMES_S = np.arange(0.0, AHEAD_S + 1e-9, 0.02)
OWN, INTRUDER = craft(1, 0.0, 0.0, 0.0), craft(2, 1500.0, 60.0, 180.0)


def turned(turn_rad: float) -> Array:
    """Where UAV 2 is if it turns: an arc at the limit of 30 degrees of bank, then straight on."""
    rate = math.copysign(TURN_RATE_RADPS, turn_rad)
    arc_s = abs(turn_rad) / TURN_RATE_RADPS
    heading = math.pi + rate * np.minimum(TIMES_S, arc_s)
    radius_m = SPEED_MPS / rate
    north = 1500.0 + radius_m * (np.sin(heading) - math.sin(math.pi))
    east = 60.0 - radius_m * (np.cos(heading) - math.cos(math.pi))
    on_m = SPEED_MPS * np.maximum(TIMES_S - arc_s, 0.0)
    return np.stack([north + on_m * np.cos(heading), east + on_m * np.sin(heading)], axis=1)


def apart_m(turn_rad: float) -> Array:
    """Its distance from UAV 1, which flies north."""
    own = np.stack([SPEED_MPS * TIMES_S, 0.0 * TIMES_S], axis=1)
    return np.asarray(np.hypot(*(turned(turn_rad) - own).T))


def test_the_turns_of_eq_7_are_logged_with_what_an_integration_finds() -> None:
    """N_T = 13 over +-90 degrees; the required 400 m, with a margin of 5 percent."""
    candidates = resolve(OWN, INTRUDER)[2].candidates
    assert {c.manoeuvre for c in candidates} == {"turn"}
    turns = [math.radians(15.0 * k) for k in range(-6, 7) if k]
    assert [c.turn_rad for c in candidates] == pytest.approx(turns)
    assert 0 < sum(c.safe for c in candidates) < 12
    for c in candidates:
        distance_m = apart_m(c.turn_rad)
        inside = TIMES_S[distance_m < 420.0]
        assert c.safe == (not len(inside))
        assert c.least_separation == pytest.approx(distance_m.min() / 400.0, abs=0.01)
        if len(inside):
            assert c.first_overlap_s == pytest.approx(inside[0], abs=0.2)
        else:
            assert math.isinf(c.first_overlap_s)
        assert c.cost == pytest.approx(abs(c.turn_rad) / math.radians(90.0), abs=1e-5)


def test_the_chosen_candidate_is_the_cheapest_that_is_safe() -> None:
    """In this encounter each of the safe turns can be ended."""
    advisory = resolve(OWN, INTRUDER)[2]
    cheapest = min((c for c in advisory.candidates if c.safe), key=lambda c: c.cost)
    assert advisory.turn_rad == cheapest.turn_rad
    line = logged(advisory, INTRUDER)
    (chosen,) = [c for c in line.candidates if c.chosen]
    assert (chosen.manoeuvre, chosen.turn_rad, chosen.safe) == ("turn", cheapest.turn_rad, True)
    assert len(line.candidates) == len(advisory.candidates) == 12


def test_where_nothing_is_safe_all_families_are_logged_as_unsafe() -> None:
    pair = craft(1, 0.0, 0.0, 0.0), craft(2, 0.0, 100.0, 0.0)
    advisory = resolve(*pair)[2]
    line = logged(advisory, pair[1])
    assert (line.stage, line.unresolved) == ("least_bad", True)
    assert {c.manoeuvre for c in line.candidates} == {"turn", "climb", "turn_climb"}
    assert not any(c.safe for c in line.candidates)
    assert sum(c.chosen for c in line.candidates) == 1
    assert max(c.least_separation or 0.0 for c in line.candidates) == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize(("least", "unresolved"), [(0.999, True), (1.0, False), (100.0, False)])
def test_unresolved_is_logged_and_follows_from_the_predicted_separation(
    least: float, unresolved: bool
) -> None:
    line = logged(Advisory(2, "climb", climb_mps=2.0, least_separation=least), INTRUDER)
    assert line.unresolved is unresolved


def test_the_turn_is_worked_out_where_a_resolver_tells_only_the_heading() -> None:
    heading_rad = math.radians(-150.0)  # 30 degrees to the right of south
    turn = logged(Advisory(2, "turn", heading_rad=heading_rad), INTRUDER)
    assert math.degrees(turn.turn_rad) == pytest.approx(30.0)
    assert logged(Advisory(2, "climb", heading_rad, climb_mps=2.0), INTRUDER).turn_rad == 0.0
    assert logged(Advisory(9, "turn", heading_rad), None).turn_rad == 0.0


def test_what_a_resolver_does_not_tell_is_left_out() -> None:
    found = (Candidate("climb", climb_mps=2.0, first_overlap_s=math.inf), Candidate("turn", 0.5))
    line = logged(Advisory(2, "climb", climb_mps=2.0, candidates=found), INTRUDER)
    climb, turn = line.candidates
    assert climb.chosen
    assert not turn.chosen
    untold = (climb.level_down_m, climb.first_overlap_s, climb.least_separation, climb.cost)
    assert untold == (None,) * 4
    told = codec.encode(Decision(1, 0, 0, 4, (line,)))
    assert b"first_overlap_s" not in told
    assert codec.decode("1/decision", told) == Decision(1, 0, 0, 4, (line,))


def many(count: int) -> LoggedAdvisory:
    """A choice of the last of so many turns."""
    found = tuple(Candidate("turn", k * 1e-3) for k in range(count))
    return logged(Advisory(2, "turn", turn_rad=found[-1].turn_rad, candidates=found), INTRUDER)


def test_no_more_candidates_are_logged_than_a_reader_takes() -> None:
    assert many(3).candidates[-1].chosen
    line = many(MOST_CANDIDATES + 100)
    assert len(line.candidates) == MOST_CANDIDATES
    assert line.candidates[0].chosen
    assert [c.turn_rad for c in line.candidates[1:4]] == [0.0, 1e-3, 2e-3]
    codec.decode("1/decision", codec.encode(Decision(1, 0, 0, 4, (line,))))
