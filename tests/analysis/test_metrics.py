"""What the tests of the metrics share: runs made by hand, and runs in memory; and pairs.

Expected values are closed forms, or come from plain loops over the messages.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis import relative_motion as geometry
from fleet.analysis.metrics import (
    NMAC,
    PairMetrics,
    RecordedRun,
    RunMetrics,
    Volume,
    measure,
)
from fleet.analysis.recorded_run import RecordCollector
from fleet.analysis.separation import SeparationMonitor
from fleet.config.scenario import Scenario, Uav
from fleet.faults.rules import Rule
from fleet.log.reader import Record
from fleet.model.conflict.risk import Required
from fleet.model.units import to_ns
from fleet.protocol import codec
from fleet.protocol.messages import Conflict, Message, Truth
from fleet.protocol.topics import topic_of
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.analysis.test_check_story import apart, elect
from tests.support import samples

Point = tuple[float, float, float]
fast = settings(deadline=None, derandomize=True, max_examples=40)

FAR = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9e4, 0.0, -300.0),))


def recorded_run_of(scenario: Scenario, messages: Iterable[Message], **changes: Any) -> RecordedRun:
    """These messages and no other."""
    found = sorted(messages, key=lambda m: m.t_ns)
    records = [Record(topic_of(m), codec.encode(m), m.seq, m.t_ns, m.t_ns) for m in found]
    return RecordedRun.of_records(scenario, records, **changes)


def flown(scenario: Scenario) -> RecordedRun:
    """A run in memory."""
    kept = RecordCollector()
    for _ in run_in_memory(scenario, RunRecorder(scenario, kept)):
        pass
    return RecordedRun.of_records(scenario, kept.kept)


def messages_in(recorded_run: RecordedRun, kind: str) -> list[dict[str, Any]]:
    """All messages of a class, decoded by the independent msgpack package."""
    return [
        samples.unpack(r.payload)
        for r in recorded_run.records
        if f"{r.topic}/".split("/")[1] == kind
    ]


def truth(uav: int, place: Point, at_s: float, **changes: Any) -> Truth:
    """A true state, flying north."""
    made = msgspec.structs.replace(samples.truth(uav, place, to_ns(at_s)), flight_path_rad=0.0)
    straight = {"heading_rad": 0.0, "guidance_heading_rad": 0.0, "commanded_heading_rad": 0.0}
    return msgspec.structs.replace(made, **{**straight, "waypoint_index": 0, **changes})


def two(duration_s: float = 4.0, **changes: Any) -> Scenario:
    """Two UAVs, for hand-made true states."""
    return msgspec.structs.replace(apart(duration_s=duration_s, **changes), uav=apart().uav[:2])


def path(*places: Sequence[Point], step_s: float = 0.1) -> list[Truth]:
    """True states of UAVs 1, 2, ... that are at these places one tick after the other."""
    rows = zip(*places, strict=True)
    return [
        truth(n + 1, place, step_s * tick)
        for tick, row in enumerate(rows)
        for n, place in enumerate(row)
    ]


def line(start: Point, velocity: Point, ticks: int) -> list[Point]:
    """Straight flight, tick by tick of 0.1 s."""
    return [
        (
            start[0] + velocity[0] * n / 10,
            start[1] + velocity[1] * n / 10,
            start[2] + velocity[2] * n / 10,
        )
        for n in range(ticks + 1)
    ]


def pair_of(*places: Sequence[Point], **options: Any) -> PairMetrics:
    """The only pair of two UAVs at these places."""
    (found,) = measure(recorded_run_of(two(), path(*places)), **options).pairs
    return found


# geometry of one chord

coordinate = st.floats(-4.0, 4.0).map(lambda x: round(x, 3))
vector = st.tuples(coordinate, coordinate, coordinate)


def separation(p: Sequence[float]) -> float:
    return max(math.hypot(p[0], p[1]), abs(p[2]))


def sampled(start: Point, step: Point, n: int = 500) -> list[tuple[float, Point]]:
    return [
        (
            k / n,
            (start[0] + step[0] * k / n, start[1] + step[1] * k / n, start[2] + step[2] * k / n),
        )
        for k in range(n + 1)
    ]


@given(vector, vector)
@fast
def test_least_separation_on_a_chord_is_below_that_of_all_its_points(a: Point, d: Point) -> None:
    (value,), (fraction,) = geometry.least(np.array([a]), np.add([a], [d]))
    points = sampled(a, d)
    assert value <= min(separation(p) for _, p in points) + 1e-12
    assert value >= min(separation(p) for _, p in points) - separation(d) / 1000 - 1e-12
    there = tuple(x + float(fraction) * y for x, y in zip(a, d, strict=True))
    assert separation(there) == pytest.approx(value, abs=1e-12)


@given(vector, vector)
@fast
def test_a_chord_is_inside_from_where_it_enters_to_where_it_leaves(a: Point, d: Point) -> None:
    (enter,), (leave,) = geometry.inside(np.array([a]), np.add([a], [d]))
    for fraction, point in sampled(a, d):
        if abs(separation(point) - 1.0) > 1e-9:
            assert (separation(point) < 1.0) == bool(enter <= fraction <= leave)


@given(vector, vector)
@fast
def test_the_closest_point_of_a_chord(a: Point, d: Point) -> None:
    (fraction,) = geometry.closest(np.array([a]), np.add([a], [d]))
    near = math.dist(a, [-float(fraction) * y for y in d])
    assert near <= min(math.dist(p, (0, 0, 0)) for _, p in sampled(a, d)) + 1e-9


def test_a_chord_through_the_corner_of_the_cylinder_is_nearest_where_both_distances_are_equal() -> (
    None
):
    # horizontal 2 - s, vertical s: equal at s = 1, before which the vertical one is smaller
    (value,), (fraction,) = geometry.least(np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]))
    assert (value, fraction) == (1.0, 0.5)


def test_chords_fit_together_though_their_ends_be_a_rounding_error_inside() -> None:
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, math.tau, 20_000)
    middle = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-1.0, 1.0, len(angle))], axis=1)
    middle *= 1.0 - 10.0 ** rng.uniform(-16.2, -14.0, (len(angle), 1))
    before, after = rng.uniform(-0.6, 0.6, (2, len(angle), 3))
    _, leave = geometry.inside(before, middle)
    enter, _ = geometry.inside(middle, after)
    inside = geometry.unit_separation(middle) < 1.0
    assert inside.sum() > 10_000
    assert (leave[inside] == 1.0).all()
    assert (enter[inside] == 0.0).all()


# pairs on straight lines

speed = st.integers(-30, 30).map(float)
offset = st.integers(-900, 900).map(float)


def crossing_times(
    p: Point, w: Point, volume: tuple[float, float], end_s: float
) -> tuple[float, float] | None:
    """When a line is inside a cylinder, by quadratics solved here, within [0, end]."""
    low, high = 0.0, end_s
    a, b, c = (
        w[0] ** 2 + w[1] ** 2,
        p[0] * w[0] + p[1] * w[1],
        p[0] ** 2 + p[1] ** 2 - volume[0] ** 2,
    )
    if a > 0.0:
        if b * b <= a * c:
            return None
        root = math.sqrt(b * b - a * c)
        low, high = max(low, (-b - root) / a), min(high, (-b + root) / a)
    elif c >= 0.0:
        return None
    if w[2]:
        ends = sorted(((-volume[1] - p[2]) / w[2], (volume[1] - p[2]) / w[2]))
        low, high = max(low, ends[0]), min(high, ends[1])
    elif abs(p[2]) >= volume[1]:
        return None
    return (low, high) if low < high else None


@given(st.tuples(offset, offset, st.integers(-80, 80).map(float)), st.tuples(speed, speed, speed))
@fast
def test_two_straight_lines_have_the_approach_and_the_losses_of_the_closed_form(
    p: Point, w: Point
) -> None:
    end_s = 4.0
    found = pair_of(
        line((0.0, 0.0, -300.0), (25.0, 0.0, 0.0), 40),
        line((p[0], p[1], p[2] - 300.0), (25.0 + w[0], w[1], w[2]), 40),
    )
    square = sum(x * x for x in w)
    t = (
        min(max(0.0, -sum(x * y for x, y in zip(p, w, strict=True)) / square), end_s)
        if square
        else 0.0
    )
    there = [x + y * t for x, y in zip(p, w, strict=True)]
    assert found.cpa_m == pytest.approx(math.hypot(*there), abs=1e-6)
    assert found.horizontal_miss_m == pytest.approx(math.hypot(*there[:2]), abs=1e-3)
    assert found.vertical_miss_m == pytest.approx(abs(there[2]), abs=1e-3)
    for held, volume in ((found.losses, (400.0, 50.0)), (found.volumes[0], (152.4, 30.48))):
        inside = crossing_times(p, w, volume, end_s)
        if inside is None or inside[1] - inside[0] < 1e-6:
            assert held.duration_s < 1e-5
            continue
        (event,) = held.events
        assert (event.start_s, event.end_s) == pytest.approx(inside, abs=1e-6)
        assert (held.count, held.first_s) == (1, event.start_s)
        assert held.duration_s == pytest.approx(inside[1] - inside[0], abs=1e-6)
        moments = [inside[0] + k / 2000 * (inside[1] - inside[0]) for k in range(2001)]
        least = min(
            max(
                math.hypot(p[0] + w[0] * s, p[1] + w[1] * s) / volume[0],
                abs(p[2] + w[2] * s) / volume[1],
            )
            for s in moments
        )
        assert held.severity == pytest.approx(1.0 - least, abs=2e-3)
        assert held.severity == held.events[0].severity
    assert found.least_separation == pytest.approx(
        max(found.horizontal_m / 400.0, found.vertical_m / 50.0)
    )


def test_nothing_is_nearer_than_at_the_nearest_moment_between_two_ticks() -> None:
    # They pass at 2.05 s, between two ticks, 30 m apart.
    found = pair_of(
        line((0.0, 0.0, 0.0), (100.0, 0.0, 0.0), 40),
        line((410.0, 30.0, 0.0), (-100.0, 0.0, 0.0), 40),
    )
    assert (found.cpa_m, found.cpa_at_s) == pytest.approx((30.0, 2.05))
    assert (found.least_separation, found.t_s) == pytest.approx((30.0 / 400.0, 2.05))
    assert (found.horizontal_m, found.vertical_m) == pytest.approx((30.0, 0.0))
    assert found.volumes[0].duration_s == pytest.approx(2.0 * math.sqrt(152.4**2 - 30.0**2) / 200.0)


wandering = st.lists(
    st.tuples(offset, offset, st.integers(-80, 80).map(float)), min_size=1, max_size=8
)


@given(wandering)
@fast
def test_a_wandering_pair_is_lost_as_often_and_as_long_as_its_points_say(
    places: list[Point],
) -> None:
    found = pair_of(len(places) * [(0.0, 0.0, 0.0)], places)
    monitor = SeparationMonitor([1, 2], Required(400.0, 50.0))
    for place in places:
        monitor.update(0, np.array([(0.0, 0.0, 0.0), place]))
    assert found.least_separation <= monitor.least() + 1e-12
    n, values = 200, []
    for a, b in itertools.pairwise(places):
        for k in range(n):
            point = [
                (x + (y - x) * k / n) / size
                for x, y, size in zip(a, b, (400, 400, 50), strict=True)
            ]
            values.append(separation(point))
    inside = [value < 1.0 for value in values]
    runs = sum(now and not before for before, now in itertools.pairwise([False, *inside]))
    assert found.losses.duration_s == pytest.approx(sum(inside) * 0.1 / n, abs=0.1 * (runs + 2) / n)
    assert found.losses.count >= runs
    assert found.least_separation <= min(values, default=math.inf) + 1e-12
    assert all(e.severity > 0.0 or e.start_s == e.end_s for e in found.losses.events)


def test_a_pair_that_comes_back_is_lost_twice() -> None:
    places = [
        (300.0, 0.0, 0.0),
        (500.0, 0.0, 0.0),
        (500.0, 0.0, 0.0),
        (200.0, 0.0, 0.0),
        (200.0, 0.0, 0.0),
    ]
    losses = pair_of(5 * [(0.0, 0.0, 0.0)], places).losses
    assert [(e.start_s, e.end_s) for e in losses.events] == [
        pytest.approx((0.0, 0.05)),
        pytest.approx((0.2 + 0.1 / 3.0, 0.4)),
    ]
    assert [e.severity for e in losses.events] == pytest.approx([0.25, 0.5])
    assert (losses.severity, losses.duration_s) == pytest.approx((0.5, 0.05 + 0.2 - 0.1 / 3.0))


def test_an_incursion_needs_both_distances_to_be_too_small() -> None:
    assert pair_of(2 * [(0.0, 0.0, 0.0)], 2 * [(0.0, 399.0, 51.0)]).losses.count == 0
    assert pair_of(2 * [(0.0, 0.0, 0.0)], 2 * [(0.0, 401.0, 0.0)]).losses.count == 0
    assert pair_of(2 * [(0.0, 0.0, 0.0)], 2 * [(0.0, 399.0, 49.0)]).losses.count == 1


def test_to_touch_is_not_to_enter() -> None:
    found = pair_of(
        line((0.0, 0.0, 0.0), (25.0, 0.0, 0.0), 40), line((50.0, 400.0, 0.0), (0.0, 0.0, 0.0), 40)
    )
    assert found.least_separation == pytest.approx(1.0)
    assert found.losses.events == ()


def test_volumes_can_be_chosen_and_the_zone_comes_first() -> None:
    places = 2 * [(0.0, 0.0, 0.0)], 2 * [(90.0, 0.0, 15.0)]
    found = pair_of(*places, volumes=(Volume("near", 100.0, 20.0), NMAC, Volume("touch", 5.0, 2.0)))
    assert found.losses.volume == "zone"
    assert [(v.volume, v.count) for v in found.volumes] == [("near", 1), ("nmac", 1), ("touch", 0)]
    assert found.volumes[0].severity == pytest.approx(0.1)
    assert (NMAC.horizontal_m, NMAC.vertical_m) == pytest.approx((152.4, 30.48))


def test_a_pair_counts_only_while_both_are_on_record() -> None:
    """They fly towards each other, and UAV 2 vanishes after 3 s."""
    told = path(
        line((0.0, 0.0, 0.0), (0.0, 100.0, 0.0), 40),
        line((0.0, 4000.0, 0.0), (0.0, -1000.0, 0.0), 40),
    )
    gone = [m for m in told if m.id == 1 or m.t_ns <= to_ns(3.0)]
    (found,) = measure(recorded_run_of(two(), gone)).pairs
    assert (found.cpa_m, found.cpa_at_s) == pytest.approx((700.0, 3.0))
    assert measure(recorded_run_of(two(), [m for m in told if m.id == 1])).pairs == ()


def test_where_a_true_state_is_missing_the_way_is_straight() -> None:
    told = path(
        line((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 40), line((0.0, 390.0, 0.0), (300.0, 0.0, 0.0), 40)
    )
    holes = [m for m in told if m.id == 1 or m.t_ns not in range(to_ns(0.05), to_ns(1.05))]
    whole, holey = (measure(recorded_run_of(two(), m)).pairs[0] for m in (told, holes))
    assert holey.losses.duration_s == pytest.approx(whole.losses.duration_s)
    assert holey.losses.count == 1


def test_pairs_come_nearest_first_and_their_totals_add_up() -> None:
    places = [[(0.0, y, -300.0)] * 3 for y in (0.0, 300.0, 1000.0)]
    run = measure(recorded_run_of(apart(), path(*places)))
    assert [(p.a, p.b) for p in run.pairs] == [(1, 2), (2, 3), (1, 3)]
    assert (run.totals.pairs, run.totals.pairs_lost, run.totals.losses) == (3, 1, 1)
    assert run.totals.least_separation == pytest.approx(0.75)
    assert (run.totals.loss_s, run.totals.severity) == pytest.approx((0.2, 0.25))
    assert run.totals.incursions == {"nmac": 0}


@pytest.mark.parametrize("messages", [[], [truth(1, (0.0, 0.0, 0.0), 0.0)]])
def test_where_there_is_little_there_is_little_to_measure(messages: list[Message]) -> None:
    run = measure(recorded_run_of(two(), messages))
    assert (run.pairs, run.links, run.commands.issued, run.elections.terms) == ((), (), 0, 0)
    assert run.totals.least_separation is None
    assert len(run.uavs) == len(messages)


# flown encounters, resolver none


def encounter(one: Uav, two_: Uav, duration_s: float = 60.0, *plan: Rule) -> Scenario:
    return Scenario("met", duration_s, uav=(one, two_), resolver="none", fault=plan)


@pytest.fixture(scope="module")
def perpendicular() -> RunMetrics:
    """UAV 1 flies north, UAV 2 west, across its path 61 m behind it and 7 m higher."""
    other = Uav(2, (939.0, 1000.0, -307.0), -90.0, ((939.0, -9e4, -307.0),))
    return measure(flown(encounter(FAR, other)))


def test_a_flown_crossing_has_the_approach_of_two_lines(perpendicular: RunMetrics) -> None:
    # Relative position (939, 1000) and velocity (-25, -25): nearest after 1939 / 50 s.
    (pair,) = perpendicular.pairs
    level = 61.0 / math.sqrt(2.0)
    assert pair.cpa_at_s == pytest.approx(38.78)
    assert pair.cpa_m == pytest.approx(math.hypot(level, 7.0))
    assert (pair.horizontal_miss_m, pair.vertical_miss_m) == pytest.approx((level, 7.0))
    assert pair.least_separation == pytest.approx(7.0 / 50.0)
    closing = 25.0 * math.sqrt(2.0)
    half_s = [math.sqrt(r * r - level * level) / closing for r in (400.0, 152.4)]
    for held, half in zip((pair.losses, *pair.volumes), half_s, strict=True):
        (event,) = held.events
        assert (event.start_s, event.end_s) == pytest.approx((38.78 - half, 38.78 + half))
    assert pair.losses.severity == pytest.approx(1.0 - 7.0 / 50.0)
    assert pair.volumes[0].severity == pytest.approx(1.0 - level / 152.4)


def test_the_alert_of_a_flown_crossing_comes_in_time(perpendicular: RunMetrics) -> None:
    # They are in conflict from the start, and the coordinator has heard both after 0.1 s.
    (pair,) = perpendicular.pairs
    assert pair.alerted_s == pytest.approx(0.2)
    assert pair.losses.first_s is not None
    assert pair.alert_lead_s == pytest.approx(pair.losses.first_s - 0.2)
    # The zone is widened by what curvature could add.
    assert pair.time_to_violation_s == pytest.approx(pair.alert_lead_s, abs=0.1)
    assert pair.true_time_to_violation_s == pytest.approx(pair.time_to_violation_s)
    assert perpendicular.totals.missed_alerts == 0


def test_head_on_flights_without_resolution_collide() -> None:
    scenario = samples.head_on(resolver="none")
    run = measure(flown(msgspec.structs.replace(scenario, uav=scenario.uav[:2], duration_s=40.0)))
    (pair,) = run.pairs
    assert pair.cpa_m == pytest.approx(0.0, abs=1e-6)
    assert pair.cpa_at_s == pytest.approx(30.0)
    assert pair.losses.duration_s == pytest.approx(800.0 / 50.0)
    assert pair.volumes[0].duration_s == pytest.approx(2.0 * 152.4 / 50.0)
    assert (pair.losses.severity, pair.volumes[0].severity) == pytest.approx((1.0, 1.0))


# alerts


def at_rest(alerts: Iterable[Message], **changes: Any) -> PairMetrics:
    told = path(
        line((0.0, 0.0, -300.0), (0.0, 0.0, 0.0), 40),
        line((0.0, 700.0, -300.0), (0.0, -200.0, 0.0), 40),
    )
    (pair,) = measure(recorded_run_of(apart(**changes), [*told, *alerts])).pairs
    return pair


def test_the_first_alert_counts_and_the_lead_is_until_the_loss() -> None:
    pictures = [
        Conflict(0, n, to_ns(at_s), pairs, times, ())
        for n, (at_s, pairs, times) in enumerate(
            [
                (0.2, ((2, 3),), (9.0,)),
                (0.6, ((1, 2), (2, 3)), (1.25, 2.0)),
                (1.0, ((1, 2),), (0.5,)),
            ]
        )
    ]
    pair = at_rest(pictures)
    assert pair.losses.first_s == pytest.approx(1.5)
    assert (pair.alerted_s, pair.time_to_violation_s, pair.alert_lead_s) == pytest.approx(
        (0.6, 1.25, 0.9)
    )


def test_a_late_alert_has_a_negative_lead_and_a_loss_without_one_has_none() -> None:
    late, never = at_rest([Conflict(0, 0, to_ns(2.0), ((1, 2),), (0.0,), ())]), at_rest([])
    assert late.alert_lead_s == pytest.approx(-0.5)
    assert (never.alerted_s, never.time_to_violation_s, never.alert_lead_s) == (None, None, None)


def test_where_uavs_elect_themselves_their_election_is_the_alert() -> None:
    told = [elect(4, (1, 2), 0.4, 2.4), elect(5, (1, 2), 0.8, 2.8, elector=1)]
    pair = at_rest(told)
    assert (pair.alerted_s, pair.time_to_violation_s) == (0.8, None)
    assert pair.alert_lead_s == pytest.approx(0.7)
