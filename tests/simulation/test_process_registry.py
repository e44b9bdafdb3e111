"""What becomes of an aircraft whose process has died, when its last words come late."""

from __future__ import annotations

import math

import msgspec
import pytest

from fleet.config.scenario import Scenario
from fleet.faults.kinds.kill import Kill
from fleet.model.types import COORDINATOR
from fleet.protocol.messages import Truth
from fleet.simulation.process_registry import ProcessRegistry
from tests.conftest import kept_run
from tests.support import samples

KILLED_TICK = 10


def killed() -> Scenario:
    """UAV 1 dies in tick 10, and is alone: nothing turns it."""
    scenario = samples.head_on()
    kill = Kill(node="1", start_s=KILLED_TICK * scenario.tick_ns / 1e9)
    return msgspec.structs.replace(scenario, duration_s=3.0, fault=(kill,))


@pytest.fixture(scope="module")
def turning() -> dict[int, Truth]:
    """By tick: the true states of UAV 1, with the command to turn round and climb."""
    scenario = msgspec.structs.replace(killed(), fault=())
    run_recorder = kept_run(scenario)
    told = {"commanded_heading_rad": math.pi / 2, "commanded_climb_mps": 2.0}
    own = [m for m in run_recorder.kept if isinstance(m, Truth) and m.id == 1]
    return {m.seq: msgspec.structs.replace(m, **told) for m in own}


def flown(registry: ProcessRegistry, tick: int) -> Truth:
    """How the simulation flies UAV 1 on in a tick."""
    ((_, _, truth),) = registry.unmanned(tick)
    assert isinstance(truth, Truth)
    return truth


def test_a_last_state_that_comes_after_the_death_is_not_flown_on_its_command(
    turning: dict[int, Truth],
) -> None:
    """Realtime: the process was killed when its tick 8 had come, and tick 9 was on its way."""
    late, timely = ProcessRegistry(killed()), ProcessRegistry(killed())
    late.note([turning[8]])
    timely.note([turning[9]])
    late.enter(KILLED_TICK)
    timely.enter(KILLED_TICK)
    late.note([turning[9]])
    for tick in range(KILLED_TICK, KILLED_TICK + 5):
        truth = flown(late, tick)
        assert truth == flown(timely, tick)
        assert truth.heading_rad == turning[9].heading_rad
        assert truth.position_ned_m[2] == pytest.approx(turning[9].position_ned_m[2])


def test_a_first_state_that_comes_after_the_death_is_flown_on(turning: dict[int, Truth]) -> None:
    registry = ProcessRegistry(killed())
    registry.enter(KILLED_TICK)
    assert registry.unmanned(KILLED_TICK) == []
    registry.note([turning[9]])
    truth = flown(registry, KILLED_TICK)
    assert truth.commanded_heading_rad == turning[9].heading_rad


def test_nobody_is_set_back_to_a_state_from_before_it_was_flown_on(
    turning: dict[int, Truth],
) -> None:
    registry, undisturbed = ProcessRegistry(killed()), ProcessRegistry(killed())
    for one in (registry, undisturbed):
        one.note([turning[9]])
        one.enter(KILLED_TICK)
        assert one.unmanned(KILLED_TICK)
    registry.note([turning[9]])
    assert flown(registry, KILLED_TICK + 1) == flown(undisturbed, KILLED_TICK + 1)


def test_a_coordinator_that_has_elected_nobody_has_been_there_all_the_same() -> None:
    """Who comes in its place is the next incarnation: its numbers go on."""
    registry = ProcessRegistry(samples.head_on())
    registry.enter(KILLED_TICK)
    assert registry.found_by(COORDINATOR) is None
    registry.note([samples.heartbeat(0)])
    found = registry.found_by(COORDINATOR)
    assert found is not None
    assert (found.incarnation, found.memory, found.truth) == (1, None, None)
