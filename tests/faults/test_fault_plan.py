"""The fault plan as a whole: whom and when rules concern, JSON, repeatability, live changes."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import inspect

from fleet.config.loading import convert, read_scenario, with_faults
from fleet.errors import ScenarioError
from fleet.faults import registry
from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.range import Range
from fleet.faults.kinds.rate import Rate
from fleet.faults.kinds.reorder import Reorder
from fleet.faults.kinds.replay import Replay
from fleet.faults.registry import kinds
from fleet.faults.whom import names
from fleet.node.join_info import join_info_of, plan_bytes
from tests.support.fault_samples import TICK_NS, channel, fast, link_messages, stream

S = 1_000_000_000
HEAD_ON = read_scenario("head_on").scenario


def values(kind: inspect.Type) -> st.SearchStrategy[Any]:
    """Everything that a field may hold, as it stands in TOML or JSON."""
    match kind:
        case inspect.Metadata():
            return values(kind.type)
        case inspect.FloatType():
            low = kind.ge if kind.ge is not None else kind.gt
            high = kind.le if kind.le is not None else kind.lt
            return st.floats(low, high, exclude_min=kind.ge is None, exclude_max=kind.le is None)
        case inspect.IntType():
            return st.integers(kind.ge, kind.le)
        case inspect.BoolType():
            return st.booleans()
        case inspect.StrType():
            return st.from_regex(
                str(kind.pattern), fullmatch=True, alphabet=st.characters(codec="ascii")
            )
        case inspect.LiteralType():
            return st.sampled_from(kind.values)
        case inspect.NoneType():
            return st.none()
        case inspect.UnionType():
            return st.one_of(*map(values, kind.types))
        case inspect.TupleType():
            return st.tuples(*map(values, kind.item_types))
    raise TypeError(kind)


def tables(cls: type[msgspec.Struct]) -> st.SearchStrategy[dict[str, Any]]:
    """Every `[[fault]]` table of a kind."""
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    keys = {f.encode_name: values(f.type) for f in info.fields}
    needed = {f.encode_name for f in info.fields if f.required}
    return st.fixed_dictionaries(
        {"kind": st.just(info.tag), **{k: keys[k] for k in needed}},
        optional={k: v for k, v in keys.items() if k not in needed},
    )


@pytest.mark.parametrize("kind", kinds())
@given(data=st.data())
@fast
def test_a_plan_survives_json(kind: str, data: st.DataObject) -> None:
    table = data.draw(tables(kinds()[kind]))
    plan = msgspec.convert([table], tuple[registry.FaultRule, ...])
    assert plan[0].name == kind
    encoded = msgspec.json.encode(plan)
    assert msgspec.json.decode(encoded, type=tuple[registry.FaultRule, ...]) == plan
    scenario = msgspec.structs.replace(HEAD_ON, fault=plan)
    assert join_info_of("", "", plan_bytes("lockstep", scenario)).scenario == scenario


def test_for_ever_and_everywhere_survive_json() -> None:
    plan = (Loss(probability=0.5), Range(model="rayleigh"), Pause(node="2", start_s=3.0))
    assert plan[0].end_s is None is plan[1].max_m
    encoded = msgspec.json.encode(plan)
    assert b"Infinity" not in encoded
    assert msgspec.json.decode(encoded, type=tuple[registry.FaultRule, ...]) == plan
    assert plan[2].during(10**18)


def test_rules_concern_whom_and_when_they_say() -> None:
    rule = Loss(probability=1.0, src="1,3-4", dst="uav", classes="cmd,ack", start_s=1.0, end_s=2.0)
    good = LinkMessage(1, 3, "cmd", 0, S)
    assert rule.concerns(good)
    assert rule.concerns(msgspec.structs.replace(good, src=4, kind="ack", t_ns=2 * S - 1))
    for change in ({"src": 2}, {"src": 13}, {"dst": 0}, {"kind": "adsb"}, {"t_ns": 2 * S}):
        assert not rule.concerns(msgspec.structs.replace(good, **change))
    assert not rule.concerns(msgspec.structs.replace(good, t_ns=S - 1))
    assert not rule.concerns(msgspec.structs.replace(good, src=3)), "to itself: on no link"


@pytest.mark.parametrize(
    ("who", "named"),
    [
        ("*", {0, 1, 2, 3, 4, 10, 12}),
        ("uav", {1, 2, 3, 4, 10, 12}),
        ("coordinator", {0}),
        ("coordinator,3", {0, 3}),
        ("1", {1}),
        ("1-3,12", {1, 2, 3, 12}),
        ("3-1", set[int]()),
    ],
)
def test_a_pattern_names_exactly_these(who: str, named: set[int]) -> None:
    assert {n for n in (0, 1, 2, 3, 4, 10, 12) if names(who, n)} == named
    assert {n for n in (0, 1, 2, 3, 4, 10, 12) if Pause(node=who).hits(n)} == named


@given(link_messages)
@fast
def test_a_plan_that_is_not_about_links_does_nothing(link_message: LinkMessage) -> None:
    for found in (channel(), channel(ClockError(node="*", offset_s=1.0), Pause(node="1"))):
        assert found.clean
        assert not found.measures_distance
        (only,) = found.fate(link_message).deliveries
        assert (only.delay_ns, only.flips) == (0, ())


ANY_ORDER = (
    Latency(base_s=0.1, jitter_s=0.1),
    Loss(probability=0.2),
    Burst(loss=0.2),
    Range(model="log_distance", shadowing_db=8.0),
    Duplicate(probability=0.2),
    Replay(probability=0.2),
    Reorder(probability=0.2),
    Corrupt(probability=0.2, frame_check=False),
)


@given(st.lists(link_messages, max_size=30), st.randoms(use_true_random=False))
@fast
def test_fates_do_not_depend_on_the_order_of_arrival(sent: list[LinkMessage], rng: Any) -> None:
    sent = [msgspec.structs.replace(h, t_ns=h.t_ns % (100 * TICK_NS)) for h in sent]
    one, other = channel(*ANY_ORDER), channel(*ANY_ORDER)
    shuffled = rng.sample(sent, len(sent))
    expected = {link_message: one.fate(link_message) for link_message in sent}
    assert {link_message: other.fate(link_message) for link_message in shuffled} == expected


@given(st.integers(0, 2**40), st.integers(0, 2**40), st.integers(0, 99), st.text(max_size=5))
@fast
def test_draws_are_a_function_of_seed_rule_and_label(
    one: int, two: int, rule: int, label: str
) -> None:
    drawn = Draws(one, rule).uniform(label, 1)
    assert drawn == Draws(one, rule).uniform(label, 1)
    assert drawn != Draws(one, rule + 1).uniform(label, 1)
    assert drawn != Draws(one, rule).uniform(label, 2)
    assert (drawn == Draws(two, rule).uniform(label, 1)) == (one == two)
    assert 0.0 < drawn < 1.0


def test_the_first_rule_that_drops_a_message_names_its_fate() -> None:
    link_message = LinkMessage(1, 2, "adsb", 0, 0, distance_m=10.0)
    rules = (Loss(probability=1.0), Range(max_m=1.0), Corrupt(probability=1.0))
    assert channel(*rules).fate(link_message).dropped_by == "loss"
    assert channel(*rules[::-1]).fate(link_message).dropped_by == "corrupt"
    assert channel(rules[1]).fate(link_message).dropped_by == "range"


def test_a_change_of_plan_keeps_draws_and_memory() -> None:
    before = (
        ClockError(node="1"),
        Burst(loss=0.4, mean_ticks=9.0),
        Rate(bits_per_s=4000.0, queue=50),
    )
    sent = stream(400, bits=1200)
    whole = channel(*before)
    expected = [whole.fate(link_message) for link_message in sent]
    assert len({f.deliveries[0].delay_ns for f in expected if f.deliveries}) > 20
    changed = channel(*before)
    assert [changed.fate(link_message) for link_message in sent[:200]] == expected[:200]
    changed.replan((*before, Loss(probability=1.0, start_s=30.0)))
    assert [changed.fate(link_message) for link_message in sent[200:300]] == expected[200:300]
    ended = msgspec.structs.replace(before[1], end_s=30.0)
    changed.replan((before[0], ended, before[2], Loss(probability=1.0, start_s=30.0)))
    assert {changed.fate(link_message).dropped_by for link_message in sent[300:]} == {
        "rate",
        "loss",
    }


def test_rules_can_come_to_a_clean_channel_and_ask_for_distances() -> None:
    found = channel()
    found.replan((Range(max_m=5.0),))
    assert not found.clean
    assert found.measures_distance
    assert found.fate(LinkMessage(1, 2, "adsb", 0, 0, distance_m=6.0)).dropped_by == "range"


# in a scenario

BAD: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": (
        {"kind": "rate", "bits_per_s": 9, "que": 3},
        "[0].que: unknown key (did you me",
    ),
    "key of another kind": ({"kind": "loss", "probability": 1, "bits": 3}, "[0].bits: unknown key"),
    "missing key": ({"kind": "slow", "node": "1"}, "[0].factor: missing; add it"),
    "unknown kind": ({"kind": "gremlin"}, "[0].kind: invalid value 'gremlin'; use one of latency,"),
    "nobody": (
        {"kind": "kill", "node": "x"},
        "[0].node: expected '*', 'uav', 'coordinator' or a l",
    ),
    "no UAV 7": ({"kind": "pause", "node": "1,7"}, "[0].node: '7' names nobody whom it could conc"),
    "no UAV 7 to hear": (
        {"kind": "loss", "probability": 1, "dst": "7-9"},
        "[0].dst: '7-9' names no",
    ),
    "no UAV 3 to part": ({"kind": "partition", "groups": "1/2,3"}, "[0].groups: '3' names nobody"),
    "backwards": ({"kind": "loss", "probability": 1, "src": "2-1"}, "[0].src: '2-1' names nobody"),
    "no position": (
        {"kind": "navigation", "node": "coordinator"},
        "[0].node: 'coordinator' names n",
    ),
    "one group": (
        {"kind": "partition", "groups": "1,2"},
        "[0].groups: expected two groups or more",
    ),
    "no class": ({"kind": "latency", "class": "x"}, "[0].class: expected '*' or some of adsb"),
    "over before": ({"kind": "latency", "start_s": 9, "end_s": 8}, "[0].end_s: before start_s"),
    "endless": ({"kind": "latency", "end_s": float("inf")}, "[0].end_s: expected a number <= 1000"),
    "no model": ({"kind": "range", "model": "x"}, "[0].model: invalid enum value 'x'"),
    "no cutoff": ({"kind": "range"}, "[0].max_m: missing; add it"),
    "no polynomial": ({"kind": "range", "model": "polynomial"}, "[0].quadratic_per_m2: missing"),
    "wrong model": (
        {"kind": "range", "model": "rayleigh", "noise_dbm": -80},
        "[0].noise_dbm: model 'rayleigh' does not have it; leave it out",
    ),
    "too far off": (
        {"kind": "clock", "node": "1", "offset_s": 4e3},
        "[0].offset_s: expected a num",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_rule_brings_one_clear_line(case: str) -> None:
    table, words = BAD[case]
    with pytest.raises(ScenarioError) as raised:
        with_faults(HEAD_ON, [table], "mine.toml")
    line = str(raised.value)
    assert line.startswith(f"mine.toml: fault{words}")
    assert "\n" not in line


def test_further_faults_come_after_those_of_the_scenario() -> None:
    own = convert({**TABLE, "fault": [{"kind": "loss", "probability": 0.5}]}, "x")
    both = with_faults(own, [{"kind": "latency", "base_s": 1}], "x")
    assert both.fault == (Loss(probability=0.5), Latency(base_s=1.0))
    assert msgspec.structs.replace(both, fault=own.fault) == own
    assert with_faults(own, [], "x") is own


TABLE: dict[str, Any] = {"name": "x", "duration_s": 9.0, "generate": {"kind": "converge"}}
