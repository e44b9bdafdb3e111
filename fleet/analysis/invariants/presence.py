"""Presence: who is stopped or dead in each tick is what the fault plan makes of it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from msgspec import Struct, field

from fleet.analysis.invariants.absences import Absent
from fleet.analysis.invariants.accounting import name
from fleet.analysis.invariants.index import Index
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.faults.lifecycle import DOWN, HELD, UP, LifecycleSchedule
from fleet.model.words import Mode
from fleet.protocol.topics import CLOCK, issuer_name

MODES = {HELD: Mode.HELD, DOWN: Mode.UNMANNED}
"""Modes of the true states that the simulation writes for who is away."""


class PlannedAway(Struct):
    """By participant and time: when it is not up, and in what mode its aircraft is flown on."""

    held_or_down: defaultdict[int, dict[int, str]] = field(
        default_factory=lambda: defaultdict(dict)
    )
    flown: defaultdict[int, dict[int, str]] = field(default_factory=lambda: defaultdict(dict))


def processes(index: Index) -> Examination:
    """The grants list as stopped and killed whom the plan stops and kills, tick by tick.

    In lockstep everybody steps when it is there, and only then; meanwhile the simulation flies the
    aircraft, unless that has vanished. In realtime a process is not stopped to the tick.
    """
    examination = Examination()
    ticks = _ticks(index)
    planned = _granted(index, ticks, examination)
    if not index.run.realtime:
        for node in index.nodes:
            _steps(index, node, ticks, planned.held_or_down[node], examination)
        for uav in index.uavs:
            _flown(index, uav, planned.flown[uav], examination)
    return examination


def _ticks(index: Index) -> list[int]:
    """The times of all ticks in which anything was granted or done."""
    times = index.absences.grants.keys() | set[int]().union(*index.stepped.values())
    return sorted(t for t in times if t % index.tick_ns == 0 and t <= index.settled_ns)


def _granted(index: Index, ticks: Sequence[int], examination: Examination) -> PlannedAway:
    """Hold each grant against the plan; returns what the plan says."""
    schedule = LifecycleSchedule(index.nodes, index.run.plan, index.tick_ns)
    away, planned, told = PlannedAway(), Absent(), Absent()
    for t_ns in ticks:
        examination.examined += 1
        tick = t_ns // index.tick_ns
        if schedule.advance(tick):
            planned = Absent(schedule.held, schedule.down)
        told = index.absences.grants.get(t_ns, told)
        if planned == told == Absent():
            continue
        if planned != told:
            _differs(t_ns, planned, told, examination)
        for mode, nodes in ((HELD, planned.held), (DOWN, planned.down)):
            for node in nodes:
                away.held_or_down[node][t_ns] = mode
                if mode == HELD or not schedule.vanishes(node, tick):
                    away.flown[node][t_ns] = MODES[mode]
    return away


def _differs(t_ns: int, planned: Absent, told: Absent, examination: Examination) -> None:
    for node in sorted({*planned.held, *planned.down, *told.held, *told.down}):
        if _presence(planned, node) != _presence(told, node):
            what = f"{name(node)} is {_presence(told, node)}, and {_presence(planned, node)} by the"
            shown = {"held": told.held, "down": told.down}
            examination.blame(f"{what} fault plan", Witness(t_ns, CLOCK, shown))


def _presence(absent: Absent, node: int) -> str:
    return DOWN if node in absent.down else HELD if node in absent.held else UP


def _steps(
    index: Index, node: int, ticks: Sequence[int], away: dict[int, str], examination: Examination
) -> None:
    """Who is away does nothing, and who is there steps in every tick."""
    stepped = set(index.stepped[node])
    for t_ns in sorted(stepped & away.keys()):
        examination.blame(f"{name(node)} acts while it is {away[t_ns]}", _done(node, t_ns))
    for t_ns in sorted(set(ticks) - stepped - away.keys()):
        examination.blame(f"{name(node)} does not step, though nothing stops it", _done(node, t_ns))


def _done(node: int, t_ns: int) -> Witness:
    return Witness(t_ns, f"{issuer_name(node)}/done")


def _flown(index: Index, uav: int, planned: dict[int, str], examination: Examination) -> None:
    """The simulation flies an aircraft while its process is away, and only then."""
    told = index.unmanned[uav]
    for t_ns in sorted(planned.keys() - told.keys() if index.truths[uav] else ()):
        what = f"UAV {uav} is {planned[t_ns]}, and the simulation does not fly it"
        examination.blame(what, Witness(t_ns, f"{uav}/truth"))
    for t_ns, truth in told.items():
        mode = planned.get(t_ns, "flown by its own process")
        if mode != truth.mode:
            examination.blame(f"by the fault plan UAV {uav} is {mode}", witness(truth, "mode"))
