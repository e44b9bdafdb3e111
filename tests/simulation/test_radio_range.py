"""Radio range in whole runs: who hears whom from which tick on, on either bus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import pytest

from fleet import check, load_scenario, run
from fleet.analysis.recorded_run import RecordedRun
from fleet.config.scenario import (
    Coordination,
    Guidance,
    Resolution,
    Scenario,
    Surveillance,
    Uav,
)
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.slow import Slow
from fleet.model.types import COORDINATOR
from fleet.protocol.messages import DeliveryReport, Election, Heartbeat, StateBroadcast
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.support.samples import head_on

TICK_NS, S = 100_000_000, 1_000_000_000


def pair(north_m: float, first: int) -> tuple[Uav, Uav]:
    """Two UAVs that meet head on after 30 s, so far north."""
    west, east = (north_m, -750.0, -300.0), (north_m, 750.0, -300.0)
    return (
        Uav(first, west, 90.0, ((north_m, 9000.0, -300.0),)),
        Uav(first + 1, east, 270.0, ((north_m, -9000.0, -300.0),)),
    )


def heard(run: RecordedRun, dst: int, src: int, kind: str) -> list[int]:
    """When that was sent which one has received of the other, in ns."""
    return [
        sent_ns
        for report in run.messages()
        if isinstance(report, DeliveryReport) and report.id == dst
        for of, what, sent_ns in zip(report.src, report.kinds, report.sent_ns, strict=True)
        if (of, what) == (src, kind)
    ]


def test_who_flies_into_range_is_heard_from_then_on_until_it_leaves() -> None:
    """They are 1500 m - 50 m/s t apart: within 1004 m from 9.92 s to 50.08 s."""
    flown = run(head_on(resolver="none", surveillance=Surveillance(range_m=1004.0)))
    wanted = [round(t * 0.2 * S) for t in range(50, 251)]
    assert heard(flown, 1, 2, StateBroadcast.kind) == wanted
    assert heard(flown, 2, 1, StateBroadcast.kind) == wanted
    assert heard(flown, 3, 1, StateBroadcast.kind) == heard(flown, 1, 3, StateBroadcast.kind) == []
    assert len(heard(flown, 3, COORDINATOR, Heartbeat.kind)) == 60 / 0.4


def test_the_coordinator_has_a_range_of_its_own() -> None:
    """UAV 1 flies away from it at 25 m/s, UAV 2 towards it from 1500 m, both 300 m above it.

    703 m of line of sight are 635.8 m on the ground: at 25.43 s and at 34.57 s.
    """
    coordination = Coordination(range_m=703.0)
    flown = run(head_on(resolver="none", coordination=coordination))
    away, near = (heard(flown, COORDINATOR, uav, StateBroadcast.kind) for uav in (1, 2))
    assert (away[0], away[-1], near[0]) == (0, round(25.4 * S), round(34.6 * S))
    assert heard(flown, 1, COORDINATOR, Heartbeat.kind)[-1] == round(25.2 * S)
    assert len(heard(flown, 1, 2, StateBroadcast.kind)) == 60 / 0.2
    assert heard(flown, COORDINATOR, 3, StateBroadcast.kind) == []


@pytest.mark.parametrize(
    "coordination", [Coordination(electors="local"), Coordination(range_m=3000.0)]
)
def test_groups_that_are_out_of_range_of_each_other_elect_by_themselves(
    coordination: Coordination,
) -> None:
    scenario = Scenario(
        "two_groups",
        60.0,
        uav=(*pair(0.0, 1), *pair(20_000.0, 3)),
        surveillance=Surveillance(range_m=5000.0),
        coordination=coordination,
    )
    flown = run(scenario)
    elected = {(m.id, m.computing, m.members) for m in flown.messages() if isinstance(m, Election)}
    near = COORDINATOR if coordination.electors == "coordinator" else 1
    assert elected == {(near, 1, (1, 2)), (3, 3, (3, 4))}
    for one in (1, 2):
        assert heard(flown, one, 3, Election.kind) == []
    assert heard(flown, 4, 3, Election.kind) != []


FAULTS = (
    Loss(probability=0.2),
    Pause(node="2", start_s=6.0, end_s=10.0),
    Kill(node="3", start_s=5.0, end_s=12.0),
    Slow(node="4", start_s=8.0, end_s=20.0, factor=5),
)


@pytest.mark.parametrize(
    ("ranges", "faults"),
    [
        ({"surveillance.range_m": 1500.0}, ()),
        ({"surveillance.range_m": 1800.0, "coordination.range_m": 1700.0}, FAULTS),
        ({"surveillance.range_m": 1e8}, ()),
        ({"coordination.range_m": 1700.0}, (*FAULTS, Range(max_m=1900.0))),
        ({"surveillance.range_m": 1500.0}, (Range(model="rayleigh", scale_m=1500.0),)),
        (
            {
                "surveillance.range_m": 250.0,
                "coordination.electors": "local",
                "generate.radius_m": 800.0,
            },
            FAULTS,
        ),
    ],
)
def test_zenoh_and_memory_give_the_same_digest(
    ranges: Mapping[str, Any], faults: tuple[Any, ...]
) -> None:
    scenario = load_scenario("converge", {"duration_s": 30.0, **ranges})
    scenario = msgspec.structs.replace(scenario, fault=faults)
    found = [
        run_fleet(RunOptions(scenario, bus=bus), lambda _: None).run_recorder.digest
        for bus in ("memory", "zenoh")
    ]
    assert found[0] == found[1] != ""


def test_who_is_stopped_listens_for_its_first_tick_from_where_it_was_stopped() -> None:
    """UAV 1 is at 125 m when it is stopped, and at 1250 m when it goes on; UAV 2 is there then."""
    fast = Uav(1, (0.0, 0.0, -300.0), 0.0, ((9000.0, 0.0, -300.0),))
    slow = Uav(2, (1000.0, 60.0, -360.0), 0.0, ((9000.0, 60.0, -360.0),), speed_mps=5.0)
    scenario = Scenario(
        "stopped",
        52.0,
        resolver="none",
        uav=(fast, slow),
        guidance=Guidance(climb_mps=1.0),
        resolution=Resolution(max_climb_mps=1.0, max_dive_mps=1.0),
        surveillance=Surveillance(range_m=300.0),
        fault=(Pause(node="1", start_s=5.0, end_s=50.0),),
    )
    flown = [run(scenario), run(scenario, bus="zenoh")]
    wanted = [round(t * S) for t in (50.2, 50.4, 50.6, 50.8, 51.0, 51.2, 51.4, 51.6, 51.8)]
    assert [heard(r, 1, 2, StateBroadcast.kind) for r in flown] == [wanted, wanted]
    assert heard(flown[0], 2, 1, StateBroadcast.kind) == [50 * S, *wanted]
    assert [f.name for f in check(flown[1]).findings if f.verdict == "invalid"] == []


def test_a_range_that_all_are_within_changes_nothing() -> None:
    plain = load_scenario("four_way", {"duration_s": 60.0})
    wide = load_scenario("four_way", {"duration_s": 60.0, "surveillance.range_m": 1e7})
    kept = [[m for m in run(s).messages() if isinstance(m, Election)] for s in (plain, wide)]
    assert kept[0] == kept[1] != []
