"""Wall clocks that are apart: found with a stated uncertainty from what receivers measured."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from itertools import permutations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.analysis.clock_offsets import (
    SIMULATION_CLOCK,
    WINDOW_NS,
    ClockAccount,
    ClockOffset,
    ClockOffsets,
    offset_between,
    offset_words,
)
from fleet.analysis.latency_bins import binned_quantiles_s
from fleet.analysis.tally import RunTally
from fleet.analysis.words import clock_text
from fleet.protocol.messages import DeliveryReport
from tests.conftest import Cli
from tests.rogue import listed_run, until
from tests.rogue_processes import AS_UAV, router

MS, S = 10**6, 10**9
TICK_NS = 100 * MS

fast = settings(deadline=None, derandomize=True, max_examples=200)
ways = st.integers(0, 5 * S)
shifts = st.integers(-3600 * S, 3600 * S)


def account(
    clocks: Mapping[int, int], way_ns: int = MS, *, at_ns: tuple[int, ...] = (0,)
) -> ClockAccount:
    """What is found where each participant's clock is ahead by so much, and all ways are equal."""
    found = ClockOffsets(TICK_NS)
    for t_ns in at_ns:
        for a, b in permutations(clocks, 2):
            found.add(a, b, t_ns, way_ns + clocks[b] - clocks[a])
    return found.account()


@fast
@given(shifts, st.lists(ways, min_size=1, max_size=9), st.lists(ways, min_size=1, max_size=9))
def test_the_estimate_is_within_its_uncertainty(
    shift_ns: int, there_ns: list[int], back_ns: list[int]
) -> None:
    """Whatever the ways there and back take; messages that are late make it no worse."""
    found = offset_between(min(there_ns) + shift_ns, min(back_ns) - shift_ns)
    assert abs(found.offset_ns - shift_ns) <= found.uncertainty_ns + 1
    assert found.uncertainty_ns <= (min(there_ns) + min(back_ns)) / 2 + 1


@fast
@given(shifts, ways)
def test_equal_ways_give_the_offset_itself(shift_ns: int, way_ns: int) -> None:
    found = offset_between(way_ns + shift_ns, way_ns - shift_ns)
    assert (found.offset_ns, found.uncertainty_ns) == (shift_ns, way_ns)


@fast
@given(shifts, shifts, ways)
def test_who_is_asked_makes_no_difference_but_the_sign(
    shift_ns: int, other_ns: int, way_ns: int
) -> None:
    clocks = {1: shift_ns, 2: other_ns, 3: 0}
    for named in (clocks, {-number: ahead_ns for number, ahead_ns in clocks.items()}):
        found = account(named, way_ns)
        assert found.reference is not None
        over_ns = named[found.reference]
        assert over_ns == sorted(named.values())[1]
        told = {uav: offset.offset_ns for uav, offset in found.offsets.items()}
        assert told == {uav: ahead_ns - over_ns for uav, ahead_ns in named.items()}


@pytest.mark.parametrize(
    ("shift_ns", "warned", "degraded"),
    [(0, False, False), (11 * MS, True, False), (-99 * MS, True, False), (-101 * MS, True, True)],
)
def test_a_tenth_of_a_tick_is_warned_of_and_a_tick_degrades(
    shift_ns: int, warned: bool, degraded: bool
) -> None:
    found = account({0: 0, 1: shift_ns, 2: 0})
    assert (found.warned, found.degraded) == (warned, degraded)
    assert bool(found.words()) == warned


def test_what_may_be_the_way_there_is_no_offset() -> None:
    """A link of 40 ms there and nothing back looks like clocks that are 20 ms apart, or not."""
    clocks = ClockOffsets(TICK_NS)
    clocks.add(1, 2, 0, 40 * MS)
    clocks.add(2, 1, 0, 1)
    found = clocks.account()
    assert found.offsets[2] == ClockOffset(19_999_999, 20_000_001)
    assert not found.warned


def test_the_one_whose_clock_is_wrong_is_named() -> None:
    found = account({0: 0, 1: 500 * MS, 2: 0, 3: -20 * MS})
    assert found.words() == (
        "clock of UAV 1: 0.5 s ahead (+-1 ms); clock of UAV 3: 0.02 s behind (+-1 ms)"
    )


def test_of_a_link_in_one_direction_nothing_is_known() -> None:
    clocks = ClockOffsets(TICK_NS)
    clocks.add(1, 2, 0, 500 * MS)
    found = clocks.account()
    assert (found.offsets, found.one_way, found.warned) == ({}, 1, False)


def test_of_whom_nothing_was_measured_nothing_is_claimed() -> None:
    clocks = ClockOffsets(TICK_NS, frozenset({0, 1, 2, 3}))
    clocks.add(1, 2, 0, MS)
    clocks.add(2, 1, 0, MS)
    told = clocks.account().record()
    assert told["unknown"] == (0, 3)
    assert clock_text(told).endswith("nothing is known of the coordinator's and that of UAV 3")


def test_ways_over_others_add_up_their_uncertainties() -> None:
    clocks = ClockOffsets(TICK_NS)
    for a, b in ((1, 2), (2, 3)):
        clocks.add(a, b, 0, 7 * MS)  # 5 ms ahead, 2 ms on the way
        clocks.add(b, a, 0, -3 * MS)
    found = clocks.account()
    assert found.reference == 2
    assert found.offsets[3] == ClockOffset(5 * MS, 2 * MS)
    assert found.offsets[1] == ClockOffset(-5 * MS, 2 * MS)


def test_a_clock_that_is_set_while_the_run_is_on_is_found() -> None:
    clocks = ClockOffsets(TICK_NS)
    for window in range(10):
        shift_ns = 300 * MS if window == 4 else 0
        for t_ns in (window * WINDOW_NS, window * WINDOW_NS + S):
            clocks.add(1, 2, t_ns, MS + shift_ns)
            clocks.add(2, 1, t_ns, MS - shift_ns)
    assert clocks.account().offsets[2] == ClockOffset(300 * MS, MS)


def test_messages_that_an_outage_held_up_make_no_offset() -> None:
    """A window in which all that came was seconds late tells little, and is not preferred."""
    clocks = ClockOffsets(TICK_NS)
    for window in range(5):
        late_ns = 3 * S if window == 2 else 0
        clocks.add(1, 2, window * WINDOW_NS, MS + late_ns)
        clocks.add(2, 1, window * WINDOW_NS, MS)
    assert clocks.account().offsets[2] == ClockOffset(0, MS)


def test_latency_is_corrected_by_the_offset_also_of_what_came_before_it_was_known() -> None:
    tally, shift_ns = RunTally(clocks=ClockOffsets(TICK_NS)), 500 * MS
    for receiver, src, transit_ns in ((2, 1, MS + shift_ns), (1, 2, MS - shift_ns)) * 2:
        one = (1, 2)
        tally.add(
            DeliveryReport(
                receiver, 0, 0, (src,) * 2, ("adsb",) * 2, one, (0, 0), one, ("received",) * 2,
                transit_ns=(transit_ns,) * 2, delay_ns=(0, 0), slip_ns=(0, 0),
            )
        )  # fmt: skip
    assert not tally.one_way
    assert tally.transits.total() == 8
    assert binned_quantiles_s(tally.transits) == {"p50": 0.001, "p99": 0.001, "max": 0.001}


def test_the_simulation_is_compared_by_asking_and_is_no_reference() -> None:
    """Its clock is 500 ms ahead of two right ones; an answer is on its way for 1 ms, then 3 ms."""
    clocks = ClockOffsets(TICK_NS, frozenset((1, 2)))
    for uav, told_ns in ((1, 1 * MS), (2, 1 * MS)):
        clocks.add_answer(uav, 0, 500 * MS, told_ns, 504 * MS)
    account = clocks.account()
    assert account.reference in (1, 2)
    assert account.offsets[SIMULATION_CLOCK] == ClockOffset(501 * MS, 2 * MS)
    assert (account.unknown, account.degraded) == ((), True)
    told = account.record()
    assert told["simulation"]["offset_s"] == 0.501
    assert [row["id"] for row in told["offsets"]] == [1, 2]
    assert "clock of the simulation: 0.501 s ahead (+-2 ms)" in told["words"]


def test_a_shifted_clock_of_the_simulation_is_found_and_told(cli: Cli) -> None:
    shifted = SHIFTED.format(0.5) + "; from fleet.entry import start; start()"
    options = ("--clock", "realtime", "--duration", "2", "--external", "--json")
    endpoint = router(cli)
    joins = ("--connect", endpoint)
    run = cli.command(sys.executable, "-c", shifted, "run", "head_on", *options, *joins)
    others = [cli.start(*role, *joins) for role in (("uav", "1-2"), ("coordinator",))]
    out, error = run.communicate(timeout=60)
    assert run.returncode == 0, error
    clocks = json.loads(out)["clocks"]
    assert clocks["simulation"]["offset_s"] == pytest.approx(0.5, abs=0.05)
    assert (clocks["warned"], clocks["degraded"]) == (True, True)
    assert all(other.wait(timeout=30) == 0 for other in others)


def test_an_offset_is_told_with_its_side() -> None:
    assert offset_words(ClockOffset(-52 * MS, 400_000)) == "0.052 s behind (+-0.4 ms)"


SHIFTS_S = {1: 0.05, 2: 0.5, 3: 5.0}
"""By how much clocks of UAVs are ahead; those of three others are right."""
SHIFTED = "import time; now = time.time_ns; time.time_ns = lambda: now() + round({} * 10**9)"


def test_shifted_clocks_of_real_processes_are_found_and_told(cli: Cli) -> None:
    endpoint = router(cli)
    runtime = {"XDG_RUNTIME_DIR": str(cli.folder)}
    scenario = ("converge", "--set", "generate.count=5", "--duration", "8")
    where = ("--connect", endpoint, "--clock", "realtime", "--external")
    run = cli.start("run", *scenario, *where, "--out", "run.mcap", "--json", **runtime)
    name, _ = until(lambda: listed_run(cli.folder), run)
    joins = ("--connect", endpoint, "--run", name)
    cli.start("coordinator", *joins)
    for uav in range(1, 6):
        shifted = SHIFTED.format(SHIFTS_S.get(uav, 0.0))
        cli.command(sys.executable, "-c", shifted + AS_UAV, "uav", str(uav), *joins)
    out, error = run.communicate(timeout=100)
    assert run.returncode == 0, error
    clocks = json.loads(out)["clocks"]
    found = {row["id"]: row["offset_s"] for row in clocks["offsets"]}
    for uav, shift_s in SHIFTS_S.items():
        assert found[uav] == pytest.approx(shift_s, rel=0.1)
    assert (clocks["warned"], clocks["degraded"]) == (True, True)
    assert json.loads(out)["zenoh_latency_s"]["p50"] < 0.03
    told = cli.run("info", "run.mcap").stdout
    assert "UAV 3: 5 s" in told or "UAV 3: 4.99" in told, told
    checked = cli.run("check", "run.mcap")
    assert "clock of UAV 2" in checked.stderr
    assert checked.returncode == 2, checked.stdout
