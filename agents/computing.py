"""The elected UAV's desk: runs the rounds, issues commands, repeats them until acknowledged."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import msgspec

from agents.dialogue import Dialogue
from agents.resolvers import Advice, Aircraft, Resolver, Situation
from fleet.comms.messages import Ack, Cmd, Encounter
from fleet.comms.surveillance import escape_of, told_speed
from fleet.model.election import Mandate
from fleet.model.scenario import Scenario
from fleet.model.tracks import Escape, Report, ages_s, states_at
from fleet.model.units import to_ns, to_s

MARGIN_NS = to_ns(6.0)
"""An escape lapses by itself this long after its predicted end, if nobody ends or extends it."""

AHEAD_NS = to_ns(5.0)
"""An escape that is still needed is extended so long before it lapses: the command may be lost."""

EXTENSION_NS = to_ns(10.0)
"""How much longer an extended escape lasts at least."""

REVIEW_NS = to_ns(5.0)
"""So often it is asked whether an escape will ever end, once it has lasted for T_s."""

NUMBERS_A_LIFE = 10**6

SAME_HEADING_RAD = 0.02
SAME_LEVEL_M = 1.0


@dataclass(frozen=True, slots=True)
class RoundResult:
    """What a round produced: commands to send now, and what to log (if anything is new)."""

    commands: tuple[Cmd, ...] = ()
    encounters: tuple[Encounter, ...] = ()


class ComputingDesk:
    """State of one UAV's computing role; idle unless it holds a valid mandate."""

    def __init__(self, own: int, scenario: Scenario, resolver: Resolver, life: int = 0) -> None:
        """`life` counts restarts: commands of an earlier life are not numbered again."""
        self._own = own
        self._resolver = resolver
        self._predictor = scenario.predictor()
        self._band = scenario.altitudes()
        self._patience_ns = to_ns(scenario.resolution.horizon_s)
        self._lead_ns = to_ns(scenario.commands.lead_s)
        self._valid_ns = to_ns(scenario.commands.valid_s)
        self._number = life * NUMBERS_A_LIFE
        self._dialogues: defaultdict[int, Dialogue] = defaultdict(
            lambda: Dialogue(to_ns(scenario.commands.retransmit_s))
        )
        self._reviewed_ns: dict[int, int] = {}
        self._mandate: Mandate | None = None
        self._unresolved: frozenset[int] = frozenset()

    def appoint(self, mandate: Mandate) -> bool:
        """Take note of an election that names this UAV a member; True if a new round is due."""
        if mandate.computing != self._own:
            self._mandate = None
            self._dialogues.clear()
            return False
        new = self._mandate is None or mandate.term > self._mandate.term
        if new:  # what is still on its way is stale now
            for dialogue in self._dialogues.values():
                dialogue.waits = False
        self._mandate = mandate
        return new

    def on_ack(self, ack: Ack) -> None:
        """An answer of a UAV that was commanded."""
        self._dialogues[ack.id].on_ack(ack)

    def holds_mandate(self, now_ns: int) -> bool:
        """Whether this UAV computes for a group now."""
        return self._mandate is not None and self._mandate.in_force(now_ns)

    def run_round(
        self,
        own: Report,
        heard: Iterable[Report],
        now_ns: int,
        unreachable: frozenset[int] = frozenset(),
    ) -> RoundResult:
        """One round of the resolver on what was heard; `own` is this UAV's own report.

        Those in `unreachable` cannot be commanded.
        """
        if self._mandate is None or not self.holds_mandate(now_ns):
            return RoundResult()
        start_ns = now_ns + self._lead_ns
        reports = sorted([own, *heard], key=lambda r: r.id)
        for report in reports:
            if report.command.issuer == self._own:
                self._dialogues[report.id].on_flown(report.command)
        believed = [msgspec.structs.replace(r, escape=self._believed_escape(r)) for r in reports]
        states = states_at(believed, start_ns, self._predictor)
        passed_s = ages_s(believed, start_ns).tolist()
        aircraft = tuple(
            Aircraft(
                r.id,
                s,
                r.guidance.after(passed),
                r.escape,
                r.plan,
                to_s(max(0, now_ns - r.t_ns)),
                self._review(r, now_ns),
            )
            for r, s, passed in zip(believed, states, passed_s, strict=True)
        )
        crafts = {a.id: a for a in aircraft}
        advice = self._resolver.resolve(
            Situation(self._own, self._mandate.members, aircraft, unreachable)
        )
        commands, noted = [], []
        for item in advice:
            craft = crafts.get(item.target)
            cmd = self._command(item, craft, self._mandate, now_ns)
            if cmd is not None:
                commands.append(cmd)
            if cmd is not None or self._newly_unresolved(item):
                noted.append(_encounter(item))
        self._unresolved = frozenset(a.target for a in advice if a.unresolved)
        return RoundResult(tuple(commands), tuple(noted))

    def repetitions(self, now_ns: int) -> list[Cmd]:
        """Commands to send again now; nothing is repeated without a mandate."""
        if not self.holds_mandate(now_ns):
            return []
        due = [self._dialogues[target].repetition(now_ns) for target in sorted(self._dialogues)]
        return [cmd for cmd in due if cmd is not None]

    def _believed_escape(self, report: Report) -> Escape | None:
        """What a UAV flies when the next commands start: what it was told, until it reports."""
        cmd = self._dialogues[report.id].last
        if cmd is None or report.t_ns > cmd.start_ns:
            return report.escape
        return _escape(cmd)

    def _review(self, report: Report, now_ns: int) -> bool:
        """Whether an escape is due to be looked at again: now and then, and before it lapses."""
        last = self._dialogues[report.id].last
        if report.escape is None:
            self._reviewed_ns.pop(report.id, None)
            return False
        ripe_ns = last.start_ns + self._patience_ns if last else 0
        due_ns = max(self._reviewed_ns.get(report.id, 0) + REVIEW_NS, ripe_ns)
        due = now_ns >= due_ns or not _lasting(last, now_ns)
        if due:
            self._reviewed_ns[report.id] = now_ns
        return due

    def _command(
        self, advice: Advice, craft: Aircraft | None, mandate: Mandate, now_ns: int
    ) -> Cmd | None:
        """The command that carries an advice, or None if the one in force or on its way does."""
        dialogue = self._dialogues[advice.target]
        last = dialogue.last
        escape = craft.escape if craft else None
        down_m = craft.state.down_m if craft else math.nan
        start_ns = now_ns + self._lead_ns
        end_ns = start_ns + to_ns(advice.escape_s) + MARGIN_NS
        if advice.manoeuvre == "keep":
            if escape is None or _lasting(last, now_ns):
                return None
            told, end_ns = escape, max(end_ns, start_ns + EXTENSION_NS)
        else:
            told = escape_of(
                advice.manoeuvre,
                advice.heading_rad,
                advice.climb_mps,
                self._band.level_m(advice.climb_mps, advice.level_down_m, down_m),
                advice.speed_mps,
            )
            flown = escape is not None and _lasting(last, now_ns)
            known = dialogue.waits or flown
            if last and known and _alike(told, last):
                return None  # on its way, or flown already
            if advice.manoeuvre == "resume":
                end_ns = start_ns
        self._number += 1
        cmd = Cmd(
            id=self._own,
            seq=0,
            t_ns=now_ns,
            target=advice.target,
            term=mandate.term,
            number=self._number,
            issued_ns=now_ns,
            manoeuvre=told.manoeuvre,
            heading_rad=told.heading_rad,
            turn_rad=advice.turn_rad,
            climb_mps=told.climb_mps,
            level_down_m=0.0 if math.isnan(told.level_down_m) else told.level_down_m,
            start_ns=start_ns,
            escape_end_ns=end_ns,
            expiry_ns=now_ns + self._valid_ns,
            speed_mps=told_speed(told.speed_mps),
        )
        dialogue.send(cmd)
        return cmd

    def _newly_unresolved(self, advice: Advice) -> bool:
        return advice.unresolved and advice.target not in self._unresolved


def _escape(cmd: Cmd) -> Escape | None:
    if cmd.manoeuvre == "resume":
        return None
    told = (cmd.heading_rad, cmd.climb_mps, cmd.level_down_m, cmd.speed_mps)
    return escape_of(cmd.manoeuvre, *told)


def _lasting(last: Cmd | None, now_ns: int) -> bool:
    """Whether what was commanded last does not lapse soon."""
    return last is not None and last.escape_end_ns - now_ns > AHEAD_NS


def _alike(told: Escape, cmd: Cmd) -> bool:
    if "speed" in (told.manoeuvre, cmd.manoeuvre):
        return told.manoeuvre == cmd.manoeuvre and told.speed_mps == cmd.speed_mps
    apart = math.remainder(told.heading_rad - cmd.heading_rad, math.tau)
    return (
        told.manoeuvre == cmd.manoeuvre
        and abs(apart) < SAME_HEADING_RAD
        and told.climb_mps == cmd.climb_mps
        and not abs(told.level_down_m - cmd.level_down_m) >= SAME_LEVEL_M
    )


def _encounter(advice: Advice) -> Encounter:
    return Encounter(
        advice.target,
        advice.sector,
        advice.collision_angle_rad,
        advice.time_to_violation_s,
        advice.stage,
        advice.manoeuvre,
        advice.turn_rad,
        advice.climb_mps,
        0.0 if math.isnan(advice.level_down_m) else advice.level_down_m,
        advice.least_separation,
        advice.safe_options,
        advice.escape_s,
        advice.intercept_s,
        told_speed(advice.speed_mps),
    )
