"""The UAV as a pure node: what it hears and the time go in, what it sends comes out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import msgspec

from agents.computing import ComputingDesk
from agents.obedience import refusal
from agents.resolvers import Resolver
from agents.vehicle import Vehicle, order_of
from fleet.comms.messages import COORDINATOR, Ack, Adsb, Cmd, Decision, Election, Message, Truth
from fleet.comms.station import Incoming
from fleet.comms.surveillance import broadcast_of, report_of
from fleet.model.election import Mandate
from fleet.model.scenario import Scenario, Uav
from fleet.model.tracks import CommandId, Tracks
from fleet.model.units import to_ns


class Agent:
    """One UAV: flies, broadcasts, keeps tracks, obeys valid commands, computes when elected."""

    def __init__(self, uav: Uav, scenario: Scenario, resolver: Resolver) -> None:
        self.id = uav.id
        self.hears = ("adsb/0", "election", f"cmd/{uav.id}", f"ack/{uav.id}")
        self._vehicle = Vehicle(uav, scenario)
        self._desk = ComputingDesk(uav.id, scenario, resolver)
        self._tracks = Tracks()
        self._mandate: Mandate | None = None
        self._highest_term = 0
        self._applied: set[CommandId] = set()
        self._seq: Counter[str] = Counter()
        self._broadcast_ns = to_ns(scenario.surveillance.broadcast_s)
        self._timeout_ns = to_ns(scenario.surveillance.timeout_s)
        self._update_ns = to_ns(scenario.coordination.update_s)

    def step(self, now_ns: int, inbox: Sequence[Incoming]) -> list[Message]:
        """Fly to `now_ns`, acting on each message at its delivery time; return what to send."""
        out: list[Message] = []
        appointed = False
        for item in inbox:
            match item.message:
                case Adsb() as heard:
                    self._tracks.hear(report_of(heard))
                case Election() as election:
                    appointed |= self._on_election(election)
                case Cmd() as cmd:
                    out.append(self._on_command(cmd, item.delivered_ns))
                case Ack() as ack:
                    self._desk.on_ack(ack)
        self._vehicle.fly_to(now_ns)
        out += self._compute(now_ns, appointed)
        if now_ns % self._broadcast_ns == 0:
            out.append(broadcast_of(self._vehicle.report(), self._next("adsb"), self._highest_term))
        out.append(self._truth(now_ns))
        return out

    def _on_election(self, election: Election) -> bool:
        if election.id != COORDINATOR:
            return False
        self._highest_term = max(self._highest_term, election.term)
        if self.id not in election.members:
            return False
        if self._mandate and election.term < self._mandate.term:
            return False
        self._mandate = Mandate(
            election.term, election.members, election.computing, election.valid_until_ns
        )
        return self._desk.appoint(self._mandate)

    def _on_command(self, cmd: Cmd, delivered_ns: int) -> Ack:
        """Obey or refuse; either way the answer says so."""
        self._vehicle.fly_to(delivered_ns)
        reason = refusal(cmd, self.id, self._mandate, self._applied, delivered_ns)
        actuate_ns = 0
        if not reason:
            order = order_of(cmd, delivered_ns)
            self._applied.add(order.command)
            self._vehicle.obey(order)
            actuate_ns = order.start_ns
        return Ack(
            id=self.id,
            seq=self._next("ack"),
            t_ns=delivered_ns,
            target=cmd.id,
            term=cmd.term,
            number=cmd.number,
            issued_ns=cmd.issued_ns,
            accepted=not reason,
            reason=reason,
            actuate_ns=actuate_ns,
        )

    def _compute(self, now_ns: int, appointed: bool) -> list[Message]:
        """Rounds and repetitions, while this UAV holds a mandate."""
        if not self._desk.holds_mandate(now_ns):
            return []
        out: list[Message] = [self._stamped(cmd, now_ns) for cmd in self._desk.repetitions(now_ns)]
        if appointed or now_ns % self._update_ns == 0:
            heard = self._tracks.fresh(now_ns, self._timeout_ns)
            result = self._desk.run_round(self._vehicle.report(), heard, now_ns)
            out += [self._stamped(cmd, now_ns) for cmd in result.commands]
            if result.encounters:
                term = self._mandate.term if self._mandate else 0
                seq = self._next("decision")
                out.append(Decision(self.id, seq, now_ns, term, result.encounters))
        return out

    def _stamped(self, cmd: Cmd, now_ns: int) -> Cmd:
        return msgspec.structs.replace(cmd, seq=self._next("cmd"), t_ns=now_ns)

    def _truth(self, now_ns: int) -> Truth:
        vehicle = self._vehicle
        state, wanted, told = vehicle.state, vehicle.guidance(), vehicle.commanded()
        escape, command = vehicle.escape, vehicle.command
        mode = escape.manoeuvre if escape else "arrived" if vehicle.plan.arrived else "plan"
        return Truth(
            self.id,
            self._next("truth"),
            now_ns,
            state.position_ned_m,
            state.velocity_ned_mps,
            state.speed_mps,
            state.heading_rad,
            state.flight_path_rad,
            mode,
            vehicle.plan.active,
            wanted.heading_rad,
            wanted.climb_mps,
            told.heading_rad,
            told.climb_mps,
            command.term,
            command.issuer,
            command.number,
        )

    def _next(self, kind: str) -> int:
        self._seq[kind] += 1
        return self._seq[kind] - 1
