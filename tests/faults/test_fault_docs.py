"""docs/scenarios.md names every kind of fault, every key, every shorthand and every preset."""

from __future__ import annotations

import random
import re
import tomllib

import msgspec
import pytest
from msgspec import inspect

from fleet.config.loading import convert, read_scenario, with_faults
from fleet.faults.links import LinkRule
from fleet.faults.options import Variation
from fleet.faults.presets import PRESETS
from fleet.faults.registry import kinds, options
from fleet.faults.rules import NodeRule, Rule
from fleet.faults.shorthand import rules_of, shorthands
from tests.test_docs import SCENARIOS, fields, interval, rows, section, shape

TABLES: list[tuple[str, type[Rule], type[Rule] | None]] = [
    ("Faults of links", LinkRule, Rule),
    ("Faults of participants", NodeRule, Rule),
    *(
        (f"`{kind}`", cls, LinkRule if issubclass(cls, LinkRule) else NodeRule)
        for kind, cls in kinds().items()
    ),
]


VARIATIONS = {option.option for _, option in options() if isinstance(option, Variation)}


def told_type(kind: inspect.Type) -> tuple[str, str]:
    """Type and range of a field; None is told as the default, choices are told as text."""
    match kind:
        case inspect.Metadata():
            return told_type(kind.type)
        case inspect.UnionType():
            (other,) = [t for t in kind.types if not isinstance(t, inspect.NoneType)]
            return told_type(other)
        case inspect.LiteralType():
            return "text", "-"
    return shape(kind), interval(kind)


def check(told: dict[str, list[str]], field: inspect.Field) -> None:
    kind, _, default, allowed, meaning = told[field.encode_name]
    assert (kind, allowed) == told_type(field.type), field.name
    assert meaning
    if field.required:
        assert default == "required", field.name
    elif field.default is None:
        assert default == "none", field.name
    else:
        value = tomllib.loads(f"value = {default.strip('`')}")["value"]
        assert msgspec.convert(value, type(field.default)) == field.default


def test_what_all_rules_have_is_told() -> None:
    told = rows(section(SCENARIOS, "`[[fault]]`"))
    assert list(told) == ["kind", *(f.encode_name for f in fields(Rule))]
    for field in fields(Rule):
        check(told, field)


@pytest.mark.parametrize(("heading", "cls", "base"), TABLES, ids=lambda x: str(x).strip("`"))
def test_every_key_is_told(heading: str, cls: type[Rule], base: type[Rule]) -> None:
    shared = {f.name for f in fields(base)}
    own = [f for f in fields(cls) if f.name not in shared]
    told = rows(section(SCENARIOS, heading))
    assert list(told) == [f.encode_name for f in own]
    for field in own:
        check(told, field)


@pytest.mark.parametrize("kind", kinds())
def test_every_choice_is_told(kind: str) -> None:
    told = rows(section(SCENARIOS, f"`{kind}`"))
    for field in fields(kinds()[kind]):
        kind_of = field.type.type if isinstance(field.type, inspect.Metadata) else field.type
        if isinstance(kind_of, inspect.LiteralType):
            for value in kind_of.values:
                assert f"`{value}`" in told[field.encode_name][4]


def test_every_kind_is_told_where_it_belongs() -> None:
    text = SCENARIOS[SCENARIOS.index("#### Faults of links") : SCENARIOS.index("#### Shorthands")]
    links, participants = text.split("#### Faults of participants")
    for part, base in ((links, LinkRule), (participants, NodeRule)):
        told = re.findall(r"^#### `(\w+)`$", part, re.MULTILINE)
        assert told == [kind for kind, cls in kinds().items() if issubclass(cls, base)]


def test_the_examples_of_tables_are_possible() -> None:
    (block,) = re.findall(r"^```toml\n(\[\[fault\]\].*?)^```", SCENARIOS, re.DOTALL | re.MULTILINE)
    scenario = with_faults(
        read_scenario("four_way").scenario, tomllib.loads(block)["fault"], "docs"
    )
    assert [rule.name for rule in scenario.fault] == ["partition", "latency", "navigation"]


def test_every_shorthand_is_told_with_what_it_says() -> None:
    told = rows(section(SCENARIOS, "Shorthands"))
    assert list(told) == [f"--{name}" for name in shorthands()]
    for name in shorthands():
        example, says = told[f"--{name}"]
        if name in {"preset", *VARIATIONS}:
            continue
        (table,) = rules_of({name: [example.strip("`")]}, 0.2)
        kind, *keys = re.findall(r"`([^`]+)`", says.partition(";")[0])
        assert kind == table["kind"]
        for key in keys:
            if " = " in key:
                assert tomllib.loads(key).items() <= table.items()


def test_every_preset_is_told_with_its_rules() -> None:
    told = rows(section(SCENARIOS, "Presets"))
    assert told.keys() == PRESETS.keys()
    for name, preset in PRESETS.items():
        says = re.findall(r"`([^`]+)`", told[name][0])
        keys = [key for key in says if " = " in key]
        for rule in preset(0.2):
            assert rule.name in says
            table = msgspec.to_builtins(rule)
            assert all(tomllib.loads(key).items() <= table.items() for key in keys)


def test_the_command_lines_of_faults_are_possible() -> None:
    lines = re.findall(r"^fleet run (\w+) (--.*)$", section(SCENARIOS, "Shorthands"), re.MULTILINE)
    assert len(lines) == 3
    for name, given_options in lines:
        words = given_options.split()
        given: dict[str, list[str]] = {}
        for option, text in zip(words[::2], words[1::2], strict=True):
            given.setdefault(option.removeprefix("--"), []).append(text)
        assert given.pop("seed", ["1"]) == ["1"]
        assert given.keys() <= set(shorthands())
        assert with_faults(read_scenario(name).scenario, rules_of(given, 0.2), "docs").fault


def test_a_scenario_with_all_kinds_is_possible() -> None:
    table = tomllib.loads('name = "x"\nduration_s = 9\ngenerate = { kind = "converge" }')
    dice = random.Random(1)
    rules = []
    for kind, cls in kinds().items():
        drawn = {**cls.fuzzed(dice, [1, 2]), **cls.fuzzed_whom(dice, [1, 2])}
        rules.append({"kind": kind, **{k: v for k, v in drawn.items() if v is not None}})
    assert [r.name for r in convert({**table, "fault": rules}, "x").fault] == list(kinds())
