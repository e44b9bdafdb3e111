"""Resolution trajectories: the candidates of each logged decision, in space (eq. 5 to 11).

What was considered, which of it was safe and what was chosen is in the log. The paths are not: they
are predicted, from the true states at the moment when the command starts, with the model's own
mapping M. The computing UAV went by what it had heard, so with faults its view differs from this.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from fleet.config.scenario import Scenario
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.tracks import StateReport, intent_of
from fleet.model.types import Array
from fleet.model.units import to_s, wrap_angle
from fleet.model.vehicle.intent import Intent
from fleet.model.words import AVOIDING, Manoeuvre
from fleet.protocol.advisories import LoggedAdvisory, LoggedCandidate
from fleet.protocol.messages import Decision
from fleet.protocol.surveillance import manoeuvre_of
from fleet.report.curves import manoeuvre_words
from fleet.report.risk import reports_at
from fleet.report.run_data import RunData

BEGINS_M, COMES_M = 2000.0, 1000.0
"""Who is as near to somebody is drawn with him."""


@dataclass(frozen=True)
class DrawnCandidate:
    """A candidate of the log with its path (n, 3) over 2 T_s."""

    logged: LoggedCandidate
    ned_m: Array

    @property
    def words(self) -> str:
        """As in `turn +30°` or `dive 2 m/s`."""
        c = self.logged
        speed_mps = c.speed_mps or 0.0
        return manoeuvre_words(c.manoeuvre, c.turn_rad, c.climb_mps, speed_mps) or c.manoeuvre


@dataclass(frozen=True)
class Resolved:
    """One encounter: at `time_s` this UAV was told what; the candidates, and what others flew.

    `candidates` are those that were not chosen: none where the resolver logs none.
    """

    time_s: float
    computing: int
    term: int
    encounter: LoggedAdvisory
    times_s: Array
    chosen: DrawnCandidate
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


def resolutions(run_data: RunData, most: int) -> list[Resolved]:
    """The encounters in which somebody was told a manoeuvre, in order, and at most so many."""
    decisions = (_decided(run_data, decision) for decision in run_data.of(Decision))
    return list(islice(chain.from_iterable(decisions), most))


def _decided(run_data: RunData, decision: Decision) -> Iterator[Resolved]:
    """The encounters of one decision, in its order: each reckons with those before it."""
    if not any(e.manoeuvre in AVOIDING for e in decision.encounters):
        return
    start_s = to_s(decision.t_ns) + run_data.scenario.commands.lead_s
    reports = {r.id: r for r in reports_at(run_data, run_data.at(start_s))}
    before = {r.id: r for r in reports_at(run_data, run_data.at(to_s(decision.t_ns)))}
    targets = {e.target for e in decision.encounters} & before.keys()
    intents = {
        uav: intent_of(r.guidance, before[uav].manoeuvre if uav in targets else r.manoeuvre)
        for uav, r in reports.items()
    }
    for encounter in decision.encounters:
        report = reports.get(encounter.target)
        if report is None:
            continue
        if encounter.manoeuvre == Manoeuvre.RESUME:
            intents[encounter.target] = report.guidance
        elif encounter.manoeuvre in AVOIDING:
            yield _resolved(run_data.scenario, decision, encounter, reports, intents)
            chosen = _chosen(encounter)
            intents[encounter.target] = _intent(run_data.scenario, report, chosen)


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
    logged = [_chosen(encounter), *(c for c in encounter.candidates if not c.chosen)]
    told = [_intent(scenario, target, candidate) for candidate in logged]
    paths = _paths(outlook, [target] * len(logged), told)
    chosen, *rest = (DrawnCandidate(*row) for row in zip(logged, paths, strict=True))
    return Resolved(
        to_s(decision.t_ns),
        decision.id,
        decision.term,
        encounter,
        outlook.times_s,
        chosen,
        rest,
        dict(zip(others, flown, strict=True)),
    )


def _paths(outlook: Outlook, reports: Sequence[StateReport], intents: Sequence[Intent]) -> Array:
    """Predicted paths, shape (m, n, 3)."""
    if not reports:
        return np.empty((0, len(outlook.times_s), 3))
    uavs, states = [r.id for r in reports], [r.state for r in reports]
    return outlook.models.positions(uavs, states, intents, outlook.times_s)


def _chosen(e: LoggedAdvisory) -> LoggedCandidate:
    """What was told, as a candidate."""
    return LoggedCandidate(
        e.manoeuvre, e.turn_rad, e.climb_mps, e.level_down_m, e.speed_mps, chosen=True
    )


def _intent(scenario: Scenario, report: StateReport, candidate: LoggedCandidate) -> Intent:
    """What a candidate flies: the axes that it does not command stay guidance's."""
    c, guidance = candidate, report.guidance
    level_down_m = math.nan if c.level_down_m is None else c.level_down_m
    level_down_m = scenario.altitudes().level_m(c.climb_mps, level_down_m, report.state.down_m)
    heading_rad = wrap_angle(guidance.heading_rad + c.turn_rad)
    told = (heading_rad, c.climb_mps, level_down_m, c.speed_mps)
    return intent_of(guidance, manoeuvre_of(c.manoeuvre, *told))
