"""Of values that are unlike, what is shown is where they are."""

from __future__ import annotations

import re
from typing import Any

import pytest

from fleet.repetition.first_part import unlike_text
from tests.conftest import Cli

LONG = "0123456789" * 10
CANDIDATES = [{"manoeuvre": "turn", "turn_rad": n / 10, "cost": 0.5} for n in range(9)]


@pytest.mark.parametrize(
    ("a", "b", "text"),
    [
        (3, 1, "x: 3 -> 1"),
        (True, False, "x: yes -> no"),
        (["ack", "adsb"], ["adsb", "ack"], "x: ['ack', 'adsb'] -> ['adsb', 'ack']"),
        (None, LONG, f"x: None -> {LONG[:60]}..."),
        (LONG, LONG + "z", "x: ...0123456789 -> ...0123456789z"),
        (LONG, LONG[:50] + "z" + LONG[51:], f"x: ...{LONG[40:]} -> ...{LONG[40:50]}z{LONG[51:]}"),
        ([*range(90)], [*range(80), 7], "x[80]: 80 -> 7"),
        ([*range(90)], [*range(80)], "x[80]: 80 -> (missing)"),
        ({"a": LONG, "b": 1}, {"a": LONG}, "x.b: 1 -> (missing)"),
        ({"a": LONG}, {"a": LONG, "c": 2}, "x.c: (missing) -> 2"),
        (
            [{"target": 2, "candidates": CANDIDATES}],
            [{"target": 2, "candidates": [*CANDIDATES[:4], {**CANDIDATES[4], "cost": 0.75}]}],
            "x[0].candidates[4]: {'manoeuvre': 'turn', 'turn_rad': 0.4, 'cost': 0.5} -> "
            "{'manoeuvre': 'turn', 'turn_rad': 0.4, 'cost': 0.75}",
        ),
        ({"a": [*range(90)]}, {"a": LONG}, f"x.a: {str([*range(90)])[:60]}... -> {LONG[:60]}..."),
        ([*range(90)], {"a": 1}, f"x: {str([*range(90)])[:60]}... -> {{'a': 1}}"),
    ],
)
def test_the_first_part_that_is_unlike_is_shown(a: Any, b: Any, text: str) -> None:
    assert unlike_text("x", a, b) == text


def test_what_is_the_same_is_not_unlike() -> None:
    with pytest.raises(ValueError, match="x is the same"):
        unlike_text("x", [1], [1])


IMPURE = """
import random
from dataclasses import replace
from fleet.agents.geometric import GeometricResolver

class Impure(GeometricResolver):
    def resolve(self, situation):
        return tuple(map(self.dearer, super().resolve(situation)))

    def dearer(self, advisory):
        found = (replace(one, cost=random.random()) for one in advisory.candidates)
        return replace(advisory, candidates=tuple(found))
"""


def test_what_a_resolver_drew_at_random_is_shown(cli: Cli) -> None:
    (cli.folder / "impure.py").write_text(IMPURE)
    path = {"PYTHONPATH": str(cli.folder)}
    near = ("--set", "duration_s=40", "--set", "resolver=impure:Impure", "--bus", "memory")
    flown = cli.run("run", "head_on", *near, "--out", "x.mcap", **path)
    assert flown.returncode == 0, flown.stderr
    again = cli.run("repeat", "x.mcap", "--trust", **path)
    assert again.returncode == 1, again.stderr
    first = again.stdout.splitlines()[1].partition("encounters")[2]
    number = r"0[.][0-9]+(e-\d+)?"
    assert re.fullmatch(rf"\[0\]\.candidates\[0\]\.cost: {number} -> {number}", first)
