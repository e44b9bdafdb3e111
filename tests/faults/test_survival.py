"""Whoever dies, somebody computes again in time, and the rest keep their separation."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from fleet.config.loading import read_scenario
from fleet.faults.kinds.kill import Kill
from fleet.model.election import Terms
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol.messages import Ack, Election
from tests.conftest import Cli, KeepingRecorder
from tests.faults.near_four_way import UAVS, arguments, elections, near, run, with_plan
from tests.simulation.test_simulation import result
from tests.support.samples import S

LIMITS = read_scenario("four_way").scenario
TICK_NS = LIMITS.tick_ns
BOUND_NS = to_ns(LIMITS.coordination.update_s + LIMITS.surveillance.broadcast_s + 2 * LIMITS.tick_s)
SILENCE_NS = to_ns(LIMITS.coordination.silence_limit_s)
VALID_NS = to_ns(LIMITS.coordination.election_valid_s)


def mid_resolution_s(run_recorder: KeepingRecorder) -> float:
    """The tick after all of the first commands have been acknowledged."""
    first = next(m for m in run_recorder.kept if isinstance(m, Ack) and m.accepted)
    answered = [m.t_ns for m in run_recorder.kept if isinstance(m, Ack) and m.t_ns < first.t_ns + S]
    return (max(answered) + TICK_NS) / S


def successor(run_recorder: KeepingRecorder, kill_s: float, dead: Sequence[int]) -> Election:
    """The first election after a death that names somebody alive."""
    return next(
        m for m in elections(run_recorder) if m.t_ns >= kill_s * S and m.computing not in dead
    )


def lost_among(run_recorder: KeepingRecorder, dead: Sequence[int]) -> list[tuple[int, int]]:
    return [
        (m.a, m.b)
        for m in run_recorder.separation.minima()
        if m.least_separation < 1.0 and not {m.a, m.b} & set(dead)
    ]


@pytest.fixture(scope="module")
def kill_s() -> float:
    """When `four_way` is in mid-resolution."""
    return mid_resolution_s(run(read_scenario("four_way", ["duration_s=60"]).scenario))


DEATHS = [
    # who dies, who computes then, within which time
    ([1], 2, SILENCE_NS),
    ([COORDINATOR], 1, max(SILENCE_NS, VALID_NS)),
    ([COORDINATOR, 1], 2, max(SILENCE_NS, VALID_NS)),
]


@pytest.mark.parametrize(("dead", "computing", "limit_ns"), DEATHS)
def test_somebody_computes_again_in_time_and_separation_is_kept_among_the_rest(
    kill_s: float, dead: list[int], computing: int, limit_ns: int
) -> None:
    plan = [Kill(node=str(n) if n else "coordinator", start_s=kill_s) for n in dead]
    run_recorder = run(with_plan(read_scenario("four_way", ["duration_s=150"]).scenario, *plan))
    found = successor(run_recorder, kill_s, dead)
    assert found.computing == computing
    assert found.id == (computing if COORDINATOR in dead else COORDINATOR)
    assert found.t_ns <= kill_s * S + limit_ns + BOUND_NS
    assert lost_among(run_recorder, dead) == []
    assert any(
        isinstance(m, Ack) and m.accepted and m.target == computing and m.t_ns > found.t_ns
        for m in run_recorder.kept
    )


@pytest.mark.parametrize(("dead", "computing", "limit_ns"), DEATHS)
def test_so_it_is_over_real_processes(
    cli: Cli, dead: list[int], computing: int, limit_ns: int
) -> None:
    """And past the point where they would lose separation, with the same digest."""
    when_s = mid_resolution_s(run(near(5.0)))
    assert when_s < 2.0
    kills = {"kill": [f"{n or 'coordinator'}@{when_s}s" for n in dead]}
    memory = run(near(40.0, kills))
    found = successor(memory, when_s, dead)
    assert found.computing == computing
    assert found.t_ns <= when_s * S + limit_ns + BOUND_NS
    assert lost_among(memory, dead) == []
    assert result(cli.run(*arguments(40.0, kills)))["digest"] == memory.digest


@pytest.mark.parametrize("kill_s", [0.5, 1.3, 2.0, 3.1])
@pytest.mark.parametrize(("dead", "computing", "limit_ns"), DEATHS)
def test_whenever_it_dies_somebody_computes_in_time(
    kill_s: float, dead: list[int], computing: int, limit_ns: int
) -> None:
    plan = [Kill(node=str(n) if n else "coordinator", start_s=kill_s) for n in dead]
    found = successor(run(with_plan(near(7.0), *plan)), kill_s, dead)
    assert found.computing == computing
    assert found.t_ns <= kill_s * S + limit_ns + BOUND_NS


def test_a_uav_that_elected_itself_is_replaced_when_it_dies_too() -> None:
    run_recorder = run(near(15.0, {"kill": ["coordinator@1s", "1@6s", "2@10s"]}))
    for when_s, dead, computing in ((6.0, [1], 2), (10.0, [1, 2], 3)):
        found = successor(run_recorder, when_s, dead)
        assert (found.id, found.computing) == (computing, computing)
        assert found.t_ns <= when_s * S + max(SILENCE_NS, VALID_NS) + BOUND_NS


@pytest.mark.parametrize("back_s", [2.0, 6.0])
def test_a_coordinator_that_returns_goes_on_above_the_highest_term(back_s: float) -> None:
    run_recorder = run(near(15.0, {"kill": [f"coordinator@1s+{back_s}s", "coordinator@10s+1s"]}))
    terms = Terms(UAVS)
    assert all(terms.elector_of(m.term) == m.id for m in elections(run_recorder))
    for returns_ns in (round((1.0 + back_s) * S), 11 * S):
        before = [m.term for m in elections(run_recorder) if m.t_ns < returns_ns]
        own = [m for m in elections(run_recorder) if m.id == COORDINATOR and m.t_ns >= returns_ns]
        assert min(m.term for m in own) > max(before)
        assert own[0].t_ns <= returns_ns + BOUND_NS
    obeyed: dict[int, int] = {}
    for m in run_recorder.kept:
        if isinstance(m, Ack) and m.accepted:
            assert m.term >= obeyed.get(m.id, 0)
            obeyed[m.id] = m.term
    assert {m.id for m in elections(run_recorder) if m.t_ns > 12 * S} == {COORDINATOR}
