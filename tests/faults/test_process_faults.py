"""Processes that are killed, stopped and slowed: the same on both buses, survived, never hidden."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.config.loading import read_scenario, with_faults
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
from fleet.faults.shorthand import rules_of
from fleet.log.reader import summarise
from fleet.model.election import Terms
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol.messages import Ack, Command, Election, Message, StateBroadcast, Truth
from fleet.protocol.topics import FAULT, topic_of
from fleet.simulation.active_runs import active_runs
from fleet.simulation.fault_control import FaultAnswer, FaultRequest, amended
from fleet.simulation.in_memory import run_in_memory
from fleet.transport.run_search import ask
from tests.conftest import Cli, KeepingRecorder, truths
from tests.simulation.test_simulation import LONG, flying, participants, result, until
from tests.support.samples import S

FAR_M = 1200
NEAR = tuple(
    f"uav.{uav}.position_ned_m=[{north}, {east}, -300]"
    for uav, (north, east) in enumerate([(0, -FAR_M), (0, FAR_M), (FAR_M, 0), (-FAR_M, 0)], start=1)
)
"""`four_way` begun when all are in conflict already; they lose separation after 32 s."""
UAVS = (1, 2, 3, 4)

Texts = dict[str, list[str]]


def near(duration_s: float, faults: Texts | None = None, *more: str) -> Scenario:
    """The scenario as the command line makes it."""
    loaded = read_scenario("four_way", (*NEAR, f"duration_s={duration_s}", *more)).scenario
    return with_faults(loaded, rules_of(faults or {}, 0.2), "four_way")


def with_plan(scenario: Scenario, *plan: Rule) -> Scenario:
    return msgspec.structs.replace(scenario, fault=plan)


def run(scenario: Scenario) -> KeepingRecorder:
    """In memory, with all that was said."""
    run_recorder = KeepingRecorder(scenario)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return run_recorder


def arguments(duration_s: float, faults: Texts) -> list[str]:
    """The same for the command line."""
    out = ["run", "four_way", "--duration", str(duration_s), "--json"]
    for setting in NEAR:
        out += ["--set", setting]
    for name, texts in faults.items():
        for text in texts:
            out += [f"--{name}", text]
    return out


def elections(run_recorder: KeepingRecorder) -> list[Election]:
    return [m for m in run_recorder.kept if isinstance(m, Election)]


# The same on both buses


BOTH: list[tuple[str, float, Texts]] = [
    ("kills", 10.0, {"kill": ["1@2s+3s", "4@3s", "3@0.1s+0.1s"]}),
    ("coordinator", 12.0, {"kill": ["coordinator@2s+5s"], "pause": ["coordinator@9s+1s"]}),
    ("pauses", 10.0, {"pause": ["2@2s+2s", "1@3s+3s", "4@9s"]}),
    ("slow", 10.0, {"slow": ["3:3@1s+4s", "coordinator:2@3s", "1:5"]}),
    (
        "all at once, on bad links",
        12.0,
        {
            "latency": ["150ms"],
            "loss": ["10%"],
            "clock-offset": ["2:300ms"],
            "kill": ["1@3s+2s", "coordinator@1s+6s", "2@4s+1s"],
            "pause": ["1@2s+5s", "*@8s+0.5s"],
            "slow": ["3:2@2s"],
        },
    ),
]


@pytest.mark.parametrize(("duration_s", "faults"), [b[1:] for b in BOTH], ids=[b[0] for b in BOTH])
def test_process_faults_give_the_same_digest_on_both_buses(
    cli: Cli, duration_s: float, faults: Texts
) -> None:
    memory = run(near(duration_s, faults))
    told = result(cli.run(*arguments(duration_s, faults)))
    assert told["digest"] == memory.digest
    assert told["messages"] == dict(sorted(memory.messages.items()))


def test_who_vanishes_does_so_on_both_buses(cli: Cli, tmp_path: Path) -> None:
    text = read_scenario("head_on").text
    path = tmp_path / "vanish.toml"
    path.write_text(f'{text}\n[[fault]]\nkind = "kill"\nnode = "2"\nthen = "vanish"\nstart_s = 3\n')
    memory = run(read_scenario(str(path), ["duration_s=6"]).scenario)
    told = result(cli.run("run", str(path), "--duration", "6", "--json"))
    assert told["digest"] == memory.digest
    assert max(m.t_ns for m in truths(memory, 2)) == 2900 * 10**6
    assert max(m.t_ns for m in truths(memory, 1)) == 6 * S
    assert memory.separation.minima()[0].t_s == 2.9  # they approach


# What is done to real processes


def start(cli: Cli, log: Path, *faults: str, speed: str = "4") -> subprocess.Popen[str]:
    """A run at a pace at which its processes can be watched; 0 is as fast as it goes."""
    pace = ("--duration", LONG if speed == "0" else "12", "--speed", speed)
    return cli.start("run", "head_on", *pace, "--out", str(log), "--json", *faults)


def state_of(pid: int) -> str:
    """State of a process, as Linux has it; empty if there is none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except OSError:
        return ""
    return stat.rpartition(") ")[2][0]


def test_a_killed_process_is_gone_and_a_new_one_comes(cli: Cli, tmp_path: Path) -> None:
    fleet = start(cli, tmp_path / "log.mcap", "--kill", "2@3s+4s")
    until(lambda: len(participants(cli, fleet)) == 3)
    first = participants(cli, fleet)
    until(lambda: len(participants(cli, fleet)) == 2)
    (gone,) = set(first) - set(participants(cli, fleet))
    assert gone == first[-1]  # they are started in order of number
    assert state_of(gone) in ("", "Z")
    until(lambda: len(participants(cli, fleet)) == 3)
    (new,) = set(participants(cli, fleet)) - set(first)
    assert new != gone
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 0, err
    assert json.loads(out)["messages"]["truth"] == 2 * 121


def test_a_stopped_process_is_stopped_and_goes_on(cli: Cli, tmp_path: Path) -> None:
    fleet = start(cli, tmp_path / "log.mcap", "--pause", "1@3s+4s")
    until(lambda: len(participants(cli, fleet)) == 3)
    coordinator, one, two = participants(cli, fleet)
    until(lambda: state_of(one) == "T")
    assert "T" not in (state_of(coordinator), state_of(two))
    out, err = fleet.communicate(timeout=60)
    assert fleet.returncode == 0, err
    assert json.loads(out)["status"] == "complete"


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGSTOP])
def test_what_the_plan_does_not_say_still_makes_the_run_invalid(
    cli: Cli, tmp_path: Path, sent: signal.Signals
) -> None:
    """While another process is held by the plan, and one has been started again."""
    log = tmp_path / "log.mcap"
    faults = ("--pause", "coordinator@30s", "--kill", "2@1s+1s")
    fleet = start(cli, log, *faults, speed="0")
    until(lambda: flying(cli, fleet, log))
    until(lambda: "T" in {state_of(pid) for pid in participants(cli, fleet)})
    os.kill(participants(cli, fleet)[-1], sent)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 1
    assert "INVALID" in err
    assert "process 2" in err
    assert ("killed by SIGKILL" if sent is signal.SIGKILL else "has been stopped") in err
    until(lambda: cli.members(fleet) == [])
    assert summarise(log).metadata["result"]["status"] == "invalid"


def test_the_death_of_a_process_that_the_plan_has_stopped_makes_the_run_invalid(
    cli: Cli, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    fleet = start(cli, log, "--pause", "1@10s", speed="0")
    until(lambda: flying(cli, fleet, log))
    one = participants(cli, fleet)[1]
    until(lambda: state_of(one) == "T")
    os.kill(one, signal.SIGKILL)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 1
    assert "process 1 ended early (killed by SIGKILL)" in err


def test_an_interrupted_run_leaves_no_stopped_process(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    fleet = start(cli, log, "--pause", "*@10s", speed="1")
    until(lambda: len(participants(cli, fleet)) == 3)
    os.killpg(fleet.pid, signal.SIGTERM)
    _, err = fleet.communicate(timeout=30)
    assert fleet.returncode == 130, err
    until(lambda: cli.members(fleet) == [])


def test_one_that_is_started_again_too_late_to_fly_does_not_spoil_a_realtime_run(
    cli: Cli, tmp_path: Path
) -> None:
    """What it sent before it was killed is its own, and it is ready when all is over."""
    log = tmp_path / "log.mcap"
    pace = ("--clock", "realtime", "--duration", "1", "--kill", "1@0.5s+0.5s")
    short = ("--set", "tick_s=0.01")  # it is not ready by the end of the last one
    told = result(cli.run("run", "head_on", *pace, *short, "--json", "--out", str(log)))
    assert (told["status"], told["rejected"]) == ("complete", [])
    checked = json.loads(cli.run("check", str(log), "--json").stdout)["logs"][0]
    (own,) = [i for i in checked["invariants"] if i["name"] == "sent by its issuer"]
    assert own["verdict"] == "valid"


# The aircraft


def test_the_aircraft_of_a_killed_process_flies_on_straight_and_level() -> None:
    """Killed in a turn, a climb and on its plan: what it was told is not flown any more."""
    kill_s = 6.0
    flown = run(near(20.0))
    modes = {uav: truths(flown, uav)[60].mode for uav in UAVS}
    assert len(set(modes.values())) >= 3
    for uav in UAVS:
        killed = run(near(20.0, {"kill": [f"{uav}@{kill_s}s"]}))
        found = truths(killed, uav)
        assert [m.mode for m in found[60:]] == 141 * ["unmanned"]
        assert found[:60] == truths(flown, uav)[:60]
        last = found[59]
        assert all(m.heading_rad == pytest.approx(last.heading_rad) for m in found[60:])
        assert {m.commanded_climb_mps for m in found[60:]} == {0.0}
        level = found[120:]
        assert level[-1].position_ned_m[2] == pytest.approx(level[0].position_ned_m[2], abs=0.1)
        assert all(m.speed_mps == pytest.approx(25.0) for m in found)
        moved = math.dist(level[0].position_ned_m, level[-1].position_ned_m)
        assert moved == pytest.approx(25.0 * (level[-1].t_ns - level[0].t_ns) / S, rel=1e-3)
        assert not any(m.kind == "adsb" and m.id == uav and m.t_ns >= 6 * S for m in killed.kept)


def test_the_aircraft_of_a_stopped_process_holds_its_last_command() -> None:
    paused = run(near(20.0, {"pause": ["2@6s+4s"]}))
    found = truths(paused, 2)
    assert [m.mode for m in found[60:100]] == 40 * ["held"]
    before = found[59]
    told = (before.commanded_heading_rad, before.commanded_climb_mps)
    assert {(m.commanded_heading_rad, m.commanded_climb_mps) for m in found[60:100]} == {told}
    assert "held" not in {m.mode for m in (*found[:60], *found[100:])}
    own = [m for m in paused.kept if m.id == 2 and not isinstance(m, Truth)]
    assert not [m for m in own if 6 * S <= m.t_ns < 10 * S and not isinstance(m, Ack)]


@pytest.mark.parametrize(
    "faults",
    [
        {"kill": ["2@3s+4s", "2@9s+2s", "1@4s+1s"]},
        {"pause": ["2@3s+4s", "1@4s+3s"]},
        {"slow": ["*:3@2s"]},
        {"pause": ["2@3s+4s"], "kill": ["2@5s+4s"], "slow": ["2:4@8s+4s"]},
    ],
)
def test_an_aircraft_is_somewhere_in_every_tick_and_never_jumps(faults: Texts) -> None:
    run_recorder = run(near(15.0, faults))
    for uav in UAVS:
        found = truths(run_recorder, uav)
        assert [m.t_ns for m in found] == [n * 10**8 for n in range(151)]
        assert [m.seq for m in found] == list(range(151))
        for one, two in pairwise(found):
            moved = math.dist(one.position_ned_m, two.position_ned_m)
            assert moved == pytest.approx(2.5, rel=0.01)
            turned = math.remainder(two.heading_rad - one.heading_rad, math.tau)
            assert abs(turned) < 0.03


@pytest.mark.parametrize("faults", [b[2] for b in BOTH], ids=[b[0] for b in BOTH])
def test_nothing_is_ever_numbered_twice(faults: Texts) -> None:
    """Neither messages nor commands, however often a process is started again."""
    run_recorder = run(
        near(20.0, faults | {"kill": [*faults.get("kill", []), "1@12s+1s", "1@14s+1s"]})
    )
    told: dict[tuple[str, int], Message] = {}
    for message in run_recorder.kept:
        assert told.setdefault((topic_of(message), message.seq), message) is message
    issued: dict[tuple[int, int, int], Command] = {}
    for message in run_recorder.kept:
        if isinstance(message, Command):
            plain = msgspec.structs.replace(message, seq=0, t_ns=0)
            assert issued.setdefault((plain.term, plain.id, plain.number), plain) == plain


def test_a_process_that_is_started_again_knows_only_what_it_remembers() -> None:
    run_recorder = run(near(20.0, {"kill": ["2@3s+2s"]}))
    broadcasts = [m for m in run_recorder.kept if isinstance(m, StateBroadcast) and m.id == 2]
    before = [m for m in broadcasts if m.t_ns < 3 * S][-1]
    after = next(m for m in broadcasts if m.t_ns >= 5 * S)
    assert (before.manoeuvre != "", after.manoeuvre) == (True, "")
    assert before.mandate_valid
    assert not after.mandate_valid
    assert after.mandate_term == before.mandate_term > 0
    assert after.highest_term == before.highest_term > 0
    assert after.seq == 10**9
    again = [m for m in run_recorder.kept if isinstance(m, Ack) and m.id == 2 and m.t_ns >= 5 * S]
    assert any(m.accepted for m in again)


# Survival


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


# Live changes


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
