"""Every kind of fault, also the next one: it does what it declares, and declares what it must."""

from __future__ import annotations

import random
from typing import Any

import msgspec
import pytest

from fleet.faults import registry
from fleet.faults.clock import ClockRule
from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.lifecycle import DOWN, HELD, UP, ProcessRule, Severity
from fleet.faults.links import Act, Effect, Harm, LinkRule
from fleet.faults.registry import GROUPS, fault_kind, kinds, kinds_of, options
from fleet.faults.rules import Rule
from fleet.faults.sensors import SensorRule
from tests.support.fault_samples import TICK_NS, stream

BITS = 2000
UAVS = [1, 2]
each_of_links = pytest.mark.parametrize("kind", kinds_of(LinkRule))


def drawn(kind: str, count: int = 5) -> list[Any]:
    """Rules of a kind as random cases have them, but for all and always."""
    dice, out = random.Random(1), []
    for _ in range(count):
        keys = kinds()[kind].fuzzed(dice, UAVS)
        node = {} if issubclass(kinds()[kind], LinkRule) else {"node": "1"}
        table = {"kind": kind, **node, **{k: v for k, v in keys.items() if v is not None}}
        out.append(msgspec.convert(table, registry.FaultRule))
    return out


def done(rule: LinkRule, sent: list[LinkMessage]) -> dict[int, tuple[bool, Any]]:
    """By number of a message: whether it passed, and what was made of it."""
    act, out = rule.act(Draws(1, 0), TICK_NS), {}
    for message in sent:
        effect = Effect()
        passed = act(message, effect)
        out[message.seq] = (passed, (effect.delay_s, effect.copies_s, effect.flips))
    return out


@each_of_links
def test_it_does_no_harm_but_what_it_declares(kind: str) -> None:
    for rule in drawn(kind):
        for passed, (delay_s, copies_s, flips) in done(
            rule, stream(1000, bits=BITS, distance_m=300.0)
        ).values():
            assert passed or Harm.DROP in rule.harms
            assert not delay_s or Harm.DELAY in rule.harms
            assert not copies_s or Harm.COPY in rule.harms
            assert not flips or Harm.ALTER in rule.harms
            assert len(copies_s) <= rule.copies
            assert max(delay_s, *copies_s, 0.0) <= rule.longest_s(BITS) + 1e-9


@each_of_links
def test_as_many_messages_pass_as_it_lets_expect(kind: str) -> None:
    for rule in drawn(kind):
        sent = stream(5000, bits=BITS, distance_m=300.0)
        expected = rule.passes(sent[0])
        if expected is not None:
            found = sum(passed for passed, _ in done(rule, sent).values()) / len(sent)
            assert found == pytest.approx(expected, abs=0.1)


@each_of_links
def test_it_goes_by_distance_size_and_order_only_if_it_declares_that(kind: str) -> None:
    for rule in drawn(kind):
        sent = stream(1000, bits=BITS, distance_m=300.0)
        usual = done(rule, sent)
        if not rule.by_distance:
            assert done(rule, stream(1000, bits=BITS)) == usual
        if not rule.by_size:
            assert done(rule, stream(1000, distance_m=300.0)) == usual
        if not rule.by_order:
            assert done(rule, random.Random(1).sample(sent, len(sent))) == usual


@pytest.mark.parametrize("kind", kinds_of(ProcessRule))
def test_presence_is_as_severe_as_declared(kind: str) -> None:
    for rule in drawn(kind):
        found = {rule.presence(n) for n in range(100)}
        some = rule.severity is Severity.SOME_STEPS
        assert found == ({UP, HELD} if some else {HELD} if rule.severity < 2 else {DOWN})


def test_every_kind_is_of_one_group_and_every_option_of_one_kind() -> None:
    for cls in kinds().values():
        assert [issubclass(cls, group) for group in GROUPS].count(True) == 1
    names = [option.option for _, option in options()]
    assert len(set(names)) == len(names)


def passing(*_: Any) -> Act:
    return lambda *_: True


def defined(name: str, base: type[Rule], said: dict[str, Any]) -> type[Rule]:
    """A class of rules that says this of itself."""
    made = msgspec.defstruct(
        name, [], bases=(base,), namespace=said, frozen=True, kw_only=True, tag=name
    )
    assert issubclass(made, Rule)
    return made


SAID: dict[str, Any] = {"fuzzed": classmethod(lambda *_: {}), "act": passing}

UNSAID: list[tuple[type[Rule], dict[str, Any], str]] = [
    (LinkRule, {}, "fuzzed, harms"),
    (LinkRule, {"harms": Harm(0)}, "fuzzed, act"),
    (LinkRule, {**SAID, "harms": Harm.DROP}, "passes"),
    (LinkRule, {**SAID, "harms": Harm.COPY | Harm.ALTER}, "longest_s"),
    (LinkRule, {**SAID, "harms": Harm.DELAY}, "longest_s, quantiles_s"),
    (ProcessRule, {}, "fuzzed, severity"),
    (SensorRule, {}, "fuzzed, sensing"),
    (ClockRule, {}, "fuzzed, shift_ns"),
    (Rule, SAID, "link, process, sensor or clock"),
]


@pytest.mark.parametrize(("base", "said", "missing"), UNSAID)
def test_a_kind_that_does_not_say_all_is_refused(
    base: type[Rule], said: dict[str, Any], missing: str
) -> None:
    cls = defined("Odd", base, said)
    with pytest.raises(TypeError, match=f"Odd: a kind of fault has to say {missing}$"):
        fault_kind(cls)
    assert "Odd" not in kinds()


def test_a_kind_comes_too_late_when_scenarios_have_been_read() -> None:
    msgspec.convert({"kind": "loss", "probability": 0.1}, registry.FaultRule)
    cls = defined("Late", LinkRule, {**SAID, "harms": Harm(0)})
    with pytest.raises(TypeError, match="defined before the first scenario is"):
        fault_kind(cls)
