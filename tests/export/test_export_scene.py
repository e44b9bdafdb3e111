"""What viewers are shown of a run: tracks, separations, lines of text."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.analysis.palette import OKABE_ITO, colour_of, rgb_of
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.export.lines import LineLevel, lines_of, manoeuvre_text
from fleet.export.scene import NEAREST_PAIRS, Scene, enu, every, scene_of
from fleet.faults.kinds.loss import Loss
from fleet.model.units import to_ns
from fleet.protocol.advisories import LoggedAdvisory
from fleet.protocol.messages import (
    Ack,
    Clock,
    Command,
    Decision,
    Election,
    Message,
    Truth,
)
from tests.conftest import KeepingRecorder, fly


@pytest.fixture(scope="module")
def run() -> KeepingRecorder:
    """Two UAVs that nobody commands, nose to nose."""
    return fly("head_on", "resolver=none", "duration_s=120")


@pytest.fixture(scope="module")
def scene(run: KeepingRecorder) -> Scene:
    """Its scene."""
    return scene_of(read_scenario("head_on").scenario, run.kept)


def command(**changes: object) -> Command:
    fields: dict[str, object] = {
        "id": 1,
        "seq": 0,
        "t_ns": to_ns(10.0),
        "target": 2,
        "term": 5,
        "number": 1,
        "issued_ns": to_ns(10.0),
        "manoeuvre": "turn",
        "heading_rad": np.pi / 2,
        "turn_rad": -np.pi / 6,
        "climb_mps": 0.0,
        "level_down_m": 0.0,
        "start_ns": to_ns(10.2),
        "manoeuvre_end_ns": to_ns(40.0),
        "expiry_ns": to_ns(12.0),
        **changes,
    }
    return Command(**fields)  # type: ignore[arg-type]


def texts(scene: Scene, *messages: Message | Clock) -> list[str]:
    return [f"{line.who}: {line.text}" for line in lines_of(messages, (), quiet(scene))]


def quiet(scene: Scene) -> Scene:
    """The same scene without pairs, so that no separation is lost."""
    return Scene(scene.scenario, scene.tracks, {}, (), scene.t_ns, scene.least_t_ns, scene.least)


def test_z_is_up_and_x_is_east() -> None:
    assert enu(np.array([[1.0, 2.0, 3.0]])).tolist() == [[2.0, 1.0, -3.0]]


def test_tracks_are_what_was_flown(run: KeepingRecorder, scene: Scene) -> None:
    first = [m for m in run.kept if isinstance(m, Truth) and m.id == 1]
    track = scene.tracks[0]
    assert track.uav == 1
    assert track.t_ns.tolist() == [m.t_ns for m in first]
    north, east, down = first[50].position_ned_m
    assert track.position_enu_m[50].tolist() == [east, north, -down]
    assert scene.routes_enu_m[1].tolist() == [[-2000.0, 0.0, 300.0], [4000.0, 0.0, 300.0]]


def test_the_aim_points_where_the_heading_says(scene: Scene) -> None:
    assert scene.tracks[0].intent_enu_mps(0) == pytest.approx([25.0, 0.0, 0.0])  # heading 90: east


def test_separations_are_those_of_the_run(run: KeepingRecorder, scene: Scene) -> None:
    (pair,) = scene.pairs
    (least,) = run.separation.minima()
    assert (pair.minimum.a, pair.minimum.b) == (1, 2)
    row = int(np.argmin(pair.normalised))
    assert pair.normalised[row] == least.least_separation == np.nanmin(scene.least)
    assert (pair.horizontal_m[row], pair.vertical_m[row]) == (least.horizontal_m, least.vertical_m)
    assert pair.t_ns[row] == to_ns(least.t_s)
    lost = set(pair.t_ns[pair.normalised < 1.0].tolist())
    # It is shown at ticks, and is lost on the way to the first of these.
    assert set(scene.lost()) == {min(lost) - scene.scenario.tick_ns, *lost}


def test_one_looks_first_at_where_it_was_tightest(scene: Scene) -> None:
    place, radius_m = scene.focus()
    assert place == pytest.approx((0.0, 0.0, 300.0), abs=30.0)
    assert radius_m == 1500.0


def test_of_many_pairs_the_nearest_are_shown_and_the_least_counts_all() -> None:
    run = fly("crossing", "generate.count=9", "duration_s=20")
    scene = scene_of(read_scenario("crossing", ["generate.count=9"]).scenario, run.kept)
    assert len(scene.pairs) == NEAREST_PAIRS < 36
    minima = run.separation.minima()
    assert [(p.minimum.a, p.minimum.b) for p in scene.pairs[:3]] == [(m.a, m.b) for m in minima[:3]]
    assert np.nanmin(scene.least) == minima[0].least_separation


def test_a_uav_that_is_not_there_all_the_time_has_a_shorter_track() -> None:
    run = fly("head_on", "duration_s=10")
    kept = [m for m in run.kept if not (isinstance(m, Truth) and m.id == 2 and m.t_ns > 5e9)]
    scene = scene_of(read_scenario("head_on").scenario, kept)
    assert len(scene.tracks[1].t_ns) == len(scene.pairs[0].t_ns) == 51
    assert scene.least_t_ns.tolist() == scene.tracks[1].t_ns.tolist()
    assert np.isfinite(scene.least).all()


def test_a_log_without_flight_makes_an_empty_scene() -> None:
    scene = scene_of(read_scenario("head_on").scenario, [])
    assert scene.end_ns == 0
    assert scene.pairs == ()
    assert scene.focus()[0] == (0.0, 0.0, 0.0)


def test_a_thinner_series_keeps_its_ends() -> None:
    t_ns = np.arange(0, 1001, 100)
    assert t_ns[every(t_ns, 250)].tolist() == [0, 300, 500, 800, 1000]
    assert t_ns[every(t_ns, 10)].tolist() == t_ns.tolist()
    assert not len(every(t_ns[:0], 10))


def test_lost_separation_is_told_when_it_begins_and_when_it_ends(scene: Scene) -> None:
    lost, again = lines_of([], (), scene)
    assert (lost.level, again.level) == (LineLevel.ERROR, LineLevel.INFO)
    assert lost.text.startswith("UAV 1 and UAV 2 have lost separation: ")
    assert min(scene.lost()) == lost.t_ns - scene.scenario.tick_ns
    assert max(scene.lost()) < again.t_ns


def test_elections_and_commands_are_told_once(scene: Scene) -> None:
    election = Election(0, 0, to_ns(9.0), 5, 1, (1, 2), 1, to_ns(11.0))
    again = Election(0, 1, to_ns(9.6), 5, 1, (1, 2), 1, to_ns(12.0))
    assert texts(scene, election, again, command(), command(seq=1, t_ns=to_ns(10.6))) == [
        "coordinator: UAV 1 computes for 1, 2 (term 5)",
        "UAV 1: command 1 to UAV 2: turn -30 deg to heading 90 deg, until 40.0 s at the latest",
    ]


def test_commands_in_words() -> None:
    both = command(manoeuvre="turn_climb", climb_mps=-2.0)
    assert "heading 90 deg, dive 2.0 m/s, until" in manoeuvre_text(both)
    assert manoeuvre_text(command(manoeuvre="resume")) == "resume"


def test_refusals_and_what_cannot_be_resolved_are_warnings(scene: Scene) -> None:
    refused = Ack(2, 0, to_ns(11.0), 1, 5, 1, to_ns(10.0), False, "stale_term", 0)
    accepted = Ack(2, 1, to_ns(11.0), 1, 5, 2, to_ns(10.0), True, "", to_ns(11.2))
    line = LoggedAdvisory(
        3, "left", 0.0, 9.0, "priority", "turn", 0.5, 0.0, 0.7, 1.0, 1.0, unresolved=True
    )
    decision = Decision(1, 0, to_ns(12.0), 5, (line,))
    lines = lines_of([refused, accepted, decision], (), quiet(scene))
    assert [line.level for line in lines] == [LineLevel.WARNING, LineLevel.WARNING]
    assert lines[0].text == "refuses command 1 of UAV 1: stale_term"
    assert "UAV 3" in lines[1].text


def test_faults_are_told_from_the_plan_and_from_the_clock(scene: Scene) -> None:
    plan = (
        Loss(probability=0.2, start_s=10.0, end_s=20.0),
        Loss(probability=0.3, start_s=15.0, end_s=15.0),  # ended before it began
        Loss(probability=1.0, start_s=1e6),
    )
    clock = [
        Clock(100, to_ns(10.0), "run", {}, held=(2,), down=(0,)),
        Clock(101, to_ns(10.1), "run", {}, held=(2,)),
        Clock(102, to_ns(10.2), "run", {}, held=(2,)),
        Clock(103, to_ns(10.3), "stop", {}),
    ]
    lines = lines_of(clock, plan, quiet(scene))
    assert [f"{line.t_ns / 1e9:g} {line.who}: {line.text}" for line in lines] == [
        "10 faults: begins: loss probability=0.2",
        "10 coordinator: its process is down",
        "10 UAV 2: its process is stopped",
        "10.1 coordinator: its process is running again",
        "20 faults: ends: loss probability=0.2",
    ]


def test_colours_are_told_apart_and_stay_with_a_uav() -> None:
    assert len(set(OKABE_ITO)) == len(OKABE_ITO) == 7
    assert colour_of(0) == colour_of(7) == "#0072B2"
    assert rgb_of(1) == (0xE6, 0x9F, 0x00)


def test_the_origin_has_a_default() -> None:
    origin = Scenario("x", 1.0).origin
    assert (origin.latitude_deg, origin.longitude_deg) == (47.397742, 8.545594)
