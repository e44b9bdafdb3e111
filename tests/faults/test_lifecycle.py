"""The lifecycle schedule: who is up, held or down in each tick, by the plan alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.slow import Slow
from fleet.faults.lifecycle import DOWN, HELD, UP, LifecycleChange, LifecycleSchedule
from fleet.faults.rules import Rule
from fleet.simulation.fault_control import FaultRequest, amended

TICK_NS = 100_000_000
NODES = (0, 1, 2, 3)
TICKS = 40
fast = settings(deadline=None, derandomize=True, max_examples=200)

whom = st.sampled_from(["*", "uav", "coordinator", "1", "2-3", "coordinator,2"])
starts_s = st.integers(0, 400).map(lambda n: n / 100.0)
windows = st.tuples(starts_s, st.none() | st.integers(0, 250).map(lambda n: n / 100.0))


def window(at: tuple[float, float | None]) -> dict[str, Any]:
    start_s, length_s = at
    return {"start_s": start_s, "end_s": None if length_s is None else start_s + length_s}


kills = st.builds(
    lambda n, at, then: Kill(node=n, then=then, **window(at)),
    whom,
    windows,
    st.sampled_from(["straight", "vanish"]),
)
pauses = st.builds(lambda n, at: Pause(node=n, **window(at)), whom, windows)
slows = st.builds(
    lambda n, at, factor: Slow(node=n, factor=factor, **window(at)),
    whom,
    windows,
    st.integers(2, 5),
)
links = st.just(Loss(probability=0.5))
plans = st.lists(st.one_of(kills, pauses, slows, links), max_size=4)


def schedule(*plan: Rule) -> LifecycleSchedule:
    return LifecycleSchedule(NODES, plan, TICK_NS)


def presence(of: LifecycleSchedule) -> dict[int, str]:
    assert not set(of.held) & set(of.down)
    return {n: DOWN if n in of.down else HELD if n in of.held else UP for n in of.nodes}


def through(made: LifecycleSchedule, last: int, first: int = 0) -> list[dict[int, str]]:
    """Presence in each tick from `first` to `last`."""
    found = []
    for tick in range(first, last + 1):
        made.advance(tick)
        found.append(presence(made))
    return found


def expected(plan: Sequence[Rule], node: int, tick: int) -> str:
    """What the documents say."""
    if tick == 0:
        return UP
    t_ns = tick * TICK_NS
    held = False
    for rule in plan:
        if isinstance(rule, Loss) or not rule.during(t_ns):
            continue
        assert isinstance(rule, Kill | Pause | Slow)
        if not rule.hits(node):
            continue
        if isinstance(rule, Kill):
            return DOWN
        if isinstance(rule, Pause):
            held = True
        if isinstance(rule, Slow):
            within = [k for k in range(tick + 1) if rule.during(k * TICK_NS)]
            held |= within.index(tick) % rule.factor > 0
    return HELD if held else UP


@given(plans)
@fast
def test_presence_is_a_function_of_plan_and_tick(plan: list[Rule]) -> None:
    """And not of the ticks before, however many of them there were."""
    for tick, found in enumerate(through(schedule(*plan), TICKS)):
        assert found == {n: expected(plan, n, tick) for n in NODES}
        at_once = schedule(*plan)
        at_once.advance(tick)
        assert presence(at_once) == found


@given(plans)
@fast
def test_everybody_is_up_in_the_first_tick(plan: list[Rule]) -> None:
    made = schedule(*plan)
    assert made.advance(0) == []
    assert set(presence(made).values()) == {UP}


@given(plans)
@fast
def test_changes_are_such_as_a_process_can_go_through_and_lead_to_its_presence(
    plan: list[Rule],
) -> None:
    """Only what runs is stopped, only what is stopped goes on, only the dead start again."""
    made = schedule(*plan)
    state = dict.fromkeys(NODES, UP)
    deaths, births = dict.fromkeys(NODES, 0), dict.fromkeys(NODES, 0)
    allowed = {
        "kill": ({UP, HELD}, DOWN),
        "restart": ({DOWN}, UP),
        "stop": ({UP}, HELD),
        "continue": ({HELD}, UP),
    }
    for tick in range(TICKS + 1):
        changes = made.advance(tick)
        assert [c.node for c in changes] == sorted(c.node for c in changes)
        for change in changes:
            before, after = allowed[change.action]
            assert state[change.node] in before
            state[change.node] = after
            deaths[change.node] += change.action == "kill"
            births[change.node] += change.action == "restart"
            assert deaths[change.node] - births[change.node] == (state[change.node] == DOWN)
        assert state == presence(made)
        assert {n: made.incarnation(n) for n in NODES} == births


@given(plans, plans, st.booleans(), st.integers(1, TICKS))
@fast
def test_a_plan_that_is_changed_on_the_way_is_the_amended_plan_from_the_start(
    plan: list[Rule], more: list[Rule], clear: bool, change: int
) -> None:
    other = amended(plan, FaultRequest(tuple(more), clear), change * TICK_NS)
    made = schedule(*plan)
    found = through(made, change - 1)
    made.replan(other)
    found += through(made, TICKS, change)
    assert found == through(schedule(*other), TICKS)
    for tick, now in enumerate(found):
        by = plan if tick < change else other
        assert now == {n: expected(by, n, tick) for n in NODES}


@given(plans)
@fast
def test_who_vanishes_is_dead_and_killed_so(plan: list[Rule]) -> None:
    made = schedule(*plan)
    for tick in range(1, TICKS + 1):
        made.advance(tick)
        for node in made.down:
            thens = {
                r.then
                for r in plan
                if isinstance(r, Kill) and r.hits(node) and r.during(tick * TICK_NS)
            }
            assert made.vanishes(node, tick) == ("vanish" in thens)


def test_a_kill_lasts_for_ever_or_until_the_process_starts_again() -> None:
    made = schedule(Kill(node="1", start_s=1.0), Kill(node="2", start_s=1.0, end_s=2.0))
    happened = {t: c for t in range(TICKS + 1) if (c := made.advance(t))}
    assert happened == {
        10: [LifecycleChange(1, "kill"), LifecycleChange(2, "kill")],
        20: [LifecycleChange(2, "restart")],
    }
    assert (made.incarnation(1), made.incarnation(2), made.incarnation(3)) == (0, 1, 0)
    assert made.down == (1,)


def test_each_restart_is_another_incarnation() -> None:
    kills = [Kill(node="1", start_s=s, end_s=s + 0.5) for s in (1.0, 2.0, 3.0)]
    made = schedule(*kills)
    incarnations = []
    for tick in range(TICKS + 1):
        made.advance(tick)
        incarnations.append(made.incarnation(1))
    assert [incarnations[t] for t in (0, 14, 15, 24, 25, 34, 35, 40)] == [0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize("kill_first", [True, False])
def test_a_kill_wins_over_a_pause_and_who_returns_into_it_is_stopped(kill_first: bool) -> None:
    plan = [Kill(node="1", start_s=1.0, end_s=2.0), Pause(node="1", start_s=0.5, end_s=3.0)]
    made = schedule(*(plan if kill_first else plan[::-1]))
    happened = {t: [x.action for x in c] for t in range(TICKS + 1) if (c := made.advance(t))}
    assert happened == {5: ["stop"], 10: ["kill"], 20: ["restart", "stop"], 30: ["continue"]}


@pytest.mark.parametrize("factor", [2, 4])
def test_who_is_slow_steps_in_every_so_many_th_tick_from_the_first(factor: int) -> None:
    made = schedule(Slow(node="1", factor=factor, start_s=0.95, end_s=2.5))
    up = [t for t, now in enumerate(through(made, TICKS)) if now[1] == UP]
    assert up == [*range(10), *range(10, 25, factor), *range(25, TICKS + 1)]


def test_others_are_not_touched() -> None:
    made = schedule(Kill(node="2", start_s=1.0), Pause(node="coordinator", start_s=1.0))
    (*_, last) = through(made, TICKS)
    assert last == {0: HELD, 1: UP, 2: DOWN, 3: UP}
