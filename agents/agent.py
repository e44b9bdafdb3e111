"""The UAV as a pure node: what it hears and the time go in, what it sends comes out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from fleet.agents.advisory import Resolver
from fleet.agents.group_resolver import GroupResolver
from fleet.agents.obedience import Applied, Recipient, refusal
from fleet.agents.vehicle import Vehicle, scheduled_manoeuvre
from fleet.agents.voting import Voter
from fleet.config.scenario import Scenario, Uav
from fleet.faults.rules import Rule
from fleet.faults.sensors import Sensors
from fleet.model.conflict.tracks import StateReport, TrafficPicture
from fleet.model.equipment import broadcasts, computes, hears
from fleet.model.types import Integers
from fleet.model.units import to_ns
from fleet.model.words import Mode
from fleet.node.base import BaseNode
from fleet.node.node import InboxMessage, RestartState
from fleet.protocol.messages import (
    Ack,
    Command,
    Decision,
    Election,
    Heartbeat,
    Message,
    StateBroadcast,
    Truth,
)
from fleet.protocol.surveillance import Flown, broadcast_of, truth_of


class Agent(BaseNode):
    """One UAV: flies, broadcasts, keeps tracks, obeys valid commands, computes when elected."""

    def __init__(
        self,
        uav: Uav,
        scenario: Scenario,
        resolver: Resolver,
        restart: RestartState | None = None,
        tracks: TrafficPicture | None = None,
    ) -> None:
        """`restart` is what a process that is started again finds; None at the first start."""
        super().__init__(uav.id, scenario, restart, tracks)
        if not hears(uav.equipment):
            self.hears = ()
        self._equipment = uav.equipment
        self._speeds_mps = scenario.speeds_mps(uav.id, uav.speed_mps)
        if restart:
            self._vehicle = Vehicle(uav, scenario, restart.truth, restart.t_ns)
        else:
            self._vehicle = Vehicle(uav, scenario)
        self._group_resolver = GroupResolver(uav.id, scenario, resolver, self._incarnation)
        self._voter = Voter(uav, scenario, self._memory)
        self._sensors = Sensors(scenario.fault, scenario.seed, uav.id)
        self._applied: Applied = (self._memory.applied_term, self._memory.applied_number)
        self._tick_ns = scenario.tick_ns
        self._broadcast_ns = to_ns(scenario.surveillance.broadcast_s)
        self._silence_ns = to_ns(scenario.coordination.silence_limit_s)
        self._since_ns: int | None = None
        self._unheeded_ns: int | None = None
        self._retry_ns = self._silence_ns + scenario.election_timing().answer_ns

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """Where its radio is."""
        return self._vehicle.state.position_ned_m

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        super().replan(plan)
        self._sensors.replan(plan)

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Fly to `now_ns`, acting on each message at its delivery time; return what to send."""
        vehicle, out = self._vehicle, list[Message]()
        self.round_ns = 0
        self._take_one_by_one(inbox, now_ns)
        if now_ns - vehicle.now_ns > self._tick_ns:
            vehicle.hold_to(now_ns)  # the process has been stopped meanwhile
        appointed = False
        for item in inbox:
            at_ns = max(item.delivered_ns, vehicle.now_ns)
            match item.message:
                case Heartbeat() as heartbeat:
                    self._voter.on_heartbeat(heartbeat, self._local(at_ns))
                case Election() as election:
                    appointed |= self._on_election(election, self._local(at_ns))
                case Command() as command:
                    out.append(self._on_command(command, at_ns))
                case Ack() as ack:
                    self._group_resolver.on_ack(ack)
        vehicle.fly_to(now_ns)
        out += self._decide(now_ns, appointed=appointed)
        out.append(self._truth(now_ns))
        out += self._remember(
            now_ns, self._voter.highest_term, self._voter.minimum_term, self._applied
        )
        self._last_ns = now_ns
        return out

    def hearing_ns(self, delivered_ns: int, now_ns: int) -> int:
        """What its clock shows when something is delivered: not before it can take it."""
        stopped = now_ns - self._vehicle.now_ns > self._tick_ns
        return self._local(now_ns if stopped else max(delivered_ns, self._vehicle.now_ns))

    def hearing_times_ns(self, delivered_ns: Integers, now_ns: int) -> Integers:
        """The same of several, shape (n,)."""
        if not self._clock.clean:
            return super().hearing_times_ns(delivered_ns, now_ns)
        stopped = now_ns - self._vehicle.now_ns > self._tick_ns
        return np.maximum(delivered_ns, now_ns if stopped else self._vehicle.now_ns)

    def take_broadcast(self, message: StateBroadcast, sent: StateBroadcast, local_ns: int) -> None:
        """Take in a broadcast."""
        self._hear(message, sent, local_ns, answering=message.mandate_valid)

    def _on_election(self, election: Election, local_ns: int) -> bool:
        if not self._voter.on_election(election, local_ns) or self._voter.mandate is None:
            return False
        return computes(self._equipment) and self._group_resolver.appoint(self._voter.mandate)

    def _on_command(self, command: Command, at_ns: int) -> Ack:
        """Obey or refuse; either way the answer says so."""
        self._vehicle.fly_to(at_ns)
        voter, local_ns = self._voter, self._local(at_ns)
        recipient = Recipient(
            self.id, voter.mandate, self._applied, voter.minimum_term, self._speeds_mps
        )
        reason = refusal(command, recipient, local_ns)
        actuate_ns = 0
        if not reason:
            scheduled = scheduled_manoeuvre(command, at_ns, local_ns - at_ns)
            self._applied = (command.term, command.number)
            self._vehicle.obey(scheduled)
            actuate_ns = scheduled.start_ns
        return Ack(
            id=self.id,
            seq=self._next(Ack),
            t_ns=at_ns,
            target=command.id,
            term=command.term,
            number=command.number,
            issued_ns=command.issued_ns,
            accepted=not reason,
            reason=reason,
            actuate_ns=actuate_ns,
        )

    def _decide(self, now_ns: int, *, appointed: bool) -> list[Message]:
        """Local election, rounds, repetitions and the broadcast, by what it knows of itself."""
        local_ns = self._local(now_ns)
        state = self._sensors.sense(self._vehicle.state, now_ns)
        out: list[Message] = self._stamped(self._group_resolver.repetitions(local_ns), now_ns)
        if state is None:
            return out
        telling = broadcasts(self._equipment) and self._due(now_ns, self._broadcast_ns)
        updating = self._due(now_ns, self._update_ns)
        standing = updating and self._voter.stands(local_ns)
        rounds = self._group_resolver.holds_mandate(local_ns) and (updating or appointed)
        if not (telling or standing or rounds):
            return out
        flying = self._vehicle.report(state, local_ns)
        if standing:
            appointed |= self._elect(self._own(flying, local_ns), now_ns, out)
        if (updating or appointed) and self._group_resolver.holds_mandate(local_ns):
            begun_ns = self.stopwatch()
            out += self._round(flying, now_ns)
            self.round_ns = self.stopwatch() - begun_ns
        if telling:
            own = self._own(flying, local_ns, seq=self._next(StateBroadcast))
            out.append(broadcast_of(own, now_ns, self._voter.highest_term))
        return out

    def _own(self, flying: StateReport, local_ns: int, seq: int = 0) -> StateReport:
        """Its report of itself: what it flies, and how it stands to the others."""
        voter = self._voter
        return msgspec.structs.replace(
            flying,
            seq=seq,
            mandate_term=voter.minimum_term,
            mandate_valid=voter.valid(local_ns),
            hears=self._hears_others(local_ns) and self._heeded(local_ns),
            equipment=self._equipment,
        )

    def _hears_others(self, local_ns: int) -> bool:
        """Whether it hears any UAV of its group, or outside a group any at all.

        It can say no only after it has listened for as long as silence takes to mean something.
        """
        if self._since_ns is None:
            self._since_ns = local_ns
        if not hears(self._equipment):
            return False
        mandate = self._voter.mandate
        group = mandate.members if mandate and self._voter.valid(local_ns) else None
        heard = self.tracks.hears_any(group, local_ns)
        return heard or local_ns - self._since_ns <= self._silence_ns

    def _heeded(self, local_ns: int) -> bool:
        """Whether anybody answers its commands; if not, it is no use as long as the group lasts.

        Its commands may be lost where nothing else is. It is tried again when it has been in no
        group for as long as somebody else takes to be elected.
        """
        tried = self._unheeded_ns is not None and local_ns - self._unheeded_ns > self._retry_ns
        if tried:
            self._unheeded_ns = None
        in_vain = False
        if self._group_resolver.holds_mandate(local_ns):
            present = self.tracks.present(local_ns)
            in_vain = self._group_resolver.unheeded(present, self._share, local_ns)
        if in_vain or (self._unheeded_ns is not None and self._voter.valid(local_ns)):
            self._unheeded_ns = local_ns
        return self._unheeded_ns is None

    def _share(self, uav: int) -> float:
        return self.tracks.share((uav,))

    def _elect(self, own: StateReport, now_ns: int, out: list[Message]) -> bool:
        """Announce this UAV's election of itself, if one is due; True if that is a new mandate."""
        local_ns = self._local(now_ns)
        mandate = self._voter.elect(own, self.tracks, local_ns)
        if mandate is None:
            return False
        election = self._election(mandate, now_ns)
        out.append(election)
        return self._on_election(election, local_ns)

    def _round(self, own: StateReport, now_ns: int) -> list[Message]:
        """One round of the resolver for the group."""
        local_ns = self._local(now_ns)
        heard, silent = self.tracks.current(local_ns), self.tracks.silent(local_ns)
        deaf = {r.id for r in heard if not r.hears or self._unanswering(r.id, local_ns)}
        deaf |= self._group_resolver.unanswering(self._share, local_ns)
        result = self._group_resolver.run_round(own, heard, local_ns, silent | deaf)
        out = self._stamped(result.commands, now_ns)
        if result.encounters:
            term = self._voter.mandate.term if self._voter.mandate else 0
            out.append(Decision(self.id, self._next(Decision), now_ns, term, result.encounters))
        return out

    def _unanswering(self, uav: int, local_ns: int) -> bool:
        if not self._voter.answers.asked(uav, local_ns):
            return False
        answered_ns, limit_ns = self.tracks.answered_ns(uav), self.tracks.limit_ns(uav)
        return self._voter.answers.missing(uav, answered_ns, limit_ns, local_ns)

    def _stamped(self, commands: Iterable[Command], now_ns: int) -> list[Message]:
        return [msgspec.structs.replace(c, seq=self._next(Command), t_ns=now_ns) for c in commands]

    def _truth(self, now_ns: int) -> Truth:
        vehicle = self._vehicle
        manoeuvre = vehicle.manoeuvre
        on_plan = Mode.ARRIVED if vehicle.plan.arrived else Mode.PLAN
        mode = manoeuvre.manoeuvre if manoeuvre else on_plan
        flown = Flown(
            mode, vehicle.plan.active, vehicle.guidance(), vehicle.flown(), vehicle.command_id
        )
        return truth_of(self.id, now_ns // self._tick_ns, now_ns, vehicle.state, flown)
