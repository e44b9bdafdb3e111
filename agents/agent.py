"""The UAV as a pure node: what it hears and the time go in, what it sends comes out.

Simulated time moves the vehicle and marks messages; whatever the UAV decides by time it decides by
its own clock, which a fault may have put wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import msgspec

from fleet.agents.advisory import Resolver
from fleet.agents.group_resolver import GroupResolver
from fleet.agents.obedience import Applied, refusal
from fleet.agents.vehicle import Vehicle, scheduled_manoeuvre
from fleet.agents.voting import Voter
from fleet.config.scenario import Scenario, Uav
from fleet.faults.clock import LocalClock
from fleet.faults.navigation import Sensors
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.conflict.tracks import StateReport, Tracks
from fleet.model.equipment import broadcasts, computes, hears
from fleet.model.units import to_ns
from fleet.node.runner import InboxMessage, RestartState
from fleet.protocol.messages import (
    Ack,
    Command,
    Decision,
    Election,
    Heartbeat,
    Message,
    PersistentState,
    StateBroadcast,
    Truth,
)
from fleet.protocol.surveillance import broadcast_of, report_of, truth_of
from fleet.protocol.topics import topics_for


class Agent:
    """One UAV: flies, broadcasts, keeps tracks, obeys valid commands, computes when elected."""

    def __init__(
        self, uav: Uav, scenario: Scenario, resolver: Resolver, restart: RestartState | None = None
    ) -> None:
        """`revival` is what a process that is started again finds; None at the first start."""
        self.id = uav.id
        self.hears = topics_for(uav.id) if hears(uav.equipment) else ()
        self._equipment = uav.equipment
        self._speeds_mps = scenario.speeds_mps(uav.speed_mps)
        memory = restart.memory if restart else None
        self._incarnation = restart.incarnation if restart else 0
        if restart:
            self._vehicle = Vehicle(uav, scenario, restart.truth, restart.t_ns)
        else:
            self._vehicle = Vehicle(uav, scenario)
        self._group_resolver = GroupResolver(uav.id, scenario, resolver, self._incarnation)
        self._voter = Voter(uav, scenario, memory)
        self._tracks = Tracks(scenario.track_rules())
        self._clock = LocalClock(scenario.fault, uav.id)
        self._sensors = Sensors(scenario.fault, scenario.seed, uav.id)
        self._applied: Applied = (memory.applied_term, memory.applied_number) if memory else (0, 0)
        self._remembered = memory
        self._seq: Counter[str] = Counter()
        self._last_ns = self._vehicle.now_ns if restart else -1
        self._tick_ns = scenario.tick_ns
        self._broadcast_ns = to_ns(scenario.surveillance.broadcast_s)
        self._update_ns = to_ns(scenario.coordination.update_s)
        self._silence_ns = to_ns(scenario.coordination.silence_limit_s)
        self._since_ns: int | None = None
        self.implausible: list[tuple[int, int]] = []

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """Where its radio is."""
        return self._vehicle.state.position_ned_m

    def replan(self, plan: Sequence[Rule]) -> None:
        """Suffer from another fault plan from now on."""
        self._clock.replan(plan)
        self._sensors.replan(plan)

    def step(self, now_ns: int, inbox: Sequence[InboxMessage]) -> list[Message]:
        """Fly to `now_ns`, acting on each message at its delivery time; return what to send."""
        vehicle, out = self._vehicle, list[Message]()
        self.implausible.clear()
        if now_ns - vehicle.now_ns > self._tick_ns:
            vehicle.hold_to(now_ns)  # the process has been stopped meanwhile
        appointed = False
        for item in inbox:
            at_ns = max(item.delivered_ns, vehicle.now_ns)
            match item.message:
                case StateBroadcast() as heard:
                    self._on_broadcast(heard, item, self._local(at_ns))
                case Heartbeat() as heartbeat:
                    self._voter.on_heartbeat(heartbeat, self._local(at_ns))
                case Election() as election:
                    appointed |= self._on_election(election, self._local(at_ns))
                case Command() as command:
                    out.append(self._on_command(command, at_ns))
                case Ack() as ack:
                    self._group_resolver.on_ack(ack)
        vehicle.fly_to(now_ns)
        out += self._decide(now_ns, appointed)
        out.append(self._truth(now_ns))
        out += self._remember(now_ns)
        self._last_ns = now_ns
        return out

    def _local(self, now_ns: int) -> int:
        """What this UAV's clock shows."""
        return max(0, now_ns + self._clock.shift_ns(now_ns))

    def _due(self, now_ns: int, period_ns: int) -> bool:
        """Whether a multiple of the period has come since the last step."""
        return now_ns // period_ns > self._last_ns // period_ns

    def _on_broadcast(self, heard: StateBroadcast, item: InboxMessage, local_ns: int) -> None:
        report = report_of(heard)
        if not self._tracks.hear(report, local_ns):
            self.implausible.append((item.original.id, item.original.seq))
        elif report.mandate_valid and self._tracks.newest(report):
            self._voter.answers.answer(report.id, local_ns)

    def _on_election(self, election: Election, local_ns: int) -> bool:
        if not self._voter.on_election(election, local_ns) or self._voter.mandate is None:
            return False
        return computes(self._equipment) and self._group_resolver.appoint(self._voter.mandate)

    def _on_command(self, command: Command, at_ns: int) -> Ack:
        """Obey or refuse; either way the answer says so."""
        self._vehicle.fly_to(at_ns)
        voter, local_ns = self._voter, self._local(at_ns)
        reason = refusal(
            command,
            self.id,
            voter.mandate,
            self._applied,
            local_ns,
            voter.minimum_term,
            self._speeds_mps,
        )
        actuate_ns = 0
        if not reason:
            scheduled = scheduled_manoeuvre(command, at_ns, local_ns - at_ns)
            self._applied = (command.term, command.number)
            self._vehicle.obey(scheduled)
            actuate_ns = scheduled.start_ns
        return Ack(
            id=self.id,
            seq=self._next("ack"),
            t_ns=at_ns,
            target=command.id,
            term=command.term,
            number=command.number,
            issued_ns=command.issued_ns,
            accepted=not reason,
            reason=reason,
            actuate_ns=actuate_ns,
        )

    def _decide(self, now_ns: int, appointed: bool) -> list[Message]:
        """Local election, rounds, repetitions and the broadcast, by what it knows of itself."""
        local_ns = self._local(now_ns)
        state = self._sensors.sense(self._vehicle.state, now_ns)
        out: list[Message] = self._stamped(self._group_resolver.repetitions(local_ns), now_ns)
        if state is None:
            return out
        telling = broadcasts(self._equipment) and self._due(now_ns, self._broadcast_ns)
        updating = self._due(now_ns, self._update_ns)
        standing = updating and self._voter.stands(local_ns)
        if not (telling or standing or self._group_resolver.holds_mandate(local_ns)):
            return out
        flying = self._vehicle.report(state, local_ns)
        if standing:
            appointed |= self._elect(self._own(flying, local_ns), now_ns, out)
        if (updating or appointed) and self._group_resolver.holds_mandate(local_ns):
            out += self._round(flying, now_ns)
        if telling:
            own = msgspec.structs.replace(self._own(flying, local_ns), seq=self._next("adsb"))
            out.append(broadcast_of(own, now_ns, self._voter.highest_term))
        return out

    def _own(self, flying: StateReport, local_ns: int) -> StateReport:
        """Its report of itself: what it flies, and how it stands to the others."""
        voter = self._voter
        return msgspec.structs.replace(
            flying,
            mandate_term=voter.minimum_term,
            mandate_valid=voter.valid(local_ns),
            hears=self._hears_others(local_ns),
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
        present = self._tracks.present(local_ns)
        mandate = self._voter.mandate
        if mandate and self._voter.valid(local_ns):
            present &= {*mandate.members}
        return bool(present) or local_ns - self._since_ns <= self._silence_ns

    def _elect(self, own: StateReport, now_ns: int, out: list[Message]) -> bool:
        """Announce this UAV's election of itself, if one is due; True if that is a new mandate."""
        local_ns = self._local(now_ns)
        mandate = self._voter.elect(own, self._tracks, local_ns)
        if mandate is None:
            return False
        election = Election(
            self.id,
            self._next("election"),
            now_ns,
            mandate.term,
            mandate.members[0],
            mandate.members,
            mandate.computing,
            mandate.valid_until_ns,
        )
        out.append(election)
        return self._on_election(election, local_ns)

    def _round(self, own: StateReport, now_ns: int) -> list[Message]:
        """One round of the resolver for the group."""
        local_ns = self._local(now_ns)
        heard, silent = self._tracks.current(local_ns), self._tracks.silent(local_ns)
        deaf = {r.id for r in heard if not r.hears or self._unanswering(r.id, local_ns)}
        result = self._group_resolver.run_round(own, heard, local_ns, silent | deaf)
        out = self._stamped(result.commands, now_ns)
        if result.encounters:
            term = self._voter.mandate.term if self._voter.mandate else 0
            out.append(Decision(self.id, self._next("decision"), now_ns, term, result.encounters))
        return out

    def _unanswering(self, uav: int, local_ns: int) -> bool:
        limit_ns = self._tracks.limit_ns(uav)
        return self._voter.answers.missing(uav, limit_ns, local_ns)

    def _stamped(self, commands: Iterable[Command], now_ns: int) -> list[Message]:
        return [msgspec.structs.replace(c, seq=self._next("cmd"), t_ns=now_ns) for c in commands]

    def _remember(self, now_ns: int) -> list[Message]:
        """What must outlive this process, if it has changed."""
        voter, old = self._voter, self._remembered
        now = (voter.highest_term, voter.minimum_term, *self._applied)
        if old and now == (
            old.highest_term,
            old.mandate_term,
            old.applied_term,
            old.applied_number,
        ):
            return []
        if not old and not any(now):
            return []
        self._remembered = PersistentState(self.id, self._next("persistent_state"), now_ns, *now)
        return [self._remembered]

    def _truth(self, now_ns: int) -> Truth:
        vehicle = self._vehicle
        manoeuvre = vehicle.manoeuvre
        mode = manoeuvre.manoeuvre if manoeuvre else "arrived" if vehicle.plan.arrived else "plan"
        return truth_of(
            self.id,
            now_ns // self._tick_ns,
            now_ns,
            vehicle.state,
            mode,
            vehicle.plan.active,
            vehicle.guidance(),
            vehicle.flown(),
            vehicle.command_id,
        )

    def _next(self, kind: str) -> int:
        self._seq[kind] += 1
        return self._incarnation * INCARNATION + self._seq[kind] - 1
