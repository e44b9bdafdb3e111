"""The stage of a run over zenoh: its processes, what is done to them, and the operator's wishes."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace

import msgspec

from fleet.comms.gate import Gate
from fleet.comms.keys import issuer_name
from fleet.comms.participant import Membership, plan_bytes
from fleet.comms.station import Revival
from fleet.comms.zenoh_bus import Bus
from fleet.model.faults.plan import FaultRule
from fleet.model.faults.process import Change
from fleet.model.scenario import Scenario
from fleet.run.cast import Cast
from fleet.run.clocks import Roll
from fleet.run.ear import Ear
from fleet.run.guard import Guard
from fleet.run.launcher import Crew
from fleet.run.ledger import Ledger
from fleet.run.requests import Requests


class ZenohStage:
    """Implements what the clocks need (`fleet.run.clocks.Stage`)."""

    def __init__(
        self,
        bus: Bus,
        membership: Membership,
        ledger: Ledger,
        stall_s: float,
        *,
        whole: AbstractContextManager[object],
        external: bool = False,
    ) -> None:
        """`whole` holds interrupts off; `external`: others start the processes."""
        self.scenario: Scenario = membership.scenario
        self.ledger = ledger
        self.cast = Cast(self.scenario)
        numbers = list(self.cast.roster.nodes)
        self.roll = Roll([issuer_name(n) for n in numbers])
        gate = Gate(self.scenario, rising=True)
        self.ear = Ear(gate, ledger, self.roll.words, self.scenario.tick_ns)
        self.crew = Crew(membership, numbers, whole)
        self.guard = Guard(bus, self.roll, stall_s, self.crew)
        self._bus = bus
        self._membership = membership
        self._requests = Requests(
            self.scenario, processes=not external, realtime=membership.clock == "realtime"
        )

    def start(self) -> None:
        """Start the processes of the fleet."""
        self.guard.start(tokens=False)
        self._bus.announce()
        self._requests.listen(self._bus)
        self.crew.start(self.guard.died)

    def invite(self) -> None:
        """Wait for processes that others start."""
        self.guard.start(tokens=True)
        self._bus.announce()
        self._bus.offer_plan(plan_bytes(self._membership.clock, self.scenario))
        self._requests.listen(self._bus)

    def stop(self) -> None:
        """End what was started."""
        self.guard.end()
        self.crew.stop()

    def new_plan(self, tick: int) -> tuple[FaultRule, ...] | None:
        """The fault plan from this tick on, if the operator has changed it."""
        return self._requests.new_plan(self.cast.plan, tick)

    def carry_out(self, change: Change, revival: Revival | None) -> None:
        """Signal a process, or start it again."""
        match change.action:
            case "kill":
                self.crew.kill(change.node)
            case "stop":
                self.crew.hold(change.node)
            case "continue":
                self.crew.release(change.node)
            case "restart":
                scenario = msgspec.structs.replace(self.scenario, fault=self.cast.plan)
                membership = replace(self._membership, scenario=scenario, revival=revival)
                self.crew.restart(change.node, membership)
