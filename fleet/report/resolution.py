"""Resolution trajectories: what a computing UAV chose among when it decided (eq. 5 to 11).

Each encounter of a logged decision is predicted again from the true states at the moment when its
command starts, with the model's own mapping M. The computing UAV went by what it had heard, so with
faults its view differs from this one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fleet.config.scenario import Scenario
from fleet.model.conflict.command_set import (
    Altitudes,
    climb_commands,
    command_set,
    speed_commands,
    turn_commands,
)
from fleet.model.conflict.groups import Outlook
from fleet.model.conflict.risk import first_overlap_s
from fleet.model.conflict.tracks import AVOIDING, StateReport, intent_of
from fleet.model.types import Array
from fleet.model.units import to_s, wrap_angle
from fleet.model.vehicle.intent import Intent
from fleet.protocol.messages import Decision, LoggedAdvisory
from fleet.protocol.surveillance import manoeuvre_of
from fleet.report.curves import manoeuvre_words
from fleet.report.risk import reports_at
from fleet.report.run_data import RunData

BEGINS_M, COMES_M = 2000.0, 1000.0
"""Who is as near to somebody is drawn with him."""

OptionKey = tuple[str, float, float, float]
"""Manoeuvre (empty: as guidance flies), tc in rad, cc in m/s, speed in m/s (0: as planned).

A climb levels off as the one taken does, or where the scenario's limits are.
"""


@dataclass(frozen=True)
class DrawnCandidate:
    """One option with its path (n, 3) over 2 T_s.

    `overlap_s` is when it first meets somebody's zone, margin included, within twice T_s (T_H for a
    climb), or inf; `low` tells that it sinks below the least altitude.
    """

    option: OptionKey
    ned_m: Array
    overlap_s: float
    low: bool
    chosen: bool

    @property
    def words(self) -> str:
        """As in `turn +30°` or `dive 2 m/s`."""
        return manoeuvre_words(*self.option) or "straight on"

    @property
    def safe(self) -> bool:
        """Whether it keeps clear of everybody and of the ground."""
        return math.isinf(self.overlap_s) and not self.low


@dataclass(frozen=True)
class Resolved:
    """One encounter: at `time_s` this UAV was told what; the options and what the others flew."""

    time_s: float
    computing: int
    term: int
    encounter: LoggedAdvisory
    times_s: Array
    candidates: list[DrawnCandidate]
    others: dict[int, Array]

    @property
    def target(self) -> int:
        """Who was told."""
        return self.encounter.target

    @property
    def near(self) -> dict[int, Array]:
        """The others that matter: those who begin or come near, and the computing UAV."""
        own = self.chosen.ned_m
        apart = {u: np.hypot(*(path - own)[:, :2].T) for u, path in self.others.items()}
        return {
            uav: path
            for uav, path in self.others.items()
            if uav == self.computing or apart[uav][0] < BEGINS_M or apart[uav].min() < COMES_M
        }

    @property
    def chosen(self) -> DrawnCandidate:
        """The option taken."""
        return next(c for c in self.candidates if c.chosen)


def resolutions(run_data: RunData, most: int) -> list[Resolved]:
    """The encounters in which somebody was told a manoeuvre, in order, and at most so many."""
    out: list[Resolved] = []
    for decision in run_data.of(Decision):
        if any(e.manoeuvre in AVOIDING for e in decision.encounters):
            out += _decided(run_data, decision)
        if len(out) >= most:
            break
    return out[:most]


def _decided(run_data: RunData, decision: Decision) -> list[Resolved]:
    """The encounters of one decision, in its order: each reckons with those before it."""
    start_s = to_s(decision.t_ns) + run_data.scenario.commands.lead_s
    reports = {r.id: r for r in reports_at(run_data, run_data.at(start_s))}
    before = {r.id: r for r in reports_at(run_data, run_data.at(to_s(decision.t_ns)))}
    targets = {e.target for e in decision.encounters} & before.keys()
    intents = {
        uav: intent_of(r.guidance, before[uav].manoeuvre if uav in targets else r.manoeuvre)
        for uav, r in reports.items()
    }
    out = []
    for encounter in decision.encounters:
        report = reports.get(encounter.target)
        if report is None:
            continue
        if encounter.manoeuvre == "resume":
            intents[encounter.target] = report.guidance
        elif encounter.manoeuvre in AVOIDING:
            out.append(_resolved(run_data.scenario, decision, encounter, reports, intents))
            told = _told([], encounter)
            intents[encounter.target] = _intent(
                report, told, encounter, run_data.scenario.altitudes()
            )
    return out


def _resolved(
    scenario: Scenario,
    decision: Decision,
    encounter: LoggedAdvisory,
    reports: dict[int, StateReport],
    intents: dict[int, Intent],
) -> Resolved:
    outlook = scenario.manoeuvre_outlook()
    others = [uav for uav in reports if uav != encounter.target]
    flown = _paths(outlook, [reports[u] for u in others], [intents[u] for u in others])
    target = reports[encounter.target]
    options, band = _options(scenario, encounter, target), scenario.altitudes()
    paths = _paths(
        outlook, [target] * len(options), [_intent(target, o, encounter, band) for o in options]
    )
    relative = paths[:, None] - flown[None]
    first = first_overlap_s(relative, outlook.times_s, outlook.required)
    floor = max(band.floor_down_m, target.state.down_m) + 1e-6
    soon = first.min(axis=1, initial=np.inf)
    free_s = np.array([2.0 * scenario.ahead_s(manoeuvre) for manoeuvre, *_ in options])
    overlaps = np.where(soon > free_s, np.inf, soon).tolist()
    low = np.any(paths[..., 2] > floor, axis=1).tolist()
    rows = zip(options, paths, overlaps, low, strict=True)
    told = options.index(_told(options, encounter))
    return Resolved(
        to_s(decision.t_ns),
        decision.id,
        decision.term,
        encounter,
        outlook.times_s,
        [DrawnCandidate(*row, chosen=n == told) for n, row in enumerate(rows)],
        dict(zip(others, flown, strict=True)),
    )


def _paths(outlook: Outlook, reports: Sequence[StateReport], intents: Sequence[Intent]) -> Array:
    """Predicted paths, shape (m, n, 3)."""
    if not reports:
        return np.empty((0, len(outlook.times_s), 3))
    uavs, states = [r.id for r in reports], [r.state for r in reports]
    return outlook.models.positions(uavs, states, intents, outlook.times_s)


def _cruise_mps(report: StateReport) -> float:
    planned = report.guidance.speed_mps
    return report.state.speed_mps if math.isnan(planned) else planned


def _options(scenario: Scenario, encounter: LoggedAdvisory, report: StateReport) -> list[OptionKey]:
    """TJ (eq. 7) and speeds; and the option taken if it is another (both axes, or level flight)."""
    r = scenario.resolution
    turns = turn_commands(math.radians(r.max_turn_deg), r.turn_options)
    climbs = climb_commands(r.max_dive_mps, r.max_climb_mps, r.climb_options)
    options = [
        ("turn" if tc else "climb" if cc else "", tc, cc, 0.0)
        for tc, cc in command_set(turns, climbs)
    ]
    cruise_mps = _cruise_mps(report)
    bounds = scenario.speeds_mps(report.id, cruise_mps)
    speeds = speed_commands(bounds, cruise_mps, r.speed_options)
    options += [("speed", 0.0, 0.0, speed) for speed in speeds]
    taken = _told(options, encounter)
    return options if taken in options else [*options, taken]


def _told(options: list[OptionKey], encounter: LoggedAdvisory) -> OptionKey:
    """The option of an encounter: that of the list which is it, or else a new one."""
    e = encounter
    told = (e.turn_rad, e.climb_mps, e.speed_mps or 0.0)
    for option in options:
        if option[0] == e.manoeuvre and math.dist(option[1:], told) < 1e-6:
            return option
    return (e.manoeuvre, *told)


def _intent(
    report: StateReport, option: OptionKey, taken: LoggedAdvisory, band: Altitudes
) -> Intent:
    """What an option flies: the axes that it does not command stay guidance's."""
    manoeuvre, turn_rad, climb_mps, speed_mps = option
    heading = wrap_angle(report.guidance.heading_rad + turn_rad)
    if not manoeuvre:
        return report.guidance
    level = taken.level_down_m if climb_mps * taken.climb_mps > 0.0 else math.nan
    level = band.level_m(climb_mps, level, report.state.down_m)
    return intent_of(report.guidance, manoeuvre_of(manoeuvre, heading, climb_mps, level, speed_mps))
