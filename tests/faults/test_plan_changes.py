"""A fault plan that is changed while a run is on: what was asked is what was flown, and repeats."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.navigation import Navigation
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.slow import Slow
from fleet.faults.rules import Rule
from fleet.protocol.topics import FAULT
from fleet.simulation.active_runs import active_runs
from fleet.simulation.fault_control import FaultAnswer, FaultRequest, amended
from fleet.simulation.in_memory import run_in_memory
from fleet.transport.run_search import ask
from tests.conftest import Cli, KeepingRecorder
from tests.faults.near_four_way import arguments, near, run, with_plan
from tests.simulation.test_simulation import until
from tests.support.samples import S

TICK_NS = read_scenario("four_way").scenario.tick_ns

Requests = dict[int, FaultRequest]
"""What the operator asks for, by tick."""


def changed_on_the_way(
    scenario: Scenario, requests: Requests
) -> tuple[KeepingRecorder, tuple[Rule, ...]]:
    """A run in memory whose plan is changed while it is on, and its plan at the end."""
    run_recorder, plans = KeepingRecorder(scenario), [scenario.fault]

    def new_plan(plan: tuple[Rule, ...], tick: int) -> tuple[Rule, ...] | None:
        if tick not in requests:
            return None
        plans.append(amended(plan, requests[tick], tick * scenario.tick_ns))
        return plans[-1]

    for _ in run_in_memory(scenario, run_recorder, new_plan):
        pass
    return run_recorder, plans[-1]


moments = st.integers(0, 40).map(lambda n: n / 10.0)


def windowed(make: Callable[..., Rule], **parts: Any) -> st.SearchStrategy[Rule]:
    def build(start_s: float, length_s: float | None, given: dict[str, Any]) -> Rule:
        end_s = None if length_s is None else start_s + length_s
        return make(start_s=start_s, end_s=end_s, **given)

    return st.builds(build, moments, st.none() | moments, st.fixed_dictionaries(parts))


who = st.sampled_from(["coordinator", "1", "2", "*"])
some_rules = st.lists(
    st.one_of(
        windowed(Loss, probability=st.just(0.4)),
        windowed(Burst, loss=st.just(0.4), mean_ticks=st.just(4.0)),
        windowed(Rate, bits_per_s=st.just(20_000.0), queue=st.integers(0, 3)),
        windowed(ClockError, node=who, offset_s=st.just(0.3), drift_ppm=st.just(5e4)),
        windowed(Navigation, node=st.just("1"), freeze=st.booleans(), noise_m=st.just(5.0)),
        windowed(Kill, node=who),
        windowed(Pause, node=who),
        windowed(Slow, node=who, factor=st.integers(2, 4)),
    ),
    max_size=3,
)
stories = st.dictionaries(
    st.integers(1, 40),
    st.builds(lambda rules, clear: FaultRequest(tuple(rules), clear), some_rules, st.booleans()),
    max_size=3,
)


@given(some_rules, stories)
@settings(deadline=None, derandomize=True, max_examples=30)
def test_the_plan_at_the_end_flown_from_the_start_repeats_all_changes(
    first: list[Rule], requests: Requests
) -> None:
    near_s = ["uav.2.position_ned_m=[0, 600, -300]", "duration_s=5"]
    scenario = with_plan(read_scenario("head_on", near_s).scenario, *first)
    changed, plan = changed_on_the_way(scenario, requests)
    assert run(with_plan(scenario, *plan)).digest == changed.digest


@given(some_rules, stories)
@settings(deadline=None, derandomize=True, max_examples=200)
def test_a_request_only_adds_rules_and_ends_others_from_now_on(
    first: list[Rule], requests: Requests
) -> None:
    plan: tuple[Rule, ...] = tuple(first)
    for tick, request in sorted(requests.items()):
        now_ns = tick * TICK_NS
        new = amended(plan, request, now_ns)
        assert len(new) == len(plan) + len(request.rules)
        for t_ns in range(0, 10 * S, TICK_NS):
            for old, rule in zip(plan, new, strict=False):
                ended = request.clear and t_ns >= now_ns
                assert rule.during(t_ns) == (old.during(t_ns) and not ended)
            if t_ns < now_ns:
                assert not any(rule.during(t_ns) for rule in new[len(plan) :])
        for asked, rule in zip(request.rules, new[len(plan) :], strict=True):
            assert rule.start_s == pytest.approx(max(asked.start_s, now_ns / S))
            if asked.end_s is None:
                assert rule.end_s is None
            else:
                assert rule.end_s is not None
                assert rule.end_s - rule.start_s == pytest.approx(asked.end_s - asked.start_s)
        plan = new


def request(run_of: tuple[str, str], rules: Sequence[Rule], *, clear: bool = False) -> FaultAnswer:
    payload = msgspec.json.encode(FaultRequest(tuple(rules), clear))
    answer = ask(*run_of, FAULT, payload, 30.0)
    assert answer is not None
    return msgspec.json.decode(answer, type=FaultAnswer)


def test_a_running_fleet_takes_requests_and_its_last_plan_repeats_it(
    cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(cli.folder))
    fleet = cli.start(*arguments(20.0, {"latency": ["150ms"]}), "--speed", "5")
    until(lambda: len(active_runs()) == 1)
    (listing,) = active_runs()
    where = (listing.endpoint, listing.run)
    kill = Kill(node="1", end_s=3.0)
    first = request(where, [kill, Loss(probability=0.3)])
    assert not first.problem
    assert [r.name for r in first.plan] == ["latency", "kill", "loss"]
    assert first.plan[1].start_s == first.t_s == pytest.approx(first.tick * 0.1)
    refused = request(where, [Kill(node="9")])
    assert "names nobody" in refused.problem
    assert refused.plan == ()
    malformed = ask(*where, FAULT, b"{", 30.0)
    assert malformed is not None
    assert msgspec.json.decode(malformed, type=FaultAnswer).problem
    second = request(where, [Pause(node="2,coordinator", end_s=1.0)], clear=True)
    assert second.tick > first.tick
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 0, err
    assert json.loads(out)["digest"] == run(with_plan(near(20.0), *second.plan)).digest
    assert active_runs() == []
