"""Tracks: what one process knows of the others from the broadcasts it heard."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import msgspec
import numpy as np
from msgspec import Struct

from fleet.model.conflict.contact import INCARNATION, Contact
from fleet.model.equipment import FULL
from fleet.model.types import Array
from fleet.model.units import to_s
from fleet.model.vehicle.fleet_models import FleetModels
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent
from fleet.model.words import CLIMBING, TURNING, Manoeuvre

BELIEVED_AFTER = 3
"""So many implausible reports in a row that fit each other begin a new track."""


MISSED = 50
"""So many broadcasts more than there can have been may seem to be missing, for clocks may err."""


class CommandId(Struct, frozen=True, gc=False):
    """Identity of a command: term, issuer, number. All zero: none."""

    term: int = 0
    issuer: int = 0
    number: int = 0

    def __bool__(self) -> bool:
        """Whether it names a command."""
        return self.number > 0


NO_COMMAND = CommandId()


class ActiveManoeuvre(Struct, frozen=True, gc=False):
    """A manoeuvre being flown instead of guidance's: turn, climb, turn_climb or speed.

    A climb or dive ends by levelling off at `level_down_m` (NaN: it does not end). `speed` flies
    guidance's course at `speed_mps`.
    """

    manoeuvre: str
    heading_rad: float
    climb_mps: float
    level_down_m: float = math.nan
    speed_mps: float = math.nan


class StateReport(Struct, frozen=True, gc=False):
    """What a UAV last said of itself: state, what guidance wants, what is flown instead, its term.

    `t_ns` is the time of the state by the UAV's own clock. Of the plan a broadcast tells what
    `Pilot.ahead` says: the active waypoint and the next.
    """

    id: int
    t_ns: int
    state: State
    guidance: Intent
    plan: FlightPlan
    manoeuvre: ActiveManoeuvre | None = None
    command_id: CommandId = NO_COMMAND
    seq: int = 0
    mandate_term: int = 0
    mandate_valid: bool = False
    hears: bool = True
    equipment: str = FULL

    def intent(self) -> Intent:
        """What it flies now."""
        return intent_of(self.guidance, self.manoeuvre)

    def straight(self) -> StateReport:
        """The same UAV flying on straight and level, as one does whose computer has failed.

        Nor is it under a mandate any more, whatever it last said.
        """
        heading = self.state.heading_rad
        plan = FlightPlan((self.state.position_ned_m,), heading, 1)
        return msgspec.structs.replace(
            self,
            guidance=Intent(heading, 0.0),
            plan=plan,
            manoeuvre=None,
            command_id=NO_COMMAND,
            mandate_valid=False,
        )


def intent_of(guidance: Intent, manoeuvre: ActiveManoeuvre | None) -> Intent:
    """The aim of a manoeuvre: guidance's, but for the axes that the manoeuvre takes over.

    One that turns does not come to the waypoint, and so not to what guidance does there.
    """
    if manoeuvre is None:
        return guidance
    turning = manoeuvre.manoeuvre in TURNING
    climbing = manoeuvre.manoeuvre in CLIMBING
    then = None if turning else guidance.then
    if then is not None and climbing:
        then = msgspec.structs.replace(
            then, climb_mps=manoeuvre.climb_mps, level_down_m=manoeuvre.level_down_m
        )
    return Intent(
        manoeuvre.heading_rad if turning else guidance.heading_rad,
        manoeuvre.climb_mps if climbing else guidance.climb_mps,
        manoeuvre.level_down_m if climbing else guidance.level_down_m,
        then,
        manoeuvre.speed_mps if manoeuvre.manoeuvre == Manoeuvre.SPEED else guidance.speed_mps,
    )


def fastest_mps(state: State, guidance: Intent, manoeuvre: ActiveManoeuvre | None) -> float:
    """The greatest speed of a UAV while it flies the manoeuvre, or guidance again."""
    return max(state.speed_mps, guidance.speed_mps, manoeuvre.speed_mps if manoeuvre else 0.0)


@dataclass(frozen=True, slots=True)
class TrackRules:
    """When a track is silent, when it is dropped, and which jumps are not believed."""

    silence_ns: int
    timeout_ns: int
    jump_m: float
    max_acceleration_mps2: float
    broadcast_ns: int


UNHEARD_NS = -(2**62)


class TrafficPicture(Protocol):
    """What one receiver knows of the others; times are by its own clock."""

    def hear(self, report: StateReport, now_ns: int, *, answering: bool = False) -> bool:
        """Take in a report heard at `now_ns`; False if it is not believed.

        An older report never replaces a newer one, but is heard all the same. A new one that is
        believed may be `answering` an election.
        """
        ...

    def limit_ns(self, uav: int) -> int:
        """How long the silence of a UAV must last to mean something."""
        ...

    def answered_ns(self, uav: int) -> int:
        """When a UAV last answered an election; `UNHEARD_NS` if it has not."""
        ...

    def share(self, uavs: Iterable[int]) -> float:
        """Of what these UAVs sent lately, the share that came of the one heard worst."""
        ...

    def current(self, now_ns: int) -> list[StateReport]:
        """Reports heard within the time-out, in ID order; who is silent flies straight on."""
        ...

    def silent(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been silent for longer than the limit."""
        ...

    def present(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been heard within the limit, and whose tracks have not been dropped."""
        ...

    def hears_any(self, uavs: Collection[int] | None, now_ns: int) -> bool:
        """Whether any UAV is present, or any of these."""
        ...


class Tracks:
    """A `TrafficPicture` of few UAVs: the latest believed report of each, and its contact.

    Many are taken in together: see `fleet.model.conflict.track_table`.
    """

    def __init__(self, rules: TrackRules) -> None:
        self._rules = rules
        self._reports: dict[int, StateReport] = {}
        self._contacts: dict[int, Contact] = {}
        self._doubted: dict[int, list[StateReport]] = {}
        self._answered_ns: dict[int, int] = {}

    def hear(self, report: StateReport, now_ns: int, *, answering: bool = False) -> bool:
        """Take in a report heard at `now_ns`; False if it is not believed."""
        known = self._reports.get(report.id)
        if known is not None:
            if report.seq <= known.seq:
                return True
            if not plausible(known, report, self._rules) and not self._insists(report):
                return False
        if self._doubted:
            self._doubted.pop(report.id, None)
        if answering:
            self._answered_ns[report.id] = now_ns
        self._reports[report.id] = report
        contact = self._contacts.get(report.id)
        if contact is None:
            silence_ns, broadcast_ns = self._rules.silence_ns, self._rules.broadcast_ns
            self._contacts[report.id] = Contact(silence_ns, broadcast_ns, report.seq, now_ns)
        else:
            contact.hear(report.seq, now_ns)
        return True

    def limit_ns(self, uav: int) -> int:
        """How long the silence of a UAV must last to mean something."""
        contact = self._contacts.get(uav)
        return contact.limit_ns if contact else self._rules.silence_ns

    def share(self, uavs: Iterable[int]) -> float:
        """Of what these UAVs sent lately, the share that came of the one heard worst."""
        return min((self._contacts[u].share for u in uavs if u in self._contacts), default=1.0)

    def answered_ns(self, uav: int) -> int:
        """When a UAV last answered an election; `UNHEARD_NS` if it has not."""
        return self._answered_ns.get(uav, UNHEARD_NS)

    def current(self, now_ns: int) -> list[StateReport]:
        """Reports heard within the time-out, in ID order; who is silent flies straight on."""
        out = []
        for uav in sorted(self._reports):
            contact = self._contacts[uav]
            if now_ns - contact.last_ns <= self._rules.timeout_ns:
                report = self._reports[uav]
                out.append(report.straight() if contact.silent(now_ns) else report)
        return out

    def silent(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been silent for longer than the limit."""
        return frozenset(uav for uav, c in self._contacts.items() if c.silent(now_ns))

    def present(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been heard within the limit, and whose tracks have not been dropped."""
        return frozenset(
            uav
            for uav, c in self._contacts.items()
            if not c.silent(now_ns) and now_ns - c.last_ns <= self._rules.timeout_ns
        )

    def hears_any(self, uavs: Collection[int] | None, now_ns: int) -> bool:
        """Whether any UAV is present, or any of these."""
        timeout_ns = self._rules.timeout_ns
        for uav, contact in self._contacts.items():
            silence_ns = now_ns - contact.last_ns
            present = silence_ns <= contact.limit_ns and silence_ns <= timeout_ns
            if present and (uavs is None or uav in uavs):
                return True
        return False

    def _insists(self, report: StateReport) -> bool:
        doubted = self._doubted.setdefault(report.id, [])
        if doubted and not plausible(doubted[-1], report, self._rules):
            doubted.clear()
        if not doubted or report.seq > doubted[-1].seq:
            doubted.append(report)
        return len(doubted) >= BELIEVED_AFTER


def plausible(known: StateReport, new: StateReport, rules: TrackRules) -> bool:
    """Whether a UAV can have come from the one report to the other.

    It can have flown no further than its greater speed allows, and have changed its speed no more
    than its acceleration allows; `jump_m` (and a tenth of it in m/s) is allowed for errors.
    """
    elapsed_s = max(0.0, to_s(new.t_ns - known.t_ns))
    faster = max(known.state.speed_mps, new.state.speed_mps)
    before, after = known.state, new.state
    north, east = after.north_m - before.north_m, after.east_m - before.east_m
    down, reach_m = after.down_m - before.down_m, faster * elapsed_s + rules.jump_m
    gained = abs(new.state.speed_mps - known.state.speed_mps)
    return (
        _in_sequence(known.seq, new.seq, elapsed_s / to_s(rules.broadcast_ns))
        and north * north + east * east + down * down <= reach_m * reach_m
        and gained <= rules.max_acceleration_mps2 * elapsed_s + rules.jump_m / 10.0
    )


def _in_sequence(known: int, new: int, broadcasts: float) -> bool:
    """Whether so many were sent in the time of so many broadcasts; restarts number anew."""
    incarnations = new // INCARNATION - known // INCARNATION
    if incarnations:
        return 0 < incarnations < 10
    return new - known <= broadcasts + MISSED


def ages_s(reports: Sequence[StateReport], now_ns: int) -> Array:
    """Age of each report at `now_ns`, shape (m,); 0 where the sender's clock is ahead."""
    return np.array([max(0.0, to_s(now_ns - r.t_ns)) for r in reports])


def states_at(reports: Sequence[StateReport], now_ns: int, models: FleetModels) -> list[State]:
    """Dead-reckoned states: each UAV flown from its report along what it said it flies."""
    intents = [r.intent() for r in reports]
    uavs, states = [r.id for r in reports], [r.state for r in reports]
    return models.states(uavs, states, intents, ages_s(reports, now_ns))
