"""Shorthands say what the tables say; what is none is refused in one line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet.cli import main
from fleet.config.loading import convert, read_scenario, with_faults
from fleet.errors import ScenarioError
from fleet.faults import registry
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.clock import ClockError
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
from fleet.faults.options import Shorthand, Variation
from fleet.faults.presets import PRESETS
from fleet.faults.quantities import fraction, metres, moment_s
from fleet.faults.registry import options
from fleet.faults.rules import Rule
from fleet.faults.shorthand import rules_of, shorthands
from tests.config.test_bad_input import complain, folder
from tests.support.fault_samples import fast

__all__ = ["folder"]

TABLE: dict[str, Any] = {"name": "x", "duration_s": 9.0, "generate": {"kind": "converge"}}
EMPTY = convert(TABLE, "x")


def rules(**given: str | list[str]) -> tuple[Rule, ...]:
    """The rules of shorthands, `_` for `-`."""
    texts = {k.replace("_", "-"): [v] if isinstance(v, str) else v for k, v in given.items()}
    return with_faults(EMPTY, rules_of(texts, 0.2), "x").fault


SAID: list[tuple[str, str, Rule]] = [
    ("latency", "300ms", Latency(base_s=0.3)),
    ("latency", "2s@5s+10s", Latency(base_s=2.0, start_s=5.0, end_s=15.0)),
    ("jitter", "50ms", Latency(jitter_s=0.05)),
    ("loss", "20%", Loss(probability=0.2)),
    ("loss", "0.5@60s+30s", Loss(probability=0.5, start_s=60.0, end_s=90.0)),
    ("range", "5km", Range(model="cutoff", max_m=5000.0)),
    ("range", "2NM@1min", Range(model="cutoff", max_m=3704.0, start_s=60.0)),
    (
        "partition",
        "1-2/3,4,coordinator@60s+30s",
        Partition(groups="1-2/3,4,coordinator", start_s=60.0, end_s=90.0),
    ),
    ("duplicate", "1%", Duplicate(probability=0.01)),
    ("replay", "1%", Replay(probability=0.01)),
    ("reorder", "10%@3s", Reorder(probability=0.1, start_s=3.0)),
    ("corrupt", "0.5%", Corrupt(probability=0.005)),
    ("rate", "100kbit", Rate(bits_per_s=1e5)),
    ("kill", "1@40s", Kill(node="1", start_s=40.0)),
    ("kill", "coordinator@40s+20s", Kill(node="coordinator", start_s=40.0, end_s=60.0)),
    ("pause", "1-2,5@50s+5s", Pause(node="1-2,5", start_s=50.0, end_s=55.0)),
    ("slow", "2:4@50s+10s", Slow(node="2", factor=4, start_s=50.0, end_s=60.0)),
    ("gps-noise", "10m", Navigation(node="uav", noise_m=10.0)),
    ("gps-noise", "2:10m@5s", Navigation(node="2", noise_m=10.0, start_s=5.0)),
    ("gps-freeze", "2@30s+10s", Navigation(node="2", freeze=True, start_s=30.0, end_s=40.0)),
    ("gps-dropout", "uav@30s+10s", Navigation(node="uav", dropout=1.0, start_s=30.0, end_s=40.0)),
    ("clock-offset", "2:500ms", ClockError(node="2", offset_s=0.5)),
    (
        "clock-offset",
        "coordinator:-2s@9s",
        ClockError(node="coordinator", offset_s=-2.0, start_s=9.0),
    ),
]


@pytest.mark.parametrize(("name", "text", "rule"), SAID)
def test_a_shorthand_says_what_a_table_says(name: str, text: str, rule: Rule) -> None:
    assert rules(**{name: text}) == (rule,)


@pytest.mark.parametrize(("kind", "option"), options(), ids=lambda x: getattr(x, "option", x))
def test_the_example_of_a_shorthand_is_possible(kind: str, option: Shorthand | Variation) -> None:
    given = {option.option: option.example}
    if isinstance(option, Variation):
        (other,) = [o for _, o in options() if o.option == option.of]
        given[option.of] = other.example
    (table,) = rules_of({name: [text] for name, text in given.items()}, 0.2)
    (rule,) = msgspec.convert([table], tuple[registry.FaultRule, ...])
    assert rule.name == kind


def test_shorthands_compose_in_one_order_and_can_be_given_often() -> None:
    found = rules(
        loss=["10%", "50%@60s+30s"],
        burst="3",
        preset=["wifi", "adsb"],
        latency=["100ms", "1s@5s"],
        jitter="20ms",
        kill=["1@3s", "2@4s"],
    )
    assert found == (
        *PRESETS["wifi"](0.2),
        *PRESETS["adsb"](0.2),
        Latency(base_s=0.1, jitter_s=0.02),
        Latency(base_s=1.0, jitter_s=0.02, start_s=5.0),
        Burst(loss=0.1, mean_ticks=3.0),
        Burst(loss=0.5, mean_ticks=3.0, start_s=60.0, end_s=90.0),
        Kill(node="1", start_s=3.0),
        Kill(node="2", start_s=4.0),
    )
    assert rules() == rules(preset="perfect") == ()


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_a_possible_plan(name: str) -> None:
    assert rules(preset=name) == tuple(PRESETS[name](0.2))


UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "": 1.0}
amounts = st.integers(0, 10**6).map(lambda n: n / 1000)


@given(amounts, st.sampled_from(list(UNITS_S)), amounts, amounts)
@fast
def test_any_time_and_window_are_read(value: float, unit: str, start: float, length: float) -> None:
    text = f"{value:f}{unit}"
    assert moment_s(text) == pytest.approx(value * UNITS_S[unit])
    if value * UNITS_S[unit] > 3600.0 or length == 0.0:
        return
    if value and not unit:
        with pytest.raises(ValueError, match=f"has no unit; write {text}ms or {text}s"):
            rules(latency=text)
        return
    (rule,) = rules(latency=f"{text}@{start:f}s+{length:f}s")
    assert isinstance(rule, Latency)
    assert rule.end_s is not None
    told = (rule.base_s, rule.start_s, rule.end_s)
    assert told == pytest.approx((value * UNITS_S[unit], start, start + length))


@given(amounts, st.sampled_from([("m", 1.0), ("km", 1000.0), ("NM", 1852.0)]))
@fast
def test_any_length_is_read(value: float, unit: tuple[str, float]) -> None:
    assert metres(f"{value:f} {unit[0]}") == pytest.approx(value * unit[1])


@given(st.integers(0, 100))
@fast
def test_any_probability_is_read_both_ways(percent: int) -> None:
    assert fraction(f"{percent}%") == pytest.approx(fraction(f"{percent / 100:f}"))


pieces = st.sampled_from(
    [
        *"1*:,/@+-.%sm05 \nä",
        "2-3",
        "coordinator",
        "uav",
        "9" * 400,
        "ms",
        "km",
        "NM",
        "kbit",
        "wifi",
    ]
)


@given(st.sampled_from(shorthands()), st.lists(pieces, max_size=8).map("".join))
@fast
def test_any_other_text_is_read_or_refused_in_one_line(name: str, text: str) -> None:
    try:
        found = rules(**{name: text})
    except (ValueError, ScenarioError) as error:
        place = f"--{name} {text}" if isinstance(error, ScenarioError) else f"--{name}: "
        assert str(error).startswith(place)  # noqa: PT017
    else:
        assert (
            msgspec.json.decode(msgspec.json.encode(found), type=tuple[registry.FaultRule, ...])
            == found
        )


WRONG = {
    "no time": ("--latency", "soon", "--latency: 'soon' is no time; write 300ms"),
    "seconds or ms": ("--latency", "500", "--latency: '500' has no unit; write 500ms or 500s"),
    "seconds or ms, later": ("--latency", "500@5s", "--latency: '500' has no unit; write 500ms"),
    "jitter in what": ("--jitter", "50", "--jitter: '50' has no unit; write 50ms or 50s"),
    "offset in what": ("--clock-offset", "1:-2", "'-2' has no unit; write -2ms or -2s"),
    "parted from itself": (
        "--partition",
        "1/1",
        "fleet: --partition 1/1 (groups): '1/1' parts nobody",
    ),
    "both on one side": (
        "--partition",
        "1,2/2",
        "fleet: --partition 1,2/2 (groups): '1,2/2' parts n",
    ),
    "parted from nobody": ("--partition", "1-2,coordinator/2", "parts nobody from anybody"),
    "killed when, in what": ("--kill", "1@40", "--kill: '40' has no unit; write 40ms or 40s"),
    "how long, in what": ("--pause", "1@40s+5", "--pause: '5' has no unit; write 5ms or 5s"),
    "from when, in what": ("--loss", "5%@60", "--loss: '60' has no unit; write 60ms or 60s"),
    "slower by halves": (
        "--slow",
        "1:2.5",
        "--slow: '2.5' is no factor; write 2 or a greater whole",
    ),
    "no jitter": ("--jitter", "-1s", "--jitter: '-1s' is no time"),
    "no probability": ("--loss", "150%", "--loss: '150%' is no probability; write 20%"),
    "no window": ("--loss", "5%@soon", "--loss: 'soon' is no time"),
    "no length of time": ("--loss", "5%@9s+0s", "--loss: '5%@9s+0s' lasts no time"),
    "burst of no loss": ("--burst", "5", "--burst: needs --loss"),
    "no length": ("--range", "5 miles", "--range: '5 miles' is no length; write 500m, 5km or 3NM"),
    "no range": ("--range", "0m", "fleet: --range 0m (max_m): expected a number >= 0.001"),
    "one group": ("--partition", "1,2@3s", "fleet: --partition 1,2@3s (groups): expected two gro"),
    "no rate": ("--rate", "10", "--rate: '10' is no rate per second; write 9600bit"),
    "nobody": ("--kill", "one@40s", "--kill: 'one' is nobody; write 2, 1-4,7, uav or coordinator"),
    "nobody there": (
        "--kill",
        "9@40s",
        "fleet: --kill 9@40s (node): '9' names nobody whom it could",
    ),
    "killed when": ("--kill", "1", "--kill: '1' does not say when; write 1@40s or 1@40s+20s"),
    "paused when": ("--pause", "1", "--pause: '1' does not say when"),
    "slow who": ("--slow", "4@50s", "--slow: '4@50s' does not say for whom; write 2:4@50s+10s"),
    "slow how": ("--slow", "1:x", "--slow: 'x' is no factor; write 2 or a greater"),
    "slower than that": ("--slow", "1:" + "9" * 400, "is no factor; write 2 or a greater"),
    "not slow": ("--slow", "1:1", "fleet: --slow 1:1 (factor): expected a whole number >= 2"),
    "noise of what": ("--gps-noise", "2:loud", "--gps-noise: 'loud' is no length"),
    "noise of whom": (
        "--gps-noise",
        "coordinator:5m",
        "fleet: --gps-noise coordinator:5m (node): 'coordinator' names nobody",
    ),
    "late in hours": (
        "--latency",
        "99min",
        "fleet: --latency 99min (base_s): expected a number <= 3600",
    ),
    "only varied": (
        "--jitter",
        "99min",
        "fleet: --jitter 99min (jitter_s): expected a number <= 3600",
    ),
    "frozen who": ("--gps-freeze", "@3s", "--gps-freeze: '' is nobody"),
    "whose clock": ("--clock-offset", "5s", "--clock-offset: '5s' does not say for whom"),
    "how far off": ("--clock-offset", "1:x", "--clock-offset: 'x' is no offset; write 500ms or -5"),
    "no preset": ("--preset", "lte", "--preset: 'lte' is no preset; write one of perfect, adsb"),
}


@pytest.mark.parametrize("case", WRONG)
@pytest.mark.usefixtures("folder")
def test_a_wrong_option_brings_one_clear_line(
    case: str, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    option, text, words = WRONG[case]
    assert words in complain(["run", "side", option, text], capfd, tmp_path)


def test_options_are_laid_over_the_scenario_and_named(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[Any] = []
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr("fleet.cli.run.run_fleet", lambda options, _: flown.append(options))
    monkeypatch.setattr(sys, "argv", ["fleet", "run", "side", "--loss", "5%", "--preset", "wifi"])
    with pytest.raises(AttributeError, match="NoneType"):
        main()
    expected = (*PRESETS["wifi"](0.2), Loss(probability=0.05))
    assert flown[0].scenario.fault == expected
    assert msgspec.structs.replace(flown[0].scenario, fault=()) == read_scenario("side").scenario
    assert "fault: loss" in capfd.readouterr().err
