"""A fault plan that was not carried out is found: each kind of rule, ignored or made up."""

from __future__ import annotations

import random
from dataclasses import replace
from functools import cache

import msgspec
import pytest

from fleet.analysis.invariants import RecordedRun, Verdict, Verdicts, check
from fleet.analysis.invariants.absences import Absent
from fleet.analysis.invariants.fates import fates_of
from fleet.analysis.invariants.index import Index
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.scenario import Surveillance
from fleet.faults import registry
from fleet.faults.clock import ClockRule
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.clock import ClockError as WrongClock
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.navigation import Navigation
from fleet.faults.kinds.partition import Partition
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.reorder import Reorder
from fleet.faults.kinds.replay import Replay
from fleet.faults.kinds.slow import Slow
from fleet.faults.lifecycle import ProcessRule
from fleet.faults.links import LinkRule
from fleet.faults.registry import kinds
from fleet.faults.rules import Rule
from fleet.faults.sensors import SensorRule
from fleet.log.reader import Record
from fleet.protocol import codec
from fleet.protocol.messages import Clock, StateBroadcast
from fleet.protocol.topics import CLOCK
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from tests.analysis.test_check_story import RecordedRunBuilder, apart
from tests.support.mutants import meeting
from tests.support.samples import S, heartbeat

APPLIED = "fault plan applied"
PROCESSES, POSITIONS, CLOCKS = "processes as planned", "positions as sensed", "clocks as planned"

SAMPLES: dict[str, tuple[str, tuple[Rule, ...]]] = {
    "latency": (APPLIED, (Latency(base_s=0.5), Latency(classes="cmd", base_s=0.5))),
    "loss": (APPLIED, (Loss(probability=0.3),)),
    "burst": (APPLIED, (Burst(loss=0.3),)),
    "range": (APPLIED, (Range(max_m=900.0),)),
    "partition": (APPLIED, (Partition(groups="1/2", start_s=2.0, end_s=4.0),)),
    "duplicate": (
        APPLIED,
        (Duplicate(probability=0.5), Duplicate(classes="cmd", probability=1.0, delay_s=1.0)),
    ),
    "replay": (APPLIED, (Replay(probability=0.3, delay_s=2.0),)),
    "reorder": (APPLIED, (Reorder(probability=0.3),)),
    "corrupt": (
        APPLIED,
        (Corrupt(probability=0.2), Corrupt(probability=0.2, frame_check=False)),
    ),
    "rate": (APPLIED, (Rate(bits_per_s=20_000.0, queue=3),)),
    "clock": (
        CLOCKS,
        (
            WrongClock(node="1", offset_s=0.001),
            WrongClock(node="coordinator", offset_s=1.0),
            WrongClock(node="uav", drift_ppm=100.0, start_s=2.0),
        ),
    ),
    "navigation": (
        POSITIONS,
        (
            Navigation(node="1", noise_m=5.0),
            Navigation(node="1", vertical_noise_m=5.0),
            Navigation(node="1", velocity_noise_mps=1.0),
            Navigation(node="1", bias_ned_m=(300.0, 0.0, 0.0)),
            Navigation(node="1", drift_ned_mps=(0.0, 0.1, 0.0)),
            Navigation(node="1", freeze=True, start_s=2.0, end_s=3.0),
            Navigation(node="1", dropout=0.5),
        ),
    ),
    "kill": (
        PROCESSES,
        (
            Kill(node="1", start_s=2.0),
            Kill(node="coordinator", start_s=2.0, end_s=2.1),
            Kill(node="1", start_s=2.0, then="vanish"),
        ),
    ),
    "pause": (PROCESSES, (Pause(node="1", start_s=2.0, end_s=3.0),)),
    "slow": (PROCESSES, (Slow(node="1", factor=4), Slow(node="coordinator", factor=2))),
}
"""Rules of each kind, and the invariant that finds that they were ignored."""

FINDS: dict[type[Rule], str] = {
    LinkRule: APPLIED,
    ProcessRule: PROCESSES,
    SensorRule: POSITIONS,
    ClockRule: CLOCKS,
}


def sampled(kind: str) -> tuple[str, tuple[Rule, ...]]:
    """The sample of a kind; of one that has none here a rule as random cases have it."""
    if kind in SAMPLES:
        return SAMPLES[kind]
    (name,) = [FINDS[group] for group in FINDS if issubclass(kinds()[kind], group)]
    keys = kinds()[kind].fuzzed(random.Random(1), [1, 2, 3])
    node = {} if name == APPLIED else {"node": "1", "start_s": 2.0}
    return name, (msgspec.convert({"kind": kind, **node, **keys}, registry.FaultRule),)


KINDS = [(kind, n) for kind in kinds() for n in range(len(sampled(kind)[1]))]
each = pytest.mark.parametrize(("kind", "n"), KINDS)


@cache
def flown(*plan: Rule) -> RecordedRun:
    """A run under a plan, and what it left behind."""
    scenario, records = meeting(*plan, duration_s=5.0), RecordCollector()
    run_recorder = RunRecorder(scenario, records)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    return RecordedRun.of_records(scenario, records.kept, plan=plan, digest=run_recorder.digest)


def on_wall_clocks(recorded_run: RecordedRun) -> RecordedRun:
    """The same as if it had been flown in realtime."""
    return replace(
        recorded_run, about=msgspec.structs.replace(recorded_run.about, clock="realtime")
    )


def claimed(recorded_run: RecordedRun, *plan: Rule) -> Verdicts:
    """The verdicts if the run had been flown under another plan."""
    scenario = msgspec.structs.replace(recorded_run.scenario, fault=plan)
    about = msgspec.structs.replace(recorded_run.about, scenario=scenario)
    return check(replace(recorded_run, about=about, plan=plan))


@each
def test_a_rule_that_everybody_ignored_is_found(kind: str, n: int) -> None:
    name, rules = sampled(kind)
    verdicts = claimed(flown(), rules[n])
    assert verdicts.overall is Verdict.INVALID
    assert name in verdicts.broken
    assert verdicts.of(name).witnesses


@each
def test_a_fault_without_a_rule_is_found(kind: str, n: int) -> None:
    _, rules = sampled(kind)
    assert check(flown(rules[n])).broken == ()
    assert claimed(flown(rules[n])).overall is Verdict.INVALID


def test_without_faults_all_is_told_as_it_is() -> None:
    verdicts = check(flown())
    assert verdicts.broken == ()
    assert verdicts.of(PROCESSES).examined == 51
    assert verdicts.of(POSITIONS).examined == 3 * 26
    assert verdicts.of(CLOCKS).examined > 3 * 26


def test_another_seed_is_another_plan() -> None:
    recorded_run = flown(Navigation(node="1", noise_m=5.0))
    scenario = msgspec.structs.replace(recorded_run.scenario, seed=2)
    about = msgspec.structs.replace(recorded_run.about, scenario=scenario)
    assert check(replace(recorded_run, about=about)).broken == (POSITIONS,)


def test_a_position_freezes_anew_in_each_incarnation() -> None:
    """And a broadcast that was due when the process came back is told."""
    plan = (
        Navigation(node="1", noise_m=5.0, freeze=True, start_s=0.5),
        Kill(node="1", start_s=1.0, end_s=2.1),
        Pause(node="1", start_s=3.0, end_s=3.7),
    )
    assert check(flown(*plan)).broken == ()
    assert POSITIONS in claimed(flown(*plan), *plan[1:]).broken


def test_who_tells_nothing_need_not() -> None:
    scenario = meeting(duration_s=2.0, surveillance=Surveillance(broadcast_s=0.25))
    uavs = [msgspec.structs.replace(u, equipment="mute") for u in scenario.uav]
    scenario = msgspec.structs.replace(scenario, uav=tuple(uavs))
    records = RecordCollector()
    for _ in run_in_memory(scenario, RunRecorder(scenario, records)):
        pass
    assert check(RecordedRun.of_records(scenario, records.kept, plan=())).broken == ()


def changed(recorded_run: RecordedRun, topic: str, at_s: float, **fields: object) -> RecordedRun:
    """The same with fields of one message changed."""
    records = list(recorded_run.records)
    t_ns = round(at_s * S)
    place = next(n for n, r in enumerate(records) if r.topic == topic and r.sent_ns == t_ns)
    message = codec.decode(topic, records[place].payload)
    told = msgspec.structs.replace(message, **fields)
    records[place] = replace(records[place], payload=codec.encode(told))
    return replace(recorded_run, records=records)


@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize(
    ("name", "fields"),
    [
        (POSITIONS, {"position_ned_m": (0.0, 0.0, -300.0)}),
        (POSITIONS, {"velocity_ned_mps": (24.0, 0.0, 0.0)}),
        (POSITIONS, {"speed_mps": 24.0}),
        (POSITIONS, {"heading_rad": 0.5}),
        (POSITIONS, {"flight_path_rad": 0.5}),
        (CLOCKS, {"applies_ns": 2 * S + 1}),
    ],
)
def test_a_broadcast_that_is_not_the_truth(
    name: str, fields: dict[str, object], *, realtime: bool
) -> None:
    recorded_run = changed(flown(), "1/adsb/0", 2.0, **fields)
    recorded_run = on_wall_clocks(recorded_run) if realtime else recorded_run
    finding = check(recorded_run).of(name)
    assert (finding.verdict, finding.violations) == (Verdict.INVALID, 1)


def test_what_was_told_and_what_is_so_are_shown() -> None:
    recorded_run = changed(flown(), "3/adsb/0", 0.0, position_ned_m=(5.0, 700.0, -300.0))
    finding = check(recorded_run).of(POSITIONS)
    assert finding.why == "by the fault plan UAV 3 takes itself to be at 0,700,-300"
    assert [w.line() for w in finding.witnesses] == [
        "0.000 s  3/truth  position_ned_m=0,700,-300 velocity_ned_mps=1.53081e-15,-25,-0",
        "0.000 s  3/adsb/0  position_ned_m=5,700,-300 velocity_ned_mps=1.53081e-15,-25,-0",
    ]


def test_the_last_bits_may_differ() -> None:
    recorded_run = flown()
    told = next(r for r in recorded_run.records if r.topic == "3/adsb/0" and r.sent_ns == 2 * S)
    message = codec.decode(told.topic, told.payload)
    assert isinstance(message, StateBroadcast)
    north, east, down = message.position_ned_m
    near = changed(recorded_run, "3/adsb/0", 2.0, position_ned_m=(north + 1e-8, east, down))
    assert check(near).of(POSITIONS).verdict is Verdict.VALID


def without(recorded_run: RecordedRun, topic: str, at_s: float) -> RecordedRun:
    """The same without one message."""
    t_ns = round(at_s * S)
    kept = [r for r in recorded_run.records if (r.topic, r.sent_ns) != (topic, t_ns)]
    return replace(recorded_run, records=kept)


@pytest.mark.parametrize("plan", [(), (Kill(node="1", start_s=1.0, end_s=2.0),)])
def test_who_knows_where_it_is_says_so_when_it_is_time(plan: tuple[Rule, ...]) -> None:
    """Also in the first step of another incarnation."""
    finding = check(without(flown(*plan), "1/adsb/0", 2.0)).of(POSITIONS)
    assert finding.why == "UAV 1 does not broadcast, though it is time"


PAUSED = (Pause(node="1", start_s=2.0, end_s=3.0),)


def test_the_grant_shows_who_is_away() -> None:
    finding = claimed(flown(), *PAUSED).of(PROCESSES)
    assert finding.why == "UAV 1 is up, and held by the fault plan"
    assert finding.witnesses[0].line() == "2.000 s  sim/clock  held= down="
    assert claimed(flown(*PAUSED)).of(PROCESSES).why == "UAV 1 is held, and up by the fault plan"


def test_who_is_held_is_flown_by_the_range() -> None:
    recorded_run = flown(*PAUSED)
    nobody = check(without(recorded_run, "1/truth", 2.5)).of(PROCESSES)
    assert nobody.why == "UAV 1 is held, and the simulation does not fly it"
    dead = check(changed(recorded_run, "1/truth", 2.5, mode="unmanned")).of(PROCESSES)
    assert dead.why == "by the fault plan UAV 1 is held"
    itself = check(changed(recorded_run, "1/truth", 2.5, mode="plan")).of(PROCESSES)
    assert itself.why == "UAV 1 acts while it is held"
    alive = check(changed(recorded_run, "1/truth", 1.5, mode="held")).of(PROCESSES)
    assert alive.why == "by the fault plan UAV 1 is flown by its own process"


def test_who_is_there_steps_in_every_tick() -> None:
    recorded_run = without(without(flown(), "coordinator/done", 2.1), "coordinator/delivery", 2.1)
    why = "the coordinator does not step, though nothing stops it"
    assert check(recorded_run).of(PROCESSES).why == why


@pytest.mark.parametrize("plan", [PAUSED, (Slow(node="1", factor=4),), SAMPLES["kill"][1][:1]])
def test_in_realtime_the_range_itself_keeps_to_the_plan(plan: tuple[Rule, ...]) -> None:
    """It tells changes only, and says nothing about who is away when it tells the epoch."""
    kept, before = list[Record](), Absent()
    for record in flown(*plan).records:
        if record.topic == CLOCK:
            clock = codec.decode_clock(record.payload)
            now = Absent(clock.held, clock.down)
            if now == before and clock.tick > 0:
                continue
            before = now
            clock = msgspec.structs.replace(clock, state="plan" if clock.tick else "epoch")
            record = replace(record, payload=codec.encode(clock))  # noqa: PLW2901
        kept.append(record)
    recorded_run = replace(on_wall_clocks(flown(*plan)), records=kept)
    assert check(recorded_run).of(PROCESSES).verdict is Verdict.VALID
    assert claimed(recorded_run).of(PROCESSES).verdict is Verdict.INVALID


def test_in_realtime_a_changed_plan_is_taken_up_some_time() -> None:
    """Whom no rule concerns tells the truth all the same."""
    plan = (Navigation(node="1", noise_m=5.0), WrongClock(node="1", offset_s=1.0))
    recorded_run = replace(on_wall_clocks(flown()), plan=plan)
    assert not {POSITIONS, CLOCKS} & {*check(recorded_run).broken}
    odd = changed(recorded_run, "3/adsb/0", 2.0, position_ned_m=(0.0, 0.0, -300.0), applies_ns=0)
    assert {POSITIONS, CLOCKS} <= {*check(odd).broken}


def test_in_realtime_a_frozen_position_is_not_judged_but_a_bias_is() -> None:
    recorded_run = on_wall_clocks(flown())
    assert POSITIONS not in claimed(recorded_run, Navigation(node="1", freeze=True)).broken
    bias = Navigation(node="1", bias_ned_m=(30.0, 0.0, 0.0))
    assert POSITIONS in claimed(recorded_run, bias).broken


def test_an_epoch_does_not_say_who_is_away() -> None:
    """A process that comes back is told it, while another one is still down."""
    plan = (Kill(node="1", start_s=1.0, end_s=2.0), Kill(node="2", start_s=1.0, end_s=3.0))
    recorded_run = RecordedRunBuilder(apart(), *plan).recorded_run(realtime=True)
    place = next(n for n, r in enumerate(recorded_run.records) if r.sent_ns > 2 * S)
    epoch = Record(CLOCK, codec.encode(Clock(20, 2 * S, "epoch", {}, S)), 20, 2 * S, 2 * S)
    records = [*list(recorded_run.records)[:place], epoch, *list(recorded_run.records)[place:]]
    index = Index(replace(recorded_run, records=records), fates_of)
    assert (index.absences.downs[1], index.absences.downs[2]) == ([(S, 2 * S)], [(S, 3 * S)])


class TestCopies:
    """What a plan copies comes twice."""

    def run_builder(self, delay_s: float, *more: Rule) -> RecordedRunBuilder:
        """A heartbeat that UAV 2 should have twice, and has once."""
        copied = Duplicate(classes="heartbeat", dst="2", probability=1.0, delay_s=delay_s)
        run_builder = RecordedRunBuilder(apart(), copied, *more)
        run_builder.tell(heartbeat(S, 0))
        return run_builder

    @pytest.mark.parametrize("realtime", [False, True])
    def test_a_copy_that_never_comes(self, *, realtime: bool) -> None:
        finding = self.run_builder(0.5).check(realtime=realtime).of(APPLIED)
        assert finding.why == (
            "UAV 2 has not all of it: by the fault plan it is delivered after 0.000 s and 0.500 s "
            "(or a tick, if that is longer)"
        )
        assert [w.line() for w in finding.witnesses] == ["1.000 s  coordinator/heartbeat  seq=0"]

    def test_one_that_comes(self) -> None:
        run_builder = self.run_builder(0.5)
        run_builder.hear(2, heartbeat(S, 0), after_s=0.5)
        assert run_builder.check().broken == ()

    @pytest.mark.parametrize(("delay_s", "broken"), [(3.0, (APPLIED,)), (3.1, ())])
    def test_one_that_is_due_after_the_end(self, delay_s: float, broken: tuple[str, ...]) -> None:
        assert self.run_builder(delay_s).check().broken == broken

    @pytest.mark.parametrize(("delay_s", "broken"), [(0.9, (APPLIED,)), (1.0, ())])
    def test_one_that_is_due_to_the_dead(self, delay_s: float, broken: tuple[str, ...]) -> None:
        run_builder = self.run_builder(delay_s, Kill(node="2", start_s=2.0, end_s=3.0))
        assert run_builder.check().broken == broken
