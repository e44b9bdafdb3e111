"""What the computing UAV does for its group: rounds, commands, repetitions until answered."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass

import msgspec

from fleet.agents.advisory import Advisory, Aircraft, Resolver, SelectiveResolver, Situation
from fleet.agents.command_exchange import CommandExchange
from fleet.agents.decision_log import logged, turn_of
from fleet.agents.resolver_call import advisories_of
from fleet.config.scenario import Scenario
from fleet.model.conflict.tracks import ActiveManoeuvre, StateReport, ages_s, states_at
from fleet.model.election import Mandate
from fleet.model.units import to_ns, to_s
from fleet.model.words import Manoeuvre
from fleet.protocol.advisories import LoggedAdvisory
from fleet.protocol.messages import Ack, Command
from fleet.protocol.surveillance import manoeuvre_of, told_speed

MARGIN_NS = to_ns(6.0)
"""A manoeuvre lapses by itself this long after its predicted end, if nobody ends or extends it."""

EXTEND_BEFORE_NS = to_ns(5.0)
"""One that is still needed is extended so long before it lapses: the command may be lost."""

EXTENSION_NS = to_ns(10.0)
"""How much longer an extended manoeuvre lasts at least."""

REVIEW_NS = to_ns(5.0)
"""So often it is asked whether a manoeuvre will ever end, once it has lasted for T_s."""

NUMBERS_PER_INCARNATION = 10**6

EQUAL_HEADING_RAD = 0.02
SAME_LEVEL_M = 1.0


@dataclass(frozen=True, slots=True)
class RoundResult:
    """What a round produced: commands to send now, and what to log (if anything is new)."""

    commands: tuple[Command, ...] = ()
    encounters: tuple[LoggedAdvisory, ...] = ()


class GroupResolver:
    """State of one UAV's computing role; idle unless it holds a valid mandate."""

    def __init__(
        self, own: int, scenario: Scenario, resolver: Resolver, incarnation: int = 0
    ) -> None:
        """`incarnation` counts restarts: numbers of commands are not used again."""
        self._own = own
        self._resolver = resolver
        self._selective = resolver if isinstance(resolver, SelectiveResolver) else None
        self._models = scenario.models()
        self._band = scenario.altitudes()
        self._patience_ns = to_ns(scenario.resolution.horizon_s)
        self._lead_ns = to_ns(scenario.commands.lead_s)
        self._valid_ns = to_ns(scenario.commands.valid_s)
        self._answer_ns = 2 * self._valid_ns  # as late as it may arrive, an answer may, too
        self._number = incarnation * NUMBERS_PER_INCARNATION
        self._exchanges: defaultdict[int, CommandExchange] = defaultdict(
            lambda: CommandExchange(to_ns(scenario.commands.retransmit_s))
        )
        self._reviewed_ns: dict[int, int] = {}
        self._mandate: Mandate | None = None
        self._unresolved: frozenset[int] = frozenset()

    def appoint(self, mandate: Mandate) -> bool:
        """Take note of an election that names this UAV a member; True if a new round is due."""
        if mandate.computing != self._own:
            self._mandate = None
            self._exchanges.clear()
            return False
        new = self._mandate is None or mandate.term > self._mandate.term
        if new:
            for exchange in self._exchanges.values():
                exchange.on_new_term()
        self._mandate = mandate
        return new

    def on_ack(self, ack: Ack) -> None:
        """An answer of a UAV that was commanded."""
        self._exchanges[ack.id].on_ack(ack)

    def holds_mandate(self, now_ns: int) -> bool:
        """Whether this UAV computes for a group now."""
        return self._mandate is not None and self._mandate.in_force(now_ns)

    def unanswering(self, share: Callable[[int], float], now_ns: int) -> frozenset[int]:
        """Others whose commands have gone unanswered for so long that they must have been missed.

        `share` says how much of what a UAV sends comes through.
        """
        return frozenset(
            uav
            for uav, exchange in self._exchanges.items()
            if uav != self._own and exchange.overdue(self._answer_ns, share(uav), now_ns)
        )

    def unheeded(
        self, present: Collection[int], share: Callable[[int], float], now_ns: int
    ) -> bool:
        """Whether that is so of everybody commanded in this mandate who is there at all.

        Asked while it holds.
        """
        commanded = {u for u, e in self._exchanges.items() if e.begun and u in present}
        return bool(commanded) and commanded <= self.unanswering(share, now_ns)

    def run_round(
        self,
        own: StateReport,
        heard: Iterable[StateReport],
        now_ns: int,
        unreachable: frozenset[int] = frozenset(),
    ) -> RoundResult:
        """One round of the resolver on what was heard; `own` is this UAV's own report.

        Those in `unreachable` cannot be commanded.
        """
        if self._mandate is None or not self.holds_mandate(now_ns):
            return RoundResult()
        reports = sorted([own, *heard], key=lambda r: r.id)
        aircraft = self._aircraft(reports, self._mandate.members, now_ns)
        situation = Situation(self._own, self._mandate.members, aircraft, unreachable)
        advisories = advisories_of(self._resolver, situation)
        crafts = {a.id: a for a in aircraft}
        commands, noted = [], []
        for advisory in advisories:
            craft = crafts.get(advisory.target)
            command = self._command(advisory, craft, self._mandate, now_ns)
            if command is not None:
                commands.append(command)
            if command is not None or self._newly_unresolved(advisory):
                noted.append(logged(advisory, craft))
        self._unresolved = frozenset(a.target for a in advisories if a.unresolved)
        return RoundResult(tuple(commands), tuple(noted))

    def repetitions(self, now_ns: int) -> list[Command]:
        """Commands to send again now; nothing is repeated without a mandate."""
        if not self.holds_mandate(now_ns):
            return []
        due = [self._exchanges[target].repetition(now_ns) for target in sorted(self._exchanges)]
        return [command for command in due if command is not None]

    def _aircraft(
        self, reports: Sequence[StateReport], members: Sequence[int], now_ns: int
    ) -> tuple[Aircraft, ...]:
        """All that may matter, as they are believed to be when the next commands start."""
        for report in reports:
            if report.command_id.issuer == self._own:
                self._exchanges[report.id].on_flown(report.command_id)
        believed = [self._believed(r) for r in reports]
        reviewed = {r.id for r in believed if self._review(r, now_ns)}
        start_ns = now_ns + self._lead_ns
        if self._selective is not None:
            group = {self._own, *members}
            believed = self._selective.concerned(believed, group, now_ns, start_ns)
        states = states_at(believed, start_ns, self._models)
        passed_s = ages_s(believed, start_ns).tolist()
        return tuple(
            Aircraft(
                r.id,
                s,
                r.guidance.after(passed),
                r.manoeuvre,
                r.plan,
                to_s(max(0, now_ns - r.t_ns)),
                r.id in reviewed,
            )
            for r, s, passed in zip(believed, states, passed_s, strict=True)
        )

    def _believed(self, report: StateReport) -> StateReport:
        """What a UAV flies when the next commands start: its last command, until it reports."""
        command = self._last(report.id)
        if command is None or report.t_ns > command.start_ns:
            return report
        return msgspec.structs.replace(report, manoeuvre=_manoeuvre_of(command))

    def _last(self, uav: int) -> Command | None:
        """The last command that a UAV has, or that is on its way to it."""
        exchange = self._exchanges.get(uav)
        return exchange.last if exchange else None

    def _review(self, report: StateReport, now_ns: int) -> bool:
        """Whether a manoeuvre is due to be looked at again: now and then, and before it lapses."""
        if report.manoeuvre is None:
            self._reviewed_ns.pop(report.id, None)
            return False
        last = self._last(report.id)
        ripe_ns = last.start_ns + self._patience_ns if last else 0
        due_ns = max(self._reviewed_ns.get(report.id, 0) + REVIEW_NS, ripe_ns)
        due = now_ns >= due_ns or not _lasting(last, now_ns)
        if due:
            self._reviewed_ns[report.id] = now_ns
        return due

    def _command(
        self, advisory: Advisory, craft: Aircraft | None, mandate: Mandate, now_ns: int
    ) -> Command | None:
        """The command that carries an advisory, or None if the one in force or on its way does."""
        extends = advisory.manoeuvre == Manoeuvre.KEEP
        found = (self._extended if extends else self._begun)(advisory, craft, now_ns)
        if found is None:
            return None
        manoeuvre, end_ns = found
        self._number += 1
        command = Command(
            id=self._own,
            seq=0,
            t_ns=now_ns,
            target=advisory.target,
            term=mandate.term,
            number=self._number,
            issued_ns=now_ns,
            manoeuvre=manoeuvre.manoeuvre,
            heading_rad=manoeuvre.heading_rad,
            turn_rad=turn_of(advisory, craft),
            climb_mps=manoeuvre.climb_mps,
            level_down_m=0.0 if math.isnan(manoeuvre.level_down_m) else manoeuvre.level_down_m,
            start_ns=now_ns + self._lead_ns,
            manoeuvre_end_ns=end_ns,
            expiry_ns=now_ns + self._valid_ns,
            speed_mps=told_speed(manoeuvre.speed_mps),
        )
        self._exchanges[advisory.target].send(command)
        return command

    def _extended(
        self, advisory: Advisory, craft: Aircraft | None, now_ns: int
    ) -> tuple[ActiveManoeuvre, int] | None:
        """What is flown and its later end in ns, if it is to be kept and would lapse soon."""
        manoeuvre = craft.manoeuvre if craft else None
        if manoeuvre is None or _lasting(self._exchanges[advisory.target].last, now_ns):
            return None
        start_ns = now_ns + self._lead_ns
        return manoeuvre, max(_end_ns(advisory, start_ns), start_ns + EXTENSION_NS)

    def _begun(
        self, advisory: Advisory, craft: Aircraft | None, now_ns: int
    ) -> tuple[ActiveManoeuvre, int] | None:
        """What is to be flown from now on and its end in ns; None if it is, or will be."""
        exchange = self._exchanges[advisory.target]
        down_m = craft.state.down_m if craft else math.nan
        manoeuvre = manoeuvre_of(
            advisory.manoeuvre,
            advisory.heading_rad,
            advisory.climb_mps,
            self._band.level_m(advisory.climb_mps, advisory.level_down_m, down_m),
            advisory.speed_mps,
        )
        flies = craft is not None and craft.manoeuvre is not None
        known = exchange.waits or (flies and _lasting(exchange.last, now_ns))
        if exchange.last and known and _alike(manoeuvre, exchange.last):
            return None  # on its way, or flown already
        start_ns = now_ns + self._lead_ns
        resumes = advisory.manoeuvre == Manoeuvre.RESUME
        return manoeuvre, start_ns if resumes else _end_ns(advisory, start_ns)

    def _newly_unresolved(self, advisory: Advisory) -> bool:
        return advisory.unresolved and advisory.target not in self._unresolved


def _manoeuvre_of(command: Command) -> ActiveManoeuvre | None:
    if command.manoeuvre == Manoeuvre.RESUME:
        return None
    course = (command.heading_rad, command.climb_mps, command.level_down_m, command.speed_mps)
    return manoeuvre_of(command.manoeuvre, *course)


def _end_ns(advisory: Advisory, start_ns: int) -> int:
    """When a manoeuvre lapses by itself."""
    return start_ns + to_ns(advisory.manoeuvre_s) + MARGIN_NS


def _lasting(last: Command | None, now_ns: int) -> bool:
    """Whether what was commanded last does not lapse soon."""
    return last is not None and last.manoeuvre_end_ns - now_ns > EXTEND_BEFORE_NS


def _alike(new: ActiveManoeuvre, command: Command) -> bool:
    if Manoeuvre.SPEED in (new.manoeuvre, command.manoeuvre):
        return new.manoeuvre == command.manoeuvre and new.speed_mps == command.speed_mps
    apart = math.remainder(new.heading_rad - command.heading_rad, math.tau)
    return (
        new.manoeuvre == command.manoeuvre
        and abs(apart) < EQUAL_HEADING_RAD
        and new.climb_mps == command.climb_mps
        and not abs(new.level_down_m - command.level_down_m) >= SAME_LEVEL_M
    )
