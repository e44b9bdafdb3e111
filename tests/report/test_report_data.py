"""What the report draws, held against the log that it is drawn from."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fleet
from fleet.agents.advisory import Advisory, Candidate, Situation
from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.separation import SeparationMonitor
from fleet.config.scenario import Scenario
from fleet.errors import LogError
from fleet.log.reader import Record, read
from fleet.model.conflict.risk import normalised_separation
from fleet.model.units import to_s, wrap_angle
from fleet.protocol import codec
from fleet.protocol.messages import (
    Ack,
    Clock,
    Command,
    Conflict,
    DeliveryReport,
    Election,
    Message,
    Truth,
)
from fleet.protocol.topics import CLOCK
from fleet.report.curves import (
    FlownCommand,
    flown_commands,
    intervals,
    kept,
    manoeuvre_words,
    pair_curves,
    steps,
)
from fleet.report.draw_resolution import resolution_chart
from fleet.report.events import mandates, pairs_at_risk, timeline_of, told_in_order
from fleet.report.links import (
    class_rows,
    latencies,
    message_columns,
    share_by_link,
    share_over_time,
)
from fleet.report.resolution import resolutions
from fleet.report.risk import risks
from fleet.report.run_data import RunData, run_data_of
from tests.support.report_samples import alone, clean, disturbed, log_of
from tests.support.rewriting import rewritten
from tests.support.samples import S, election

TURN_RAD = math.radians(20.0)


def messages(path: Path) -> list[Message]:
    """Everything in a log but the clock and the digests."""
    told = (r for r in read(path) if not r.topic.startswith("sim/"))
    return [codec.decode(r.topic, r.payload) for r in told]


# the events


def test_flights_are_the_true_states_that_were_logged() -> None:
    run_data = clean()
    flights = {f.id: f for f in run_data.flights}
    truths = [m for m in messages(log_of("four_way", "duration_s=100")) if isinstance(m, Truth)]
    assert len(truths) == 4 * len(run_data.times_s)
    for truth in truths[::97]:
        flight, at = flights[truth.id], run_data.at(to_s(truth.t_ns))
        assert run_data.times_s[at] == pytest.approx(to_s(truth.t_ns))
        assert tuple(flight.ned_m[at]) == truth.position_ned_m
        assert flight.heading_rad[at] == truth.heading_rad
        assert tuple(flight.commanded[at, :3]) == (
            truth.commanded_heading_rad,
            truth.commanded_climb_mps,
            truth.commanded_level_down_m,
        )
        assert math.isnan(flight.commanded[at, 3])  # nobody was told a speed
        assert flight.modes[at] == truth.mode


def test_link_messages_are_the_delivery_reports() -> None:
    told = messages(log_of("four_way", "duration_s=80", "seed=2", faults=True))
    reports = [m for m in told if isinstance(m, DeliveryReport)]
    link_messages = disturbed().link_messages
    assert len(link_messages) == sum(len(r.src) for r in reports)
    fates = [link_messages.fate_names[n] for n in link_messages.fates]
    assert fates == [fate for r in reports for fate in r.fates]
    lost = [to_s(got) for r in reports for got in r.delivered_ns if not got]
    assert np.isnan(link_messages.delivered_s).sum() == len(lost) > 0


def test_who_is_down_is_known_and_where_its_aircraft_flies() -> None:
    run_data = disturbed()
    assert run_data.absences == {(1, "down"): [(30.0, 80.0)]}
    assert set(run_data.flights[0].modes[run_data.at(31.0) :]) == {"unmanned"}


def test_a_log_cut_short_is_shown_up_to_there_and_says_so(tmp_path: Path) -> None:
    whole = log_of("four_way", "duration_s=100").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    run_data = run_data_of(RecordedRun.of_log(cut))
    assert 0.0 < run_data.end_s < clean().end_s
    assert "damaged or cut short" in run_data.damage
    assert f"{run_data.end_s:g} s" in run_data.damage
    np.testing.assert_array_equal(
        run_data.flights[1].ned_m, clean().flights[1].ned_m[: len(run_data.times_s)]
    )
    assert clean().damage == ""


def test_only_grants_and_changes_of_the_plan_say_who_is_away() -> None:
    """A realtime run grants one epoch to a process that comes back, which lists nobody."""
    grants = [
        Clock(0, 2 * S, "plan", {}, down=(2,)),
        Clock(0, 3 * S, "plan", {}, down=(1, 2)),
        Clock(0, 5 * S, "epoch", {}),
        Clock(0, 5 * S, "plan", {}, down=(2,)),
    ]
    records = [Record(CLOCK, codec.encode(g), 0, g.t_ns, g.t_ns) for g in grants]
    flown = [r for r in read(log_of("four_way", "duration_s=100")) if r.topic == "1/truth"]
    run_data = run_data_of(
        RecordedRun.of_records(clean().scenario, [*records, *flown], plan=(), realtime=True)
    )
    assert run_data.absences == {(2, "down"): [(2.0, 100.0)], (1, "down"): [(3.0, 5.0)]}


def test_a_plan_of_another_version_is_said_in_words(tmp_path: Path) -> None:
    def foreign(_: int, record: Record) -> Record:
        if record.topic != CLOCK or record.seq != 50:
            return record
        plan = '[{"kind": "gremlin"}]'
        grant = msgspec.structs.replace(codec.decode_clock(record.payload), plan=plan)
        return dataclasses.replace(record, payload=codec.encode(grant))

    log = rewritten(log_of("four_way", "duration_s=100"), tmp_path / "new.mcap", foreign)
    with pytest.raises(LogError, match="use the version of fleet that wrote it"):
        run_data_of(RecordedRun.of_log(log))


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"something else")
    with pytest.raises(LogError, match="not an MCAP file"):
        run_data_of(RecordedRun.of_log(other))
    with pytest.raises(LogError, match="cannot read"):
        run_data_of(RecordedRun.of_log(tmp_path / "missing.mcap"))


# curves


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=60), st.floats(0.01, 100.0))
def test_a_lightened_curve_is_near_the_whole_one(values: list[float], tolerance: float) -> None:
    times, curve = np.arange(float(len(values))), np.array(values)
    some = kept(times, curve, tolerance)
    assert {0, len(values) - 1} <= set(some)
    assert np.abs(np.interp(times, times[some], curve[some]) - curve).max() <= tolerance * 1.000001


def test_a_lightened_curve_breaks_where_nothing_is() -> None:
    values = np.array([0.0, 0.0, 0.0, math.nan, math.nan, 1.0, 1.0, 1.0])
    assert list(kept(np.arange(8.0), values, 0.1)) == [0, 2, 3, 5, 7]


def test_intervals_end_where_the_flag_is_down_again() -> None:
    times = np.arange(6.0)
    flags = np.array([False, True, True, False, False, True])
    assert intervals(times, flags) == [(1.0, 3.0), (5.0, 5.0)]


def test_steps_go_up_and_down_and_straight_to_the_next() -> None:
    def flown(start_s: float, end_s: float) -> FlownCommand:
        return FlownCommand(1, 0, start_s, end_s, "climb", 0.0, 1.0, (1, 1, 1))

    x, y = steps([flown(1, 2), flown(2, 3), flown(5, 6)], [1.0, 2.0, 3.0])
    nan = math.nan
    np.testing.assert_array_equal(x, [1, 1, 2, 2, 3, 3, nan, 5, 5, 6, 6])
    np.testing.assert_array_equal(y, [0, 1, 1, 2, 2, 0, nan, 0, 3, 3, 0])


def test_pairs_are_as_near_as_the_run_measured() -> None:
    run_data = clean()
    monitor = SeparationMonitor([f.id for f in run_data.flights], run_data.scenario.required())
    for n, t_s in enumerate(run_data.times_s):
        monitor.update(round(t_s * 1e9), np.array([f.ned_m[n] for f in run_data.flights]))
    curves = pair_curves(run_data, 100)
    assert [c.ids for c in curves] == [(m.a, m.b) for m in monitor.minima()]
    for curve, minimum in zip(curves, monitor.minima(), strict=True):
        assert curve.least == minimum.least_separation
        assert curve.horizontal_m[curve.nearest] == minimum.horizontal_m
        assert curve.times_s[curve.nearest] == pytest.approx(minimum.t_s)
    assert pair_curves(alone(), 10) == []


def test_commands_in_force_are_those_told_from_when_they_were_to_start() -> None:
    run_data = clean()
    told = {(c.term, c.id, c.number): c for c in run_data.of(Command)}
    acks = {(a.term, a.target, a.number): a for a in run_data.of(Ack) if a.accepted}
    flown = flown_commands(run_data)
    assert {f.uav for f in flown} == {2, 3, 4}
    for one in flown:
        command = told[one.command_id]
        assert (one.uav, one.manoeuvre, one.climb_mps) == (
            command.target,
            command.manoeuvre,
            command.climb_mps,
        )
        assert one.turn_rad == command.turn_rad
        assert one.start_s == pytest.approx(to_s(acks[one.command_id].actuate_ns), abs=0.11)


def test_manoeuvres_in_words() -> None:
    assert manoeuvre_words("turn_climb", math.radians(-45.0), 2.0) == "turn -45°, climb 2 m/s"
    assert manoeuvre_words("speed", 0.0, 0.0, 23.8333) == "speed 23.8 m/s"
    assert manoeuvre_words("climb", 0.0, -2.5) == "dive 2.5 m/s"
    assert manoeuvre_words("resume", 0.0, 0.0) == ""


# risk and resolution


def test_risk_from_true_states_is_what_the_coordinator_saw_without_faults() -> None:
    run_data = clean()
    seen = pairs_at_risk(run_data, {})
    found = risks(run_data)
    assert run_data.of(Conflict)
    assert seen.keys() == found.keys()
    for pair, spans in seen.items():
        assert np.array(found[pair].planned) == pytest.approx(np.array(spans), abs=0.21)


def test_what_is_flown_is_free_of_risk_soon_after_the_command() -> None:
    for risk in risks(clean()).values():
        assert all(end - start < 1.0 for start, end in risk.flown)


def test_without_a_coordinator_the_risk_shown_is_computed() -> None:
    run_data = run_data_of(
        RecordedRun.of_log(log_of("head_on", "coordination.electors=local", "duration_s=40"))
    )
    assert not run_data.of(Conflict)
    assert list(pairs_at_risk(run_data, risks(run_data))) == [(1, 2)]


def test_what_is_drawn_of_a_decision_is_what_was_logged() -> None:
    decided = resolutions(clean(), 100)
    assert [(d.target, d.encounter.stage) for d in decided] == [
        (2, "axis"),
        (3, "axis"),
        (4, "axis"),
    ]
    for one in decided:
        logged = one.encounter.candidates
        assert [c.logged for c in one.candidates] == [c for c in logged if not c.chosen]
        assert len(one.candidates) == len(logged) - 1 > 10
        (chosen,) = [c for c in logged if c.chosen]
        assert chosen.safe
        drawn = one.chosen.logged
        assert (drawn.manoeuvre, drawn.turn_rad) == (chosen.manoeuvre, chosen.turn_rad)
        assert (drawn.climb_mps, drawn.level_down_m) == (chosen.climb_mps, chosen.level_down_m)


def test_where_a_candidate_first_overlaps_is_at_the_zone_of_another() -> None:
    """The paths that are drawn are those which the resolver had: at that time they meet."""
    required = clean().scenario.required()
    for one in resolutions(clean(), 100):
        unsafe = [(c, s) for c in one.candidates if (s := c.logged.first_overlap_s) is not None]
        assert unsafe
        for c, overlap_s in unsafe:
            assert not c.logged.safe
            at = int(np.searchsorted(one.times_s, overlap_s))
            apart = [
                float(normalised_separation(path[at] - c.ned_m[at], required))
                for path in one.others.values()
            ]
            assert min(apart) < 1.15


class TurnRight:
    """Tells UAV 2 a turn by 20 degrees, of which the heading alone, and no candidates."""

    candidates: tuple[Candidate, ...] = ()

    def __init__(self, scenario: Scenario) -> None:
        """Needs nothing of the scenario."""

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        """One advisory."""
        return [
            Advisory(
                one.id,
                "turn",
                heading_rad=wrap_angle(one.guidance.heading_rad + TURN_RAD),
                manoeuvre_s=30.0,
                candidates=self.candidates,
            )
            for one in situation.aircraft
            if one.id == 2 and one.manoeuvre is None
        ]


class TurnRightOrClimb(TurnRight):
    """The same, with candidates."""

    candidates = (
        Candidate("turn", TURN_RAD, safe=True),
        Candidate("climb", climb_mps=2.5, first_overlap_s=12.0),
    )


def flown_by(resolver: type[TurnRight]) -> RunData:
    scenario = fleet.load_scenario("head_on", {"duration_s": 40})
    return run_data_of(fleet.run(scenario, resolver=resolver))


def test_of_a_resolver_that_logs_no_candidates_only_its_choice_is_drawn() -> None:
    run_data = flown_by(TurnRight)
    decided = resolutions(run_data, 100)
    assert decided
    assert all(one.candidates == [] for one in decided)
    assert decided[0].chosen.words == "turn +20°"
    (chosen, *_) = resolution_chart(run_data, decided).choices
    names = [trace.get("name", "") for trace in chosen.traces]
    assert not any("candidates" in name or "overlap" in name for name in names)
    assert chosen.note.startswith(
        "The resolver logged no candidates, predicted to last 30 s. Only what it chose is drawn."
    )


def test_candidates_of_any_resolver_are_drawn() -> None:
    run_data = flown_by(TurnRightOrClimb)
    one = resolutions(run_data, 1)[0]
    assert [c.words for c in one.candidates] == ["climb 2.5 m/s"]
    assert [c.chosen for c in one.encounter.candidates] == [True, False]
    (choice, *_) = resolution_chart(run_data, [one]).choices
    names = [trace.get("name", "") for trace in choice.traces]
    assert {"unsafe candidates", "first overlap", "UAV 2: turn +20°"} <= {*names}


def test_the_candidate_flown_is_the_path_flown() -> None:
    run_data = clean()
    for one in resolutions(run_data, 100):
        start = run_data.at(one.time_s + run_data.scenario.commands.lead_s)
        flight = run_data.flights[run_data.index_of(one.target)]
        for seconds in (5, 10, 20):
            at = int(np.searchsorted(one.times_s, seconds))
            flown = flight.ned_m[start + 10 * seconds]
            assert np.abs(flown - one.chosen.ned_m[at]).max() < 5.0


# events and links


def test_the_timeline_has_everything_that_happened() -> None:
    run_data = disturbed()
    timeline = timeline_of(run_data, risks(run_data))
    assert {b.kind for b in timeline.bars} == {"risk", "mandate", "command", "fault", "absent"}
    assert {"command", "repeated", "accepted", "refused"} <= {m.kind for m in timeline.moments}
    commands = {(c.term, c.id, c.number) for c in run_data.of(Command)}
    assert sum(m.kind == "command" for m in timeline.moments) == len(commands)
    assert sum(m.kind == "refused" for m in timeline.moments) == sum(
        run_data.tally.refused.values()
    )
    assert [b.text for b in timeline.bars if b.kind == "fault"] == [
        "latency base_s=0.5",
        "loss probability=0.3",
        "partition groups=1,2/3,4",
        "kill node=1",
    ]
    assert all(0.0 <= b.start_s <= b.end_s <= run_data.end_s for b in timeline.bars)
    assert {b.row for b in timeline.bars} | {m.row for m in timeline.moments} == set(timeline.rows)
    times = [m.time_s for m in told_in_order(timeline)]
    assert times == sorted(times)


def test_each_term_is_a_bar_of_its_computing_uav() -> None:
    run_data = disturbed()
    bars = [b for b in timeline_of(run_data, {}).bars if b.kind == "mandate"]
    assert {b.note for b in bars} == {f"term {term}" for term in run_data.tally.terms}
    assert {b.uav for b in bars} == set(run_data.tally.terms.values())


def test_a_mandate_lasts_no_longer_than_its_members_hold_it() -> None:
    elections: list[Message] = [
        election(5, (1, 2), 1, valid_until_ns=900 * S, t_ns=10 * S),  # by a clock ahead,
        election(9, (3, 4), 3, valid_until_ns=1 * S, t_ns=20 * S),  # and by one behind
    ]
    run_data = dataclasses.replace(clean(), said={Election: elections})
    bars = {bar.uav: (bar.start_s, bar.end_s) for bar in mandates(run_data)}
    assert bars == {1: (10.0, 12.0), 3: (20.0, 20.0)}


def test_link_statistics_add_up() -> None:
    run_data = disturbed()
    share, total = share_by_link(run_data)
    assert total.sum() == len(run_data.link_messages)
    assert np.isnan(share[0, 0])  # the coordinator; a computing UAV may command itself
    assert np.nansum(share * total) == np.isfinite(run_data.link_messages.delivered_s).sum()
    rows = class_rows(run_data.tally)
    assert sum(r.came + sum(r.dropped.values()) for r in rows) == len(run_data.link_messages)
    middle, shares = share_over_time(run_data, 5.0)
    assert len(middle) == 16
    assert np.nanmean(shares["adsb"]) == pytest.approx(0.7, abs=0.05)
    for kind, (values, within) in latencies(run_data).items():
        # A computing UAV's command to itself, and its answer, come at the next tick.
        assert list(values) == ([0.1, 0.5] if kind in ("cmd", "ack") else [0.5])
        assert len(within) == len(values)
        assert within[-1] == 1.0


def test_the_message_diagram_leaves_out_what_is_too_much() -> None:
    run_data = clean()
    columns, left_out = message_columns(run_data, 10**9)
    assert left_out == []
    assert len(columns["src"]) == len(run_data.link_messages)
    assert (np.diff(columns["sent_s"]) >= 0.0).all()
    columns, left_out = message_columns(run_data, 2000)
    assert "adsb" in left_out
    kinds = {run_data.link_messages.kind_names[k] for k in columns["kind"]}
    assert kinds == {*run_data.link_messages.kind_names} - {*left_out}
    assert {"cmd", "ack", "election"} <= kinds
