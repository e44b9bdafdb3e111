"""Between messages and the model: the same facts on the wire and in reports and states."""

from __future__ import annotations

import math

from msgspec import Struct

from fleet.model.conflict.tracks import ActiveManoeuvre, CommandId, StateReport
from fleet.model.vehicle.flight import Setpoint, State
from fleet.model.vehicle.guidance import FlightPlan, last_course
from fleet.model.vehicle.intent import Intent, NextCourse
from fleet.model.vehicle.speed_changes import STEADY_MPS
from fleet.model.words import CLIMBING, Manoeuvre
from fleet.protocol.messages import StateBroadcast, Truth

_read: dict[int, tuple[StateBroadcast, StateReport]] = {}
"""The last broadcast of each UAV that was read, and what it says: in memory all read the same."""


def report_of(message: StateBroadcast) -> StateReport:
    """What a broadcast says."""
    known = _read.get(message.id)
    if known is None or known[0] is not message:
        known = _read[message.id] = message, _report_of(message)
    return known[1]


def _report_of(m: StateBroadcast) -> StateReport:
    state = State(*m.position_ned_m, m.speed_mps, m.heading_rad, m.flight_path_rad)
    level_down_m = m.next_waypoint_ned_m[2]
    speed_mps = m.speed_mps if m.guidance_speed_mps is None else m.guidance_speed_mps
    then = NextCourse(
        m.reach_s,
        m.next_heading_rad,
        m.next_climb_mps,
        level_down_m,
        m.next_turn_rad,
        speed_mps,
    )
    guidance = Intent(
        m.guidance_heading_rad, m.guidance_climb_mps, m.waypoint_ned_m[2], then, speed_mps
    )
    points = (m.waypoint_ned_m, m.next_waypoint_ned_m)
    course_rad = last_course(points, m.guidance_heading_rad)
    plan = FlightPlan(points, course_rad, len(points) if m.arrived else 0)
    manoeuvre = None
    if m.manoeuvre:
        told = (m.commanded_heading_rad, m.commanded_climb_mps, m.commanded_level_down_m)
        manoeuvre = manoeuvre_of(m.manoeuvre, *told, m.commanded_speed_mps)
    command_id = CommandId(m.command_term, m.command_issuer, m.command_number)
    return StateReport(
        m.id,
        m.applies_ns,
        state,
        guidance,
        plan,
        manoeuvre,
        command_id,
        m.seq,
        m.mandate_term,
        m.mandate_valid,
        m.hears,
        m.equipment,
    )


def manoeuvre_of(
    manoeuvre: str,
    heading_rad: float,
    climb_mps: float,
    level_down_m: float,
    speed_mps: float | None = None,
) -> ActiveManoeuvre:
    """The manoeuvre that a message tells: a turn has no level, nor has level flight."""
    ends = manoeuvre in CLIMBING and climb_mps != 0.0
    level_down_m = level_down_m if ends else math.nan
    speed_mps = speed_mps if manoeuvre == Manoeuvre.SPEED and speed_mps else math.nan
    return ActiveManoeuvre(manoeuvre, heading_rad, climb_mps, level_down_m, speed_mps)


def told_speed(speed_mps: float) -> float | None:
    """A speed as messages tell it."""
    return None if math.isnan(speed_mps) else speed_mps


def broadcast_of(report: StateReport, now_ns: int, highest_term: int) -> StateBroadcast:
    """The broadcast that says it, sent at `now_ns`; plan and intent are a pilot's."""
    state, guidance, intent, command_id = (
        report.state,
        report.guidance,
        report.intent(),
        report.command_id,
    )
    assert guidance.then is not None
    steady = abs(guidance.speed_mps - state.speed_mps) <= STEADY_MPS
    return StateBroadcast(
        id=report.id,
        seq=report.seq,
        t_ns=now_ns,
        applies_ns=report.t_ns,
        position_ned_m=state.position_ned_m,
        velocity_ned_mps=state.velocity_ned_mps,
        speed_mps=state.speed_mps,
        heading_rad=state.heading_rad,
        flight_path_rad=state.flight_path_rad,
        waypoint_ned_m=report.plan.waypoints[0],
        next_waypoint_ned_m=report.plan.waypoints[1],
        arrived=report.plan.arrived,
        guidance_heading_rad=guidance.heading_rad,
        guidance_climb_mps=guidance.climb_mps,
        reach_s=guidance.then.after_s,
        next_heading_rad=guidance.then.heading_rad,
        next_turn_rad=guidance.then.turn_rad,
        next_climb_mps=guidance.then.climb_mps,
        manoeuvre=report.manoeuvre.manoeuvre if report.manoeuvre else "",
        commanded_heading_rad=intent.heading_rad,
        commanded_climb_mps=intent.climb_mps,
        commanded_level_down_m=_level_down_m(intent, state),
        command_term=command_id.term,
        command_issuer=command_id.issuer,
        command_number=command_id.number,
        highest_term=highest_term,
        mandate_term=report.mandate_term,
        mandate_valid=report.mandate_valid,
        hears=report.hears,
        equipment=report.equipment,
        guidance_speed_mps=None if steady else told_speed(guidance.speed_mps),
        commanded_speed_mps=told_speed(report.manoeuvre.speed_mps) if report.manoeuvre else None,
    )


class Flown(Struct, frozen=True, gc=False):
    """What a UAV flies: by which command, what that asks for, and what guidance would do instead.

    `mode` is the manoeuvre, `plan` or `arrived`; `waypoint_index` counts the waypoints passed.
    """

    mode: str
    waypoint_index: int
    guidance: Setpoint
    intent: Intent
    command_id: CommandId


def truth_of(uav: int, seq: int, now_ns: int, state: State, flown: Flown) -> Truth:
    """The true state of a UAV, what its guidance wants and what it flies now."""
    intent, guidance, command_id = flown.intent, flown.guidance, flown.command_id
    return Truth(
        uav,
        seq,
        now_ns,
        state.position_ned_m,
        state.velocity_ned_mps,
        state.speed_mps,
        state.heading_rad,
        state.flight_path_rad,
        flown.mode,
        flown.waypoint_index,
        guidance.heading_rad,
        guidance.climb_mps,
        intent.heading_rad,
        intent.climb_mps,
        _level_down_m(intent, state),
        command_id.term,
        command_id.issuer,
        command_id.number,
        told_speed(intent.speed_mps),
    )


def _level_down_m(intent: Intent, state: State) -> float:
    """Where a climb levels off; here, if it is none."""
    return state.down_m if math.isnan(intent.level_down_m) else intent.level_down_m


def state_of(truth: Truth) -> State:
    """The state that a truth message tells."""
    return State(*truth.position_ned_m, truth.speed_mps, truth.heading_rad, truth.flight_path_rad)
