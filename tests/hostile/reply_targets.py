"""What a process reads of the simulation, and the simulation of those who ask: as targets."""

from __future__ import annotations

import contextlib
import json
import random
from collections.abc import Callable
from typing import Any

import msgspec

from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.checks import problem_with
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.coordinator.coordinator import Coordinator
from fleet.errors import FleetError
from fleet.faults.kinds.loss import Loss
from fleet.faults.plan import plan_of
from fleet.live.run_source import RunSource
from fleet.live.source import Change
from fleet.live.view import LiveView
from fleet.node.clock_words import FOREVER_NS, clock_of
from fleet.node.gate import Gate
from fleet.node.intake import Intake
from fleet.node.join_info import join_info_of
from fleet.node.participant import lockstep_runner
from fleet.node.progress import read_progress
from fleet.node.subscriptions import listed_for
from fleet.protocol.sample import Sample
from fleet.protocol.topics import CLOCK
from fleet.simulation.fault_control import FaultControl, answer_of
from fleet.simulation.pace import Pace
from tests.hostile import corpus
from tests.hostile.mutation import Pack, Unpack, mutated_payload, packed, unpacked
from tests.hostile.scene import ENCOUNTER, Scene, check_own

MOST_UAVS = 20
"""A plan with more of them is understood, and not flown here."""


def json_bytes(tree: Any) -> bytes:
    """A tree as JSON."""
    return json.dumps(tree).encode("utf-8", "surrogatepass")


JSON: tuple[Unpack, Pack] = (json.loads, json_bytes)
PACKED: tuple[Unpack, Pack] = (unpacked, packed)


class ReplyTarget:
    """One kind of answer or question; each is read by itself."""

    limit_s = 5.0

    def __init__(
        self, name: str, read: Callable[[bytes], bool], forms: tuple[Unpack, Pack] = JSON
    ) -> None:
        self.name, self._read, self._forms = name, read, forms
        self.accepted, self.together = 0, 1

    def seeds(self) -> list[bytes]:
        """Real ones."""
        return corpus.stored(self.name)

    def mutate(self, rng: random.Random, data: bytes) -> bytes:
        """Another one."""
        return mutated_payload(rng, data, *self._forms)

    def __call__(self, data: bytes) -> None:
        """Read it."""
        with contextlib.suppress(FleetError):
            self.accepted += self._read(data)


class _NothingMoreError(Exception):
    """What is waited for does not come."""


class ClockReader:
    """A participant that hears the simulation's clock, as in lockstep."""

    def __init__(self) -> None:
        self._scene = Scene(ENCOUNTER, 1)

    def __call__(self, data: bytes) -> bool:
        """Take what is listed, and go by the plan."""
        clock = clock_of(Sample(CLOCK, data))
        if clock is None:
            return False
        scene = self._scene
        if scene.exhausted or clock.plan:
            scene.begin_anew()
        gate = Gate(ENCOUNTER.scenario)
        gate.latest_ns = FOREVER_NS
        for suffix in scene.runner.node.hears:
            listed, samples = listed_for(1, clock, suffix), iter(scene.due())

            def more(samples: Any = samples) -> Sample:
                for topic, payload, _ in samples:
                    return Sample(topic, payload)
                raise _NothingMoreError

            with contextlib.suppress(_NothingMoreError):
                Intake(gate).take(listed, more)
        if clock.plan and not problem_with(_with_plan(plan_of(clock.plan))):
            scene.runner.replan(plan_of(clock.plan))
        scene.step()
        return True


def _with_plan(plan: tuple[Any, ...]) -> Scenario:
    return msgspec.structs.replace(ENCOUNTER.scenario, fault=plan)


def read_plan(data: bytes) -> bool:
    """Join by what the simulation tells, and step, as `fleet uav` and `fleet coordinator` do."""
    try:
        info = join_info_of("", "hostile", data, name="1")
    except ValueError:
        return False
    scenario = info.scenario
    if problem_with(scenario) or scenario.resolver not in ("geometric", "none"):
        return False
    uavs = uavs_of(scenario)
    own = next((uav for uav in uavs if uav.id == 1), None)
    if own is None or len(uavs) > MOST_UAVS:
        return True
    nodes = (
        Agent(own, scenario, load_resolver(scenario), info.restart),
        Coordinator(scenario, info.restart),
    )
    begun = info.restart.t_ns // scenario.tick_ns + 1 if info.restart else 0
    for node in nodes:
        runner = lockstep_runner(node, scenario, info.restart)
        for tick in range(begun, begun + 3):
            for message in runner.step(tick * scenario.tick_ns):
                check_own(message, tick * scenario.tick_ns)
    return True


class _Bus:
    """Answers whatever is asked with one answer, and asks what it is told to."""

    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.answers: list[bytes] = []

    def ask(self, *_: object) -> bytes:
        """The answer, whatever the question."""
        return self.payload

    def answer(self, _topic: str, take: Callable[[bytes, Callable[[bytes], None]], None]) -> None:
        """Whoever answers is asked at once."""
        take(self.payload, self.answers.append)


def read_frame(data: bytes) -> bool:
    """A viewer is answered by somebody."""
    frame = _run_source(data).frame(0)
    if frame is None:
        return False
    view = LiveView(ENCOUNTER.scenario)
    json.dumps(view.take(frame))
    return True


def read_answer(data: bytes) -> bool:
    """Whoever asks for faults or another pace is answered by somebody."""
    source = _run_source(data)
    source.change(Change(paused=True))
    source.change(Change(faults={"loss": ["30%"]}))
    return not answer_of(data).problem


def _run_source(data: bytes) -> RunSource:
    bus: Any = _Bus(data)
    return RunSource(bus, "hostile")


def read_change(data: bytes) -> bool:
    """A browser asks for something."""
    try:
        change = msgspec.json.decode(data, type=Change)
    except (ValueError, RecursionError):
        return False
    return _run_source(b"").change(change).good


class Requests:
    """The simulation is asked for another plan, and another pace."""

    def __call__(self, data: bytes) -> bool:
        """All who are asked answer."""
        bus: Any = _Bus(data)
        control, pace = FaultControl(ENCOUNTER.scenario), Pace()
        control.listen(bus)
        pace.listen(bus)
        plan = control.new_plan((Loss(probability=0.1),), 300)
        pace._hear()
        assert len(bus.answers) == 2
        if plan is not None:
            scene = Scene(ENCOUNTER, 1)
            scene.begin_anew()
            scene.runner.replan(plan)
            scene.step()
        return plan is not None


REPLIES: dict[str, Callable[[], ReplyTarget]] = {
    "clock": lambda: ReplyTarget("clock", ClockReader(), PACKED),
    "plan": lambda: ReplyTarget("plan", read_plan),
    "progress": lambda: ReplyTarget("progress", lambda data: bool(read_progress(data))),
    "view": lambda: ReplyTarget("view", read_frame, PACKED),
    "answer": lambda: ReplyTarget("answer", read_answer),
    "change": lambda: ReplyTarget("change", read_change),
    "request": lambda: ReplyTarget("request", Requests()),
}
