"""Commands, elections, deviation: against hand-made runs, and loops over a run's messages."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.analysis.metrics import RecordedRun, RunMetrics, Spread, Tolerance, Volume, measure
from fleet.analysis.planned import deviations, planned_flight
from fleet.analysis.tally import RunTally, quantiles
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.model.units import to_ns
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Decision, DeliveryReport, Message
from tests.analysis.test_check_story import (
    RecordedRunBuilder,
    apart,
    elect,
    good,
    make_command,
    obey,
)
from tests.analysis.test_metrics import fast, flown, line, messages_in, recorded_run_of, truth, two
from tests.support import samples

PLAN = (
    Loss(probability=0.2),
    Latency(base_s=0.3, jitter_s=0.05),
    Duplicate(probability=0.1, delay_s=0.4),
)


@pytest.fixture(scope="module")
def lossy() -> RecordedRun:
    """Three UAVs, two of them head-on, under loss, latency and duplicates; UAV 1 dies for 6 s."""
    kill = Kill(node="1", start_s=8.0, end_s=14.0)
    return flown(samples.head_on(fault=(*PLAN, kill), seed=3))


@pytest.fixture(scope="module")
def run(lossy: RecordedRun) -> RunMetrics:
    return measure(lossy)


# commands


def test_the_good_run_has_one_command_repeated_once() -> None:
    found = measure(good().recorded_run()).commands
    assert (found.issued, found.transmissions, found.applied) == (1, 2, 1)
    assert (found.duplicates, found.refused, found.refused_by_reason) == (1, 0, {})
    (row,) = found.rows
    assert (row.term, row.issuer, row.number, row.target) == (4, 1, 1, 2)
    assert (row.issued_s, row.transmissions, row.outcome, row.reason) == (0.5, 2, "applied", "")
    assert row.latency_s == pytest.approx(0.2)
    assert row.state_age_s == pytest.approx(0.1)  # the broadcast of 0.4 s came at 0.5 s
    assert found.latency_s == Spread(1, *5 * (row.latency_s,))


@pytest.mark.parametrize(
    ("reasons", "outcome", "reason"),
    [
        ([], "unanswered", ""),
        (["duplicate"], "unanswered", ""),
        (["unknown_term"], "refused", "unknown_term"),
        (["unknown_term", "expired"], "refused", "expired"),
        (["unknown_term", ""], "applied", ""),
        (["", "duplicate"], "applied", ""),
    ],
)
def test_what_becomes_of_a_command(reasons: list[str], outcome: str, reason: str) -> None:
    told = make_command(2, 4, 1, 0.5)
    answers = [
        samples.ack(told, why, t_ns=to_ns(0.6 + n / 10), seq=n) for n, why in enumerate(reasons)
    ]
    found = measure(recorded_run_of(two(), [told, *answers])).commands
    assert [(row.outcome, row.reason) for row in found.rows] == [(outcome, reason)]
    refused = [why for why in reasons if why not in ("", "duplicate")]
    assert found.refused_by_reason == dict.fromkeys(sorted(refused), 1)
    assert (found.refused, found.duplicates) == (len(refused), reasons.count("duplicate"))
    assert (found.applied, found.unanswered) == (outcome == "applied", outcome == "unanswered")


def test_latency_is_from_the_first_transmission_by_true_time_whatever_the_issuers_clock() -> None:
    told = make_command(2, 4, 1, 0.5, issued_ns=to_ns(7.5))
    again = msgspec.structs.replace(told, t_ns=to_ns(1.1), seq=1)
    yes = samples.ack(again, t_ns=to_ns(1.2), actuate_ns=to_ns(1.25))
    (row,) = measure(recorded_run_of(two(), [told, again, yes])).commands.rows
    assert row.latency_s == pytest.approx(0.75)


def test_the_numbers_of_commands_are_those_of_the_result(
    lossy: RecordedRun, run: RunMetrics
) -> None:
    tally = RunTally(3)
    for record in lossy.records:
        if record.topic.split("/")[0] != "sim":
            tally.add(codec.decode(record.topic, record.payload))
    found = run.commands
    assert found.issued == len(tally.issued) > 0
    assert found.transmissions == tally.transmissions > found.issued
    assert found.applied == len(tally.applied) > 0
    assert found.refused_by_reason == dict(sorted(tally.refused.items()))
    assert found.unresolved == tally.unresolved
    assert run.elections.terms == len(tally.terms)
    expected = quantiles(list(tally.applied.values()))
    spread = found.latency_s
    assert (spread.p50, spread.p99, spread.max) == pytest.approx(tuple(expected.values()))


def newest_heard(recorded_run: RecordedRun, receiver: int, uav: int, at_ns: int) -> int | None:
    """When the newest broadcast was sent that had been received by then, from the reports."""
    sent = [
        sent_ns
        for m in messages_in(recorded_run, "delivery")
        if m["id"] == receiver and m["t_ns"] <= at_ns
        for src, kind, sent_ns, fate in zip(
            m["src"], m["kinds"], m["sent_ns"], m["fates"], strict=True
        )
        if (src, kind) == (uav, "adsb") and fate in ("received", "altered")
    ]
    return max(sent, default=None)


def test_state_age_is_that_of_the_newest_broadcast_heard(
    lossy: RecordedRun, run: RunMetrics
) -> None:
    early = [row for row in run.commands.rows if row.issued_s < 8.0 and row.issuer != row.target]
    assert early  # later UAV 1 has lost what it knew
    for row in early:
        newest = newest_heard(lossy, row.issuer, row.target, to_ns(row.issued_s))
        assert newest is not None
        assert row.state_age_s == pytest.approx(row.issued_s - newest / 1e9)
        assert row.state_age_s is not None
        assert row.state_age_s > 0.25  # the latency


def test_the_state_of_oneself_has_no_age_and_a_new_incarnation_knows_nothing() -> None:
    run_builder = RecordedRunBuilder(apart())
    run_builder.fly(1, 2, until_s=1.0)
    own = run_builder.say(make_command(1, 4, 1, 0.5))
    reborn = msgspec.structs.replace(make_command(2, 4, 2, 0.6), seq=10**9 + 1)
    recorded_run = run_builder.recorded_run()
    told = [codec.decode(r.topic, r.payload) for r in recorded_run.records if r.topic[:3] != "sim"]
    heard = DeliveryReport(
        1, 10**9, to_ns(0.5), (3,), ("adsb",), (0,), (0,), (to_ns(0.5),), ("received",)
    )
    rows = measure(recorded_run_of(run_builder.scenario, [*told, heard, reborn])).commands.rows
    assert own.target == own.id
    assert [row.state_age_s for row in rows] == [None, None]


def test_implausible_broadcasts_are_not_known() -> None:
    run_builder = RecordedRunBuilder(apart())
    run_builder.fly(1, 2, until_s=0.2)
    said = run_builder.say(samples.adsb(2, t_ns=to_ns(0.4)))
    run_builder.hear(1, said, fate="implausible")
    run_builder.say(make_command(2, 4, 1, 0.5))
    (row,) = measure(run_builder.recorded_run()).commands.rows
    assert row.state_age_s == pytest.approx(0.3)


def test_the_ages_of_decisions_are_told_for_every_encounter() -> None:
    run_builder = RecordedRunBuilder(apart())
    run_builder.fly(1, 2, 3, until_s=1.0)
    encounters = (
        samples.encounter(2),
        samples.encounter(3, "priority", 0.84),
        samples.encounter(1),
    )
    for at_s in (0.6, 0.7):
        run_builder.say(Decision(1, 0, to_ns(at_s), 4, encounters))
    found = measure(run_builder.recorded_run()).commands
    assert (found.rounds, found.unresolved, found.state_age_s.count) == (2, 1, 4)
    assert found.state_age_s.mean == pytest.approx(0.15)  # 0.2 at 0.6 s, 0.1 at 0.7 s
    assert (found.state_age_s.p50, found.state_age_s.max) == pytest.approx((0.2, 0.2))


# elections


def test_terms_and_changes_of_the_computing_uav() -> None:
    told = [
        elect(4, (2, 3), 0.2, 2.2),
        elect(4, (2, 3), 0.8, 2.8),
        elect(8, (1, 2, 3), 1.0, 3.0),
        elect(12, (1, 3), 2.0, 4.0),
        elect(14, (2, 3), 3.0, 5.0, elector=2),
    ]
    numbered = [msgspec.structs.replace(e, seq=n) for n, e in enumerate(told)]
    found = measure(recorded_run_of(apart(), numbered)).elections
    assert [(r.term, r.elector, r.computing, r.announcements, r.change) for r in found.rows] == [
        (4, 0, 2, 2, False),
        (8, 0, 1, 1, True),
        (12, 0, 1, 1, False),
        (14, 2, 2, 1, True),
    ]
    assert (found.terms, found.by_uavs, found.changes, found.announcements) == (4, 1, 2, 5)


def meeting(held: range = range(0), mode: str = "held") -> list[Message]:
    """True states of two UAVs 1500 m apart, head-on; UAV 1's process is away in some ticks."""
    names = ("heading_rad", "guidance_heading_rad", "commanded_heading_rad")
    south: dict[str, Any] = dict.fromkeys(names, math.pi)
    south["velocity_ned_mps"] = (-25.0, 0.0, 0.0)
    north = line((0.0, 0.0, -300.0), (25.0, 0.0, 0.0), 40)
    back = line((1500.0, 0.0, -300.0), (-25.0, 0.0, 0.0), 40)
    return [
        *(truth(1, p, n / 10, mode=mode if n in held else "plan") for n, p in enumerate(north)),
        *(truth(2, p, n / 10, **south) for n, p in enumerate(back)),
    ]


def head_on() -> Scenario:
    scenario = samples.head_on()
    return msgspec.structs.replace(scenario, uav=scenario.uav[:2], duration_s=4.0)


def led(
    *but: int,
    held: range = range(0),
    mode: str = "held",
    clock: ClockError | None = None,
    **changes: Any,
) -> RunMetrics:
    """They are at risk all the time, and have an election of 1.0 s, valid until 3.0 s."""
    run_builder = RecordedRunBuilder(head_on(), *([clock] if clock else []))
    run_builder.tell_alone(msgspec.structs.replace(elect(3, (1, 2), 1.0, 3.0), **changes), *but)
    for message in meeting(held, mode):
        run_builder.say(message)
    return measure(run_builder.recorded_run())


def test_they_have_a_computing_uav_while_both_hold_a_mandate_in_force() -> None:
    # Updates every 0.2 s: 20 of them before the end, those from 1.2 s to 3.0 s under the mandate.
    found = led().elections
    assert (found.at_risk_s, found.without_computing_s) == pytest.approx((20 * 0.2, 10 * 0.2))
    assert found.longest_without_s == pytest.approx(6 * 0.2)
    (pair,) = led().pairs
    assert (pair.at_risk_s, pair.without_computing_s) == pytest.approx((20 * 0.2, 10 * 0.2))
    assert pair.true_time_to_violation_s is None  # nobody raised an alert


def test_the_last_update_lasts_until_the_end_of_the_record() -> None:
    scenario = head_on()
    rare = msgspec.structs.replace(scenario.coordination, update_s=3.0)
    found = measure(
        recorded_run_of(msgspec.structs.replace(scenario, coordination=rare), meeting())
    )
    assert found.elections.at_risk_s == pytest.approx(3.0 + 1.0)
    assert found.elections.longest_without_s == pytest.approx(4.0)
    assert found.pairs[0].at_risk_s == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("what", "updates"),
    [
        ({"but": (2,)}, 20),  # UAV 2 did not hear it
        ({"but": (1,)}, 20),  # the computing UAV did not
        ({"members": (1,)}, 20),
        ({"term": 4}, 20),  # that is a term of UAV 1's
        ({"held": range(15, 20)}, 12),  # it is not there at 1.6 s and 1.8 s
        ({"held": range(15, 20), "mode": "unmanned"}, 18),  # and has then forgotten
        ({"valid_until_ns": to_ns(2.0)}, 15),
        ({"valid_until_ns": to_ns(900.0)}, 10),  # the elector's clock is ahead: 2 s, no more
        ({"clock": ClockError(node="uav", offset_s=-30.0, start_s=2.0)}, 16),  # before it was heard
        ({"clock": ClockError(node="2", offset_s=0.5, start_s=2.0)}, 13),
    ],
)
def test_when_there_is_no_computing_uav(what: dict[str, Any], updates: int) -> None:
    found = led(*what.pop("but", ()), **what).elections
    assert found.without_computing_s == pytest.approx(0.2 * updates)


@pytest.mark.parametrize(("but", "updates"), [((), 10), ((3,), 20)])
def test_the_computing_uav_must_know_that_it_is(but: tuple[int, ...], updates: int) -> None:
    """UAVs 1 and 2 meet; UAV 3, far away, computes for them."""
    run_builder = RecordedRunBuilder(msgspec.structs.replace(samples.head_on(), duration_s=4.0))
    said = msgspec.structs.replace(elect(4, (1, 2, 3), 1.0, 3.0), computing=3)
    run_builder.tell(said, *but)
    east = (0.0, 90_000.0, -300.0)
    for message in [*meeting(), *(truth(3, east, n / 10) for n in range(41))]:
        run_builder.say(message)
    found = measure(run_builder.recorded_run()).elections
    assert found.without_computing_s == pytest.approx(0.2 * updates)


def test_one_that_is_dead_needs_no_computing_uav_but_the_other_does() -> None:
    # UAV 1 dies; UAV 2 elects itself at 2.0 s (a term of its own) and gives way.
    run_builder = RecordedRunBuilder(head_on())
    run_builder.say(msgspec.structs.replace(elect(5, (1, 2), 2.0, 4.0, elector=2), computing=2))
    for message in meeting(range(1, 41), "unmanned"):
        run_builder.say(message)
    found = measure(run_builder.recorded_run()).elections
    assert found.without_computing_s == pytest.approx(10 * 0.2)


def test_the_fault_run_has_gaps_only_while_the_computing_uav_is_dead(run: RunMetrics) -> None:
    found = run.elections
    assert found.changes >= 1
    assert 0.0 < found.longest_without_s <= found.without_computing_s < found.at_risk_s
    assert found.longest_without_s < 6.0  # it is dead for so long, and somebody takes over


# deviation


def test_a_flown_plan_with_corners_and_climbs_is_not_deviated_from() -> None:
    waypoints = ((800.0, 0.0, -300.0), (800.0, 700.0, -360.0), (0.0, 700.0, -330.0))
    uav = Uav(1, (0.0, 0.0, -300.0), 30.0, waypoints)
    found = measure(flown(Scenario("alone", 100.0, uav=(uav,)))).uavs[0]
    assert found.path_deviation_max_m < 1e-4
    assert found.altitude_deviation_max_m < 1e-4
    assert (found.off_plan_s, found.commanded_s, found.unmanned_s) == (0.0, 0.0, 0.0)
    assert (found.released_s, found.back_on_plan_s, found.flown_s) == (None, None, 100.0)


def test_the_planned_path_of_a_straight_flight_is_one_line() -> None:
    corners = planned_flight(apart().uav[0], apart()).corners
    assert len(np.unique(corners[:, 1])) == 1
    assert len(corners) == 3


def aside(east_m: list[float], up_m: list[float], modes: list[str]) -> Any:
    """A UAV that should fly north, at these places beside and above its path, tick by tick."""
    uav = apart().uav[0]
    _, east, down = uav.position_ned_m
    told = [
        truth(1, (2.5 * n, east + e, down - u), n / 10, mode=mode)
        for n, (e, u, mode) in enumerate(zip(east_m, up_m, modes, strict=True))
    ]
    scenario = msgspec.structs.replace(apart(), uav=(uav,))
    (found,) = measure(recorded_run_of(scenario, told), tolerance=Tolerance(10.0, 2.0)).uavs
    return found


def test_deviation_by_hand() -> None:
    modes = ["plan", "turn", "turn", "climb", "plan", "held", "unmanned", "plan"]
    found = aside([0, -5, 40, 40, -12, 0, 0, 4], [0, 0, 0, -3, 0, 2.5, 1, 1], modes)
    assert (found.path_deviation_max_m, found.altitude_deviation_max_m) == (40.0, 3.0)
    assert found.path_deviation_mean_m == pytest.approx(101 / 8)
    assert found.altitude_deviation_mean_m == pytest.approx(7.5 / 8)
    assert found.off_plan_s == pytest.approx(0.4)  # from the third to the sixth
    assert found.back_on_plan_s == pytest.approx(0.6)
    assert (found.commanded_s, found.unmanned_s) == pytest.approx((0.3, 0.2))
    assert found.released_s == pytest.approx(0.4)


def test_who_is_not_back_at_the_end_is_not_back() -> None:
    found = aside([0, 40, 0, 40], 4 * [0.0], ["plan", "turn", "turn", "turn"])
    assert (found.back_on_plan_s, found.released_s) == (None, None)
    assert found.off_plan_s == pytest.approx(0.1)


@given(
    st.lists(
        st.tuples(*3 * [st.integers(-500, 500).map(float)]),
        min_size=2,
        max_size=6,
        unique_by=lambda p: p[:2],
    ),
    st.lists(st.tuples(*3 * [st.integers(-500, 500).map(float)]), min_size=1, max_size=4),
)
@fast
def test_deviation_is_the_distance_from_the_nearest_point_of_the_path(
    corners: list[tuple[float, float, float]], places: list[tuple[float, float, float]]
) -> None:
    path_m, altitude_m = deviations(np.array(corners), np.array(places))
    for place, level, height in zip(places, path_m, altitude_m, strict=True):
        near = [
            tuple(x + (y - x) * k / 500 for x, y in zip(a, b, strict=True))
            for a, b in itertools.pairwise(corners)
            for k in range(501)
        ]
        distances = [math.dist(p[:2], place[:2]) for p in near]
        assert level <= min(distances) + 1e-9
        assert level >= min(distances) - 1.5
        alike = [
            abs(p[2] - place[2]) for p, d in zip(near, distances, strict=True) if d < level + 2.0
        ]
        assert min(alike) - 2.5 <= height <= max(alike) + 2.5


def test_one_place_has_its_distance_from_the_nearest_end_of_a_line() -> None:
    corners = np.array([[373.0, 462.8, -300.0], [-523.3, -9.9, -300.0]])
    path_m, _ = deviations(corners, np.array([[-549.9, -175.5, -300.0]]))
    assert path_m == pytest.approx([math.hypot(549.9 - 523.3, 175.5 - 9.9)])


def test_lines_that_are_too_far_to_be_nearest_change_nothing() -> None:
    turns = np.linspace(0.0, 40.0 * math.pi, 700)
    spiral = np.stack([30.0 * turns * np.cos(turns), 30.0 * turns * np.sin(turns), -turns], axis=1)
    rng = np.random.default_rng(1)
    places = spiral[::2] + rng.normal(0.0, 40.0, (350, 3))
    path_m, altitude_m = deviations(spiral, places)
    alone = [deviations(spiral[n : n + 2], places) for n in range(len(spiral) - 1)]
    nearest = np.argmin([level for level, _ in alone], axis=0)
    np.testing.assert_allclose(path_m, np.min([level for level, _ in alone], axis=0))
    np.testing.assert_allclose(altitude_m, [alone[n][1][k] for k, n in enumerate(nearest)])


def test_a_resolved_encounter_deviates_and_comes_back(lossy: RecordedRun, run: RunMetrics) -> None:
    """Against a loop over the true states: both plans are lines along a meridian."""
    off: defaultdict[int, float] = defaultdict(float)
    high: defaultdict[int, float] = defaultdict(float)
    commanded: defaultdict[int, int] = defaultdict(int)
    starts = {uav.id: uav.position_ned_m for uav in uavs_of(lossy.scenario)}
    for m in messages_in(lossy, "truth"):
        _, east, down = m["position_ned_m"]
        if m["id"] == 3:
            continue  # that one turns
        off[m["id"]] = max(off[m["id"]], abs(east - starts[m["id"]][1]))
        high[m["id"]] = max(high[m["id"]], abs(down - starts[m["id"]][2]))
        commanded[m["id"]] += m["mode"] in ("turn", "climb", "turn_climb")
    assert max(*off.values(), *high.values()) > 20.0
    for uav in run.uavs[:2]:
        assert uav.path_deviation_max_m == pytest.approx(off[uav.id], abs=1e-5)
        assert uav.altitude_deviation_max_m == pytest.approx(high[uav.id], abs=1e-5)
        assert uav.commanded_s == pytest.approx(0.1 * commanded[uav.id], abs=0.11)
    assert run.uavs[0].unmanned_s == pytest.approx(6.0)


# everything


def test_rows_are_flat_and_alike_and_json_has_everything(run: RunMetrics) -> None:
    tables = run.tables()
    assert set(tables) == {
        "pairs", "uavs", "commands", "elections", "classes", "links", "incursions",
    }  # fmt: skip
    for rows in tables.values():
        assert len({tuple(row) for row in rows}) <= 1
        assert {type(v) for row in rows for v in row.values()} <= {
            int,
            float,
            str,
            bool,
            type(None),
        }
    assert len(tables["pairs"]) == 3
    assert tables["pairs"][0]["incursions_nmac_s"] == run.pairs[0].volumes[0].duration_s
    found = run.as_dict()
    assert found["scenario"]["seed"] == 3
    assert [rule["kind"] for rule in found["plan"]] == ["loss", "latency", "duplicate", "kill"]
    assert found["pairs"][0]["losses"]["count"] == run.pairs[0].losses.count
    assert msgspec.json.decode(msgspec.json.encode(found)) == found


def test_the_columns_are_known_without_rows(lossy: RecordedRun) -> None:
    wide = measure(lossy, (Volume("wide", 1e6, 1e6), Volume("a", 1e3, 1e3)))
    assert wide.columns() == {name: list(rows[0]) for name, rows in wide.tables().items()}
    alone = measure(recorded_run_of(two(), []))
    assert alone.columns().keys() == wide.columns().keys()
    assert not any(alone.tables().values())


def test_every_message_class_that_is_heard_is_measured(run: RunMetrics) -> None:
    assert {row.kind for row in run.classes} == AUDIBLE


def test_a_command_that_is_obeyed_is_applied() -> None:
    told = make_command(2, 4, 1, 0.5)
    found = measure(recorded_run_of(two(), [told, obey(told)])).commands
    assert found.applied == 1
