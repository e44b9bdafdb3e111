"""Between broadcasts and reports: the same facts on the wire and in the model."""

from __future__ import annotations

from fleet.comms.messages import Adsb
from fleet.model.flight import State
from fleet.model.guidance import Plan
from fleet.model.tracks import CommandId, Escape, Report
from fleet.model.trajectory import Aim


def report_of(message: Adsb) -> Report:
    """What a broadcast says."""
    m = message
    state = State(*m.position_ned_m, m.speed_mps, m.heading_rad, m.flight_path_rad)
    guidance = Aim(m.guidance_heading_rad, m.guidance_climb_mps, m.waypoint_ned_m[2])
    plan = Plan((m.waypoint_ned_m,), int(m.arrived), m.guidance_heading_rad)
    escape = None
    if m.escape:
        escape = Escape(m.escape, m.commanded_heading_rad, m.commanded_climb_mps)
    command = CommandId(m.command_term, m.command_issuer, m.command_number)
    return Report(m.id, m.t_ns, state, guidance, plan, escape, command)


def broadcast_of(report: Report, seq: int, highest_term: int) -> Adsb:
    """The broadcast that says it."""
    state, guidance, aim, command = report.state, report.guidance, report.aim(), report.command
    return Adsb(
        id=report.id,
        seq=seq,
        t_ns=report.t_ns,
        position_ned_m=state.position_ned_m,
        velocity_ned_mps=state.velocity_ned_mps,
        speed_mps=state.speed_mps,
        heading_rad=state.heading_rad,
        flight_path_rad=state.flight_path_rad,
        waypoint_ned_m=report.plan.waypoint,
        arrived=report.plan.arrived,
        guidance_heading_rad=guidance.heading_rad,
        guidance_climb_mps=guidance.climb_mps,
        escape=report.escape.manoeuvre if report.escape else "",
        commanded_heading_rad=aim.heading_rad,
        commanded_climb_mps=aim.climb_mps,
        command_term=command.term,
        command_issuer=command.issuer,
        command_number=command.number,
        highest_term=highest_term,
    )
