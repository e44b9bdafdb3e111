"""Systems with one thing wrong, each with a scenario in which that shows.

A mutant is switched on by patching; whoever checks runs must then find that `breaks` is violated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest

from fleet.agents.agent import Agent
from fleet.agents.group_resolver import GroupResolver
from fleet.agents.obedience import refusal
from fleet.agents.voting import Voter
from fleet.config.scenario import Scenario, Uav
from fleet.coordinator.coordinator import Coordinator
from fleet.faults.channel import Delivery
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.navigation import Navigation
from fleet.faults.kinds.partition import Partition
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.rate import Rate
from fleet.faults.rules import Rule
from fleet.faults.sensors import Sensors
from fleet.model.conflict.tracks import StateReport, TrafficPicture
from fleet.model.election import Answers, ComputingChoice
from fleet.model.vehicle.flight import State
from fleet.node.base import BaseNode
from fleet.node.broadcasts import Broadcasts, Portion, Reception
from fleet.node.node import RestartState
from fleet.node.runner import NodeRunner
from fleet.protocol.messages import Command, StateBroadcast
from fleet.protocol.surveillance import report_of
from fleet.simulation.in_memory import MemoryRunContext
from fleet.simulation.process_registry import ProcessRegistry

Patch = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Mutant:
    """What is wrong: how it comes about, which invariant it violates, and a scenario for it."""

    patch: Patch
    breaks: str
    scenario: Scenario


def meeting(*plan: Rule, duration_s: float = 8.0, **changes: Any) -> Scenario:
    """Three UAVs that are in conflict from the start."""
    uavs = (
        _bound(1, -600.0, 0.0, 0.0),
        _bound(2, 600.0, 0.0, 180.0),
        _bound(3, 0.0, 700.0, -90.0),
    )
    return Scenario("meeting", duration_s, uav=uavs, fault=plan, **changes)


def two_pairs(*plan: Rule, duration_s: float = 8.0) -> Scenario:
    """UAVs 1 and 2 in conflict, and far away 3 and 4."""
    uavs = (
        _bound(1, -600.0, 0.0, 0.0),
        _bound(2, 600.0, 0.0, 180.0),
        _bound(3, -600.0, 50_000.0, 0.0),
        _bound(4, 600.0, 50_000.0, 180.0),
    )
    return Scenario("two_pairs", duration_s, uav=uavs, fault=plan)


def _bound(uav: int, north_m: float, east_m: float, heading_deg: float) -> Uav:
    ahead = {0.0: (9e4, 0.0), 180.0: (-9e4, 0.0), -90.0: (0.0, -9e4)}[heading_deg]
    goal = (north_m + ahead[0], east_m + ahead[1], -300.0)
    return Uav(uav, (north_m, east_m, -300.0), heading_deg, (goal,))


def _forgiving(*reasons: str) -> Patch:
    """A UAV to which these reasons to refuse a command are none."""

    def lenient(*arguments: Any) -> str:
        reason = refusal(*arguments)
        return "" if reason in reasons else reason

    return lambda patch: patch.setattr("fleet.agents.agent.refusal", lenient)


def _gullible(patch: pytest.MonkeyPatch) -> None:
    """Every jump is believed."""
    patch.setattr("fleet.model.conflict.tracks.plausible", lambda *_: True)


def _highest(patch: pytest.MonkeyPatch) -> None:
    """Electors pick the highest ID."""
    for module in ("fleet.model.election", "fleet.agents.voting"):
        patch.setattr(f"{module}.lowest_eligible", lambda members, *_: max(members))


def _deaf_to_silence(patch: pytest.MonkeyPatch) -> None:
    """Electors stand by the lowest ID, whether it is there or not."""
    for module in ("fleet.model.election", "fleet.agents.voting"):
        patch.setattr(f"{module}.lowest_eligible", lambda members, *_: min(members))


def _fickle(patch: pytest.MonkeyPatch) -> None:
    """A command that is sent again is another one."""
    honest = GroupResolver.repetitions

    def repetitions(resolver: GroupResolver, now_ns: int) -> list[Command]:
        return [
            msgspec.structs.replace(c, climb_mps=c.climb_mps + 1.0)
            for c in honest(resolver, now_ns)
        ]

    patch.setattr(GroupResolver, "repetitions", repetitions)


def _forgetful(patch: pytest.MonkeyPatch) -> None:
    """A coordinator that is started again remembers nothing."""
    honest = Coordinator.__init__

    def start(
        coordinator: Coordinator,
        scenario: Scenario,
        restart: RestartState | None = None,
        tracks: TrafficPicture | None = None,
    ) -> None:
        if restart:
            restart = msgspec.structs.replace(restart, memory=None)
        honest(coordinator, scenario, restart, tracks)

    patch.setattr(Coordinator, "__init__", start)


def _talkative(patch: pytest.MonkeyPatch) -> None:
    """A UAV broadcasts in every step."""
    patch.setattr(Agent, "_due", lambda *_: True)


def _unyielding(patch: pytest.MonkeyPatch) -> None:
    """A UAV elects itself, whomever the others are under."""
    patch.setattr(Voter, "_yields_to", lambda *_: False)


def _leaky(patch: pytest.MonkeyPatch) -> None:
    """A node runner loses a message and tells nobody."""
    honest, together = NodeRunner.accept, NodeRunner.accept_together

    def accept(runner: NodeRunner, arrived: Reception) -> None:
        if arrived.message.kind != "adsb" or arrived.message.seq % 10 != 3:
            honest(runner, arrived)

    def accept_together(runner: NodeRunner, portion: Portion) -> None:
        left = Broadcasts(portion.broadcasts.t_ns)
        for place in portion.places(runner.node.id).tolist():
            message = portion.broadcasts.messages[place]
            if message.seq % 10 != 3:
                left.add(portion.broadcasts.receptions[place], message)
        together(runner, Portion(left))

    patch.setattr(NodeRunner, "accept", accept)
    patch.setattr(NodeRunner, "accept_together", accept_together)


def _trusting(patch: pytest.MonkeyPatch) -> None:
    """An answer is never missed."""
    patch.setattr(Answers, "missing", lambda *_: False)


def _credulous(patch: pytest.MonkeyPatch) -> None:
    """Everybody is taken to hear and to be able to compute, whatever it says."""
    honest = report_of

    def able(message: StateBroadcast) -> StateReport:
        return msgspec.structs.replace(honest(message), hears=True, equipment="full")

    patch.setattr("fleet.node.base.report_of", able)


def _hasty(patch: pytest.MonkeyPatch) -> None:
    """Who was passed over comes back at once."""
    patch.setattr(ComputingChoice, "announced", lambda *_: None)


def _equipped(scenario: Scenario, **equipment: Any) -> Scenario:
    """The same with other equipment: `uav_1="deaf"`."""
    uavs = [
        msgspec.structs.replace(u, equipment=equipment.get(f"uav_{u.id}", u.equipment))
        for u in scenario.uav
    ]
    return msgspec.structs.replace(scenario, uav=tuple(uavs))


def _deaf_to_faults(patch: pytest.MonkeyPatch) -> None:
    """UAV 2 takes everything as it comes, whatever the fault plan says."""
    honest = NodeRunner._judge

    def judge(runner: NodeRunner, arrived: Reception) -> None:
        if runner.node.id == 2:
            runner._deliver(arrived.message, None, arrived.arrived_ns, 0, arrived.transit_ns)
        else:
            honest(runner, arrived)

    patch.setattr(NodeRunner, "_judge", judge)


def _not_twice(patch: pytest.MonkeyPatch) -> None:
    """A node runner takes no copy that comes later."""
    honest = NodeRunner._pass

    def let_through(runner: NodeRunner, arrived: Reception, delivery: Delivery) -> None:
        if not delivery.delay_ns:
            honest(runner, arrived, delivery)

    patch.setattr(NodeRunner, "_pass", let_through)


def _immortal(patch: pytest.MonkeyPatch) -> None:
    """Who is to be killed lives on, whatever the simulation says."""
    patch.setattr(MemoryRunContext, "carry_out", lambda *_: None)


def _grounded(patch: pytest.MonkeyPatch) -> None:
    """The simulation does not fly the aircraft of the dead."""
    patch.setattr(ProcessRegistry, "unmanned", lambda *_: [])


def _all_knowing(patch: pytest.MonkeyPatch) -> None:
    """UAVs know where they are, whatever the fault plan says."""

    class Perfect(Sensors):
        def sense(self, state: State, _now_ns: int) -> State | None:
            return state

    patch.setattr("fleet.agents.agent.Sensors", Perfect)


def _punctual(node: type[BaseNode]) -> Patch:
    """A clock is right, whatever the fault plan says."""
    return lambda patch: patch.setattr(node, "_local", lambda _, now_ns: now_ns)


FAULTS: dict[str, tuple[Rule, ...]] = {
    "loss": (Loss(probability=0.3),),
    "latency": (Latency(base_s=0.5),),
    "partition": (Partition(groups="1/2,3,coordinator", start_s=2.0, end_s=4.0),),
    "corruption": (Corrupt(probability=0.3),),
    "altering": (Corrupt(probability=0.3, frame_check=False),),
    "bursts": (Burst(loss=0.3),),
    "range": (Range(max_m=900.0),),
    "rate": (Rate(bits_per_s=20_000.0, queue=3),),
    "duplicates": (
        Duplicate(probability=0.5, delay_s=0.3),
        Latency(base_s=0.2),
        Kill(node="2", start_s=3.0, end_s=3.5),
    ),
}
"""Kinds of faults that a participant could ignore."""

MUTANTS = {
    "fencing off": Mutant(
        _forgiving("stale_term"),
        "newest term obeyed",
        meeting(
            Kill(node="coordinator", start_s=0.8, end_s=1.2),
            Loss(src="coordinator", dst="1", classes="election", probability=1.0, start_s=0.8),
            Loss(classes="cmd", probability=1.0, end_s=1.45),
        ),
    ),
    "expiry off": Mutant(
        _forgiving("expired"), "obeyed in time", meeting(Latency(classes="cmd", base_s=2.5))
    ),
    "deduplication off": Mutant(
        _forgiving("duplicate", "superseded"),
        "obeyed once, in order",
        meeting(Duplicate(classes="cmd", probability=1.0, delay_s=0.3)),
    ),
    "plausibility off": Mutant(
        _gullible,
        "only plausible believed",
        meeting(Navigation(node="1", start_s=3.0, bias_ned_m=(3000.0, 0.0, 0.0))),
    ),
    "highest ID": Mutant(_highest, "lowest eligible leads", meeting()),
    "deaf to silence": Mutant(
        _deaf_to_silence,
        "a leader again",
        meeting(Kill(node="1", start_s=3.0), duration_s=12.0),
    ),
    "fickle repetitions": Mutant(
        _fickle, "repetitions identical", meeting(Loss(classes="cmd", probability=1.0, end_s=1.0))
    ),
    "forgetful coordinator": Mutant(
        _forgetful,
        "terms rise",
        two_pairs(
            Loss(src="coordinator", dst="3-4", probability=1.0, end_s=4.0),
            Kill(node="coordinator", start_s=2.0, end_s=2.5),
            Loss(src="1-2", classes="adsb", probability=1.0, start_s=2.0),
        ),
    ),
    "talkative UAV": Mutant(_talkative, "positions as sensed", meeting(duration_s=2.0)),
    "unyielding UAV": Mutant(
        _unyielding,
        "UAVs elect in need",
        meeting(Loss(src="coordinator", dst="1", probability=1.0)),
    ),
    "leaky runner": Mutant(_leaky, "nothing lost silently", meeting()),
    **{
        f"UAV 2 ignores {name}": Mutant(_deaf_to_faults, "fault plan applied", meeting(*plan))
        for name, plan in FAULTS.items()
    },
    "nothing twice": Mutant(
        _not_twice, "fault plan applied", meeting(Duplicate(probability=0.5, delay_s=0.3))
    ),
    "immortal UAV": Mutant(
        _immortal, "processes as planned", meeting(Kill(node="3", start_s=2.0, end_s=4.0))
    ),
    "aircraft without a process not flown": Mutant(
        _grounded, "processes as planned", meeting(Pause(node="3", start_s=2.0, end_s=4.0))
    ),
    "UAVs that know where they are": Mutant(
        _all_knowing,
        "positions as sensed",
        meeting(Navigation(node="3", noise_m=5.0, start_s=2.0, end_s=4.0)),
    ),
    "UAVs with right clocks": Mutant(
        _punctual(Agent),
        "clocks as planned",
        meeting(ClockError(node="3", offset_s=0.1)),
    ),
    "coordinator with a right clock": Mutant(
        _punctual(Coordinator),
        "clocks as planned",
        meeting(ClockError(node="coordinator", offset_s=0.1)),
    ),
    "trusting coordinator": Mutant(
        _trusting,
        "lowest eligible leads",
        meeting(Loss(src="coordinator", dst="1", classes="election", probability=1.0)),
    ),
    "credulous coordinator": Mutant(
        _credulous, "lowest eligible leads", _equipped(meeting(), uav_1="no_compute")
    ),
    "coordinator deaf to the deaf": Mutant(
        _credulous, "lowest eligible leads", meeting(Loss(dst="1", probability=1.0))
    ),
    "hasty coordinator": Mutant(
        _hasty,
        "lowest eligible leads",
        meeting(Loss(src="1", classes="adsb", probability=1.0, start_s=1.0, end_s=4.0)),
    ),
}
