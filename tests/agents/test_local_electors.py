"""A fleet in parts: four UAVs towards one point, 24 s away from losing separation."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.scenario import Coordination, Scenario, Uav
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.partition import Partition
from fleet.faults.rules import Rule
from fleet.faults.whom import names
from fleet.model.election import Terms
from fleet.protocol.messages import Ack, Election, Heartbeat
from tests.conftest import KeepingRecorder, kept_run
from tests.support.samples import S

fast = settings(deadline=None, derandomize=True, max_examples=100)


def fleet(*plan: Rule, duration_s: float = 30.0, seed: int = 0) -> Scenario:
    far = 1200.0
    places = ((0.0, -far, 90.0), (0.0, far, -90.0), (far, 0.0, 180.0), (-far, 0.0, 0.0))
    uavs = tuple(
        Uav(n, (north, east, -300.0), heading, ((-north, -east, -300.0),))
        for n, (north, east, heading) in enumerate(places, start=1)
    )
    return Scenario("fleet", duration_s, uav=uavs, fault=plan, seed=seed)


def run(scenario: Scenario) -> KeepingRecorder:
    return kept_run(scenario)


def check_that_nobody_has_two_commanders(run_recorder: KeepingRecorder) -> None:
    """Terms are their electors', one UAV computes in each, and a UAV never goes back to one.

    What it obeys is told by that one, who has been elected for it and still is.
    """
    terms = Terms((1, 2, 3, 4))
    found: dict[int, set[tuple[int, tuple[int, ...]]]] = {}
    until_ns: dict[int, int] = {}
    obeyed: dict[int, int] = {}
    for m in run_recorder.kept:
        if isinstance(m, Election):
            assert terms.elector_of(m.term) == m.id
            found.setdefault(m.term, set()).add((m.computing, m.members))
            until_ns[m.term] = m.valid_until_ns
        elif isinstance(m, Ack) and m.accepted:
            ((computing, members),) = found[m.term]
            assert m.target == computing
            assert {m.id, computing} <= set(members)
            assert m.t_ns <= until_ns[m.term]
            assert m.term >= obeyed.get(m.id, 0)
            obeyed[m.id] = m.term
    assert all(len(elected) == 1 for elected in found.values())


def commanders(run_recorder: KeepingRecorder, uav: int, start_ns: int, end_ns: int) -> set[int]:
    """Whose commands a UAV accepted in a span of time."""
    return {
        m.target
        for m in run_recorder.kept
        if isinstance(m, Ack) and m.accepted and m.id == uav and start_ns <= m.t_ns < end_ns
    }


@pytest.mark.parametrize("groups", ["1,2/3,4", "1,3/2,4", "1/2,3,4", "1,2,3/4"])
def test_each_side_of_a_partition_is_commanded_by_its_own_lowest_and_by_nobody_else(
    groups: str,
) -> None:
    start_s, end_s = 4.0, 20.0
    plan = (
        Kill(node="coordinator", start_s=2.0),
        Partition(groups=groups, start_s=start_s, end_s=end_s),
    )
    run_recorder = run(fleet(*plan))
    check_that_nobody_has_two_commanders(run_recorder)
    settled_ns = round((start_s + 2.0 + 1.5 + 0.6) * S)
    sides = [[n for n in range(1, 5) if names(side, n)] for side in groups.split("/")]
    for side in sides:
        electors = {
            m.computing
            for m in run_recorder.kept
            if isinstance(m, Election) and settled_ns <= m.t_ns < end_s * S and m.computing in side
        }
        assert electors <= {min(side)}
        if len(side) > 1:
            assert electors == {min(side)}
        for uav in side:
            assert commanders(run_recorder, uav, settled_ns, round(end_s * S)) <= {min(side)}
    healed = [
        m for m in run_recorder.kept if isinstance(m, Election) and m.t_ns > (end_s + 3.0) * S
    ]
    assert {m.computing for m in healed} == {1}


@given(
    groups=st.sampled_from(["1,2/3,4", "1,3/2,4", "1,4/2,3", "1/2,3,4", "2/1,3,4", "1/2/3/4"]),
    kill_s=st.integers(0, 60).map(lambda n: n / 10.0),
    back_s=st.none() | st.integers(1, 80).map(lambda n: n / 10.0),
    start_s=st.integers(0, 80).map(lambda n: n / 10.0),
    length_s=st.integers(10, 80).map(lambda n: n / 10.0),
    loss=st.sampled_from([0.0, 0.3]),
    seed=st.integers(0, 99),
)
@settings(fast, max_examples=6)
def test_two_sides_of_a_partition_never_both_command_one_uav(
    groups: str,
    kill_s: float,
    back_s: float | None,
    start_s: float,
    length_s: float,
    loss: float,
    seed: int,
) -> None:
    end_s = None if back_s is None else kill_s + back_s
    plan = (
        Kill(node="coordinator", start_s=kill_s, end_s=end_s),
        Partition(groups=groups, start_s=start_s, end_s=start_s + length_s),
        Loss(probability=loss),
    )
    run_recorder = run(fleet(*plan, duration_s=18.0, seed=seed))
    check_that_nobody_has_two_commanders(run_recorder)


def test_local_electors_resolve_without_any_coordinator() -> None:
    scenario = fleet(duration_s=60.0)
    coordination = Coordination(electors="local")
    run_recorder = run(msgspec.structs.replace(scenario, coordination=coordination))
    assert {m.id for m in run_recorder.kept if isinstance(m, Election)} == {1}
    assert not any(isinstance(m, Heartbeat) for m in run_recorder.kept)
    assert not run_recorder.separation.lost()
    check_that_nobody_has_two_commanders(run_recorder)
