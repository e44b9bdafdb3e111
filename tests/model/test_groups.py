"""Conflicts between reports, and the groups they make."""

from __future__ import annotations

import math
import random

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.scenario import Scenario
from fleet.model.conflict.detection import conflicts, trajectories
from fleet.model.conflict.groups import Grouping, commanded, connected
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required, first_overlap_s, sample_times
from fleet.model.conflict.tracks import ActiveManoeuvre, CommandId, StateReport
from fleet.model.types import Pair
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent

MODELS = Scenario("groups", 100.0).models()
OUTLOOK = Outlook(MODELS, sample_times(40.0, 1.0), Required(400.0, 50.0))
NOW_NS = 5_000_000_000
SETTINGS = settings(deadline=None, derandomize=True, max_examples=100)

nodes = st.integers(1, 25)
edge_lists = st.lists(st.tuples(nodes, nodes).filter(lambda e: e[0] != e[1]), max_size=30)
randoms = st.randoms(use_true_random=False)


def report(
    uav: int,
    place: tuple[float, float, float],
    heading_rad: float,
    *,
    age_s: float = 0.0,
    manoeuvre: ActiveManoeuvre | None = None,
) -> StateReport:
    """A UAV at 25 m/s that guidance would keep straight and level."""
    state = State(*place, 25.0, heading_rad)
    t_ns = NOW_NS - round(age_s * 1e9)
    return StateReport(
        uav, t_ns, state, Intent(heading_rad, 0.0), FlightPlan((place,), heading_rad), manoeuvre
    )


def head_on(distance_m: float = 2000.0, age_s: float = 0.0) -> list[StateReport]:
    return [
        report(1, (0.0, 0.0, -300.0), 0.0),
        report(2, (distance_m, 0.0, -300.0), math.pi, age_s=age_s),
    ]


def traffic(rng: random.Random, count: int) -> list[StateReport]:
    out = []
    for uav in range(1, count + 1):
        place = (rng.uniform(-2e3, 2e3), rng.uniform(-2e3, 2e3), rng.uniform(-350.0, -250.0))
        heading = rng.uniform(-math.pi, math.pi)
        turn = ActiveManoeuvre("turn", rng.uniform(-math.pi, math.pi), 0.0)
        manoeuvre = turn if rng.random() < 0.3 else None
        out.append(report(uav, place, heading, age_s=rng.uniform(0.0, 2.0), manoeuvre=manoeuvre))
    return out


def unordered(found: dict[Pair, float]) -> dict[frozenset[int], float]:
    return {frozenset(pair): time_s for pair, time_s in found.items()}


def reference_components(edges: list[Pair]) -> list[tuple[int, ...]]:
    """By merging each edge with all the sets it touches."""
    groups: list[set[int]] = []
    for edge in edges:
        touched = [g for g in groups if g & set(edge)]
        groups = [g for g in groups if not g & set(edge)] + [set(edge).union(*touched)]
    return sorted(tuple(sorted(g)) for g in groups)


@SETTINGS
@given(edge_lists)
def test_groups_are_the_connected_components(edges: list[Pair]) -> None:
    assert connected(edges) == reference_components(edges)


@SETTINGS
@given(edge_lists, randoms)
def test_groups_do_not_depend_on_the_order_or_sense_of_the_pairs(
    edges: list[Pair], rng: random.Random
) -> None:
    shuffled = [(b, a) if rng.random() < 0.5 else (a, b) for a, b in edges]
    rng.shuffle(shuffled)
    assert connected(shuffled) == connected(edges)


@SETTINGS
@given(edge_lists)
def test_groups_share_no_member_and_hold_every_pair_whole(edges: list[Pair]) -> None:
    groups = connected(edges)
    members = [uav for group in groups for uav in group]
    assert len(members) == len(set(members))
    assert all(any(a in group and b in group for group in groups) for a, b in edges)


def test_nobody_is_grouped_without_a_conflict() -> None:
    assert connected([]) == []


def test_a_chain_is_one_group() -> None:
    assert connected([(3, 4), (1, 2), (2, 3), (8, 9)]) == [(1, 2, 3, 4), (8, 9)]


@pytest.mark.parametrize("distance", [500.0, 1234.5, 2000.0])
def test_a_head_on_pair_is_found_with_its_time_to_violation(distance: float) -> None:
    found = conflicts(head_on(distance), NOW_NS, OUTLOOK)
    assert found == {(1, 2): pytest.approx((distance - 400.0) / 50.0)}


def test_an_old_report_is_flown_on_to_the_present() -> None:
    found = conflicts(head_on(2000.0, age_s=2.0), NOW_NS, OUTLOOK)
    assert found == {(1, 2): pytest.approx((2000.0 - 50.0 - 400.0) / 50.0)}


@pytest.mark.parametrize("distance", [2401.0, 10_000.0])
def test_a_violation_beyond_the_horizon_is_no_conflict(distance: float) -> None:
    assert conflicts(head_on(distance), NOW_NS, OUTLOOK) == {}


def test_height_alone_keeps_a_pair_out_of_conflict() -> None:
    one, _ = head_on()
    assert conflicts([one, report(2, (2000.0, 0.0, -350.0), math.pi)], NOW_NS, OUTLOOK) == {}


def test_a_parting_pair_is_not_in_conflict() -> None:
    pair = [report(1, (0.0, 0.0, -300.0), math.pi), report(2, (500.0, 0.0, -300.0), 0.0)]
    assert conflicts(pair, NOW_NS, OUTLOOK) == {}


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_reports_make_no_conflict(count: int) -> None:
    assert conflicts(head_on()[:count], NOW_NS, OUTLOOK) == {}


def test_a_manoeuvre_that_guidance_would_undo_keeps_the_pair_in_conflict() -> None:
    """Both turn away for good; released now they would still meet."""
    away = [
        report(1, (0.0, 0.0, -300.0), 0.0, manoeuvre=ActiveManoeuvre("turn", math.pi / 2, 0.0)),
        report(
            2, (2000.0, 0.0, -300.0), math.pi, manoeuvre=ActiveManoeuvre("turn", -math.pi / 2, 0.0)
        ),
    ]
    paths = trajectories(away, NOW_NS, OUTLOOK)
    flown = first_overlap_s(paths[0] - paths[1], OUTLOOK.times_s, OUTLOOK.required)
    assert not np.isfinite(flown)
    assert conflicts(away, NOW_NS, OUTLOOK) == {(1, 2): pytest.approx(32.0)}


def test_a_manoeuvre_into_another_is_a_conflict() -> None:
    """Guidance would keep them 990 m apart; the turn to the east makes them meet head on."""
    east = ActiveManoeuvre("turn", math.pi / 2, 0.0)
    other = report(2, (100.0, 1500.0, -300.0), -math.pi / 2)
    assert conflicts([report(1, (0.0, 0.0, -300.0), 0.0), other], NOW_NS, OUTLOOK) == {}
    turned = report(1, (0.0, 0.0, -300.0), 0.0, manoeuvre=east)
    assert list(conflicts([turned, other], NOW_NS, OUTLOOK)) == [(1, 2)]


@SETTINGS
@given(st.integers(0, 10**6), st.integers(2, 8), randoms)
def test_conflicts_do_not_depend_on_the_order_of_the_reports(
    seed: int, count: int, rng: random.Random
) -> None:
    reports = traffic(random.Random(seed), count)
    found = unordered(conflicts(reports, NOW_NS, OUTLOOK))
    shuffled = list(reports)
    rng.shuffle(shuffled)
    assert unordered(conflicts(shuffled, NOW_NS, OUTLOOK)) == pytest.approx(found)


@SETTINGS
@given(st.integers(0, 10**6), st.integers(3, 8))
def test_a_pair_is_in_conflict_whoever_else_flies(seed: int, count: int) -> None:
    """The coarse choice of near pairs leaves nothing out and puts nothing in."""
    reports = traffic(random.Random(seed), count)
    together = conflicts(reports, NOW_NS, OUTLOOK)
    alone: dict[Pair, float] = {}
    for i, one in enumerate(reports):
        for two in reports[i + 1 :]:
            alone |= conflicts([one, two], NOW_NS, OUTLOOK)
    assert together == pytest.approx(alone)


def test_pairs_name_the_lower_id_first_whatever_the_order_of_the_reports() -> None:
    assert list(conflicts(head_on()[::-1], NOW_NS, OUTLOOK)) == [(1, 2)]


# Inertia

HOLD_NS = 2_000_000_000
STEP_NS = 200_000_000


def test_a_pair_stays_grouped_for_the_hold_after_it_was_last_at_risk() -> None:
    grouping = Grouping(HOLD_NS)
    assert grouping.groups([(1, 2)], 0) == [(1, 2)]
    assert grouping.groups([], HOLD_NS) == [(1, 2)]
    assert grouping.groups([], HOLD_NS + 1) == []
    assert grouping.groups([], 2 * HOLD_NS) == []


def test_without_a_hold_groups_are_those_at_risk_now() -> None:
    grouping = Grouping(0)
    assert grouping.groups([(1, 2)], 0) == [(1, 2)]
    assert grouping.groups([(3, 4)], STEP_NS) == [(3, 4)]


def test_a_pair_at_risk_again_is_held_from_then_on() -> None:
    grouping = Grouping(HOLD_NS)
    grouping.groups([(1, 2)], 0)
    grouping.groups([(2, 1), (1, 2)], HOLD_NS)
    assert grouping.groups([], 2 * HOLD_NS) == [(1, 2)]


def test_a_held_pair_joins_groups_as_one_at_risk_does() -> None:
    grouping = Grouping(HOLD_NS)
    grouping.groups([(1, 2)], 0)
    assert grouping.groups([(2, 3)], HOLD_NS) == [(1, 2, 3)]
    assert grouping.groups([(2, 3)], HOLD_NS + 1) == [(2, 3)]


sorted_edges = st.lists(
    st.tuples(st.integers(1, 8), st.integers(1, 8)).filter(lambda e: e[0] < e[1]), max_size=4
)


@SETTINGS
@given(st.lists(sorted_edges, max_size=25), st.integers(0, 12))
def test_groups_are_the_components_of_all_pairs_within_the_hold(
    run_data: list[list[Pair]], hold_steps: int
) -> None:
    grouping = Grouping(hold_steps * STEP_NS)
    for n, pairs in enumerate(run_data):
        recent = [e for then in run_data[max(0, n - hold_steps) : n + 1] for e in then]
        assert grouping.groups(pairs, n * STEP_NS) == reference_components(recent)


@SETTINGS
@given(st.sets(st.integers(0, 60)))
def test_a_pair_lost_for_less_than_the_hold_never_leaves_its_group(lost: set[int]) -> None:
    """However its broadcasts come and go, as long as one in ten comes."""
    grouping = Grouping(HOLD_NS)
    kept = [n for n in range(61) if n % 10 == 0 or n not in lost]
    for n in range(61):
        assert grouping.groups([(1, 2)] if n in kept else [], n * STEP_NS) == [(1, 2)]


def test_who_is_under_command_makes_a_pair_with_an_issuer_that_is_present() -> None:
    turn = ActiveManoeuvre("turn", 1.0, 0.0)

    def under(uav: int, issuer: int, manoeuvre: ActiveManoeuvre | None = turn) -> StateReport:
        made = report(uav, (0.0, 0.0, -300.0), 0.0, manoeuvre=manoeuvre)
        return msgspec.structs.replace(made, command_id=CommandId(4, issuer, 1))

    reports = [under(1, 9), under(2, 2), under(3, 1), under(4, 1, None), under(5, 6), under(6, 5)]
    assert sorted(commanded(reports)) == [(1, 3), (5, 6), (5, 6)]
