"""Programs that answer a relay, in memory: the fleet's own UAV, and the example's."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

from fleet.agents.advisory import Resolver
from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.config.scenario import Scenario, Uav
from fleet.faults.clock import ClockRule
from fleet.faults.sensors import SensorRule
from fleet.model.conflict.tracks import TrafficPicture
from fleet.node.node import InboxMessage, Node, RestartState
from fleet.relay.answers import FILLED_IN, HEADER
from fleet.relay.questions import StepQuestion, plan_question
from fleet.relay.relay_node import RelayNode

FOREIGN = Path(__file__).parents[2] / "examples" / "foreign"
Program = Callable[[StepQuestion], object]


def example(name: str) -> ModuleType:
    """A module of the example, as a program loads it."""
    spec = importlib.util.spec_from_file_location(name, FOREIGN / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[name] = loaded
    spec.loader.exec_module(loaded)
    return loaded


def plain(value: object) -> Any:
    """As it is after the way over a medium."""
    return msgspec.msgpack.decode(msgspec.msgpack.encode(value))


def example_program(uav: Uav, scenario: Scenario, restart: RestartState | None) -> Program:
    """The UAV of the example."""
    first = plan_question(uav, scenario, "run", "lockstep", restart)
    flying = example("uav").Uav(plain(first)["plan"])
    return lambda asked: plain(flying.step(plain(asked)))


def own_program(uav: Uav, scenario: Scenario, restart: RestartState | None) -> Program:
    """A UAV of the fleet, to which neither its clock nor its sensors are ever wrong."""
    plan = tuple(r for r in scenario.fault if not isinstance(r, ClockRule | SensorRule))
    right = msgspec.structs.replace(scenario, fault=plan)
    agent = Agent(uav, right, load_resolver(scenario), restart)

    def program(asked: StepQuestion) -> object:
        inbox = [InboxMessage(item.at_ns, item.message) for item in asked.inbox]
        told = []
        for message in agent.step(asked.t_ns, inbox):
            left_out = FILLED_IN.get(type(message), HEADER)
            fields = plain(message)
            told.append([message.kind, {k: v for k, v in fields.items() if k not in left_out}])
        return told

    return program


def relayed(make: Callable[[Uav, Scenario, RestartState | None], Program], number: int) -> Any:
    """What makes the UAVs of a run in memory, one of them a relay."""

    def node(
        uav: Uav,
        scenario: Scenario,
        resolver: Resolver,
        restart: RestartState | None = None,
        tracks: TrafficPicture | None = None,
    ) -> Node:
        if uav.id != number:
            return Agent(uav, scenario, resolver, restart, tracks)
        return RelayNode(uav, scenario, make(uav, scenario, restart), restart)

    return node
