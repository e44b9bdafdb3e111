"""The bugs by which the power of `fleet fuzz` is measured: each fits the code, and is applied."""

from __future__ import annotations

import subprocess
import sys

import pytest

from benchmarks.fuzz_power import verdict
from benchmarks.mutation import Bug, StaleBugError, bugs, mutated, thought_of

LIST = bugs()


def test_there_are_enough_bugs_of_different_names() -> None:
    assert len({bug.name for bug in LIST}) == len(LIST)
    assert sum(not bug.equivalent for bug in LIST) >= 50


@pytest.mark.parametrize("bug", LIST, ids=lambda bug: bug.name)
def test_a_bug_fits_the_code(bug: Bug) -> None:
    compile(mutated(bug), bug.module, "exec")
    assert bug.old != bug.new


@pytest.mark.parametrize(
    ("function", "old", "problem"),
    [
        ("refusal", "no such snippet", "0 times"),
        ("refusal", "return", "times"),
        ("nowhere", "return", "no nowhere"),
    ],
)
def test_a_bug_that_does_not_fit_is_an_error(function: str, old: str, problem: str) -> None:
    with pytest.raises(StaleBugError, match=problem):
        mutated(Bug("x", "fleet.agents.obedience", function, old, "y"))


def test_a_bug_is_imported_with_the_module_and_found() -> None:
    """In a process of its own; a UAV that remembers no command obeys copies, as seed 2 has them."""
    program = (
        "from benchmarks.fuzz_power import hunt\n"
        "from benchmarks.mutation import bugs\n"
        "bug = next(b for b in bugs() if b.name == 'agent: applied command not remembered')\n"
        "print(hunt(bug, 2, 20))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "obeyed once, in order" in done.stdout


def test_the_tool_changes_operators_and_leaves_out_statements() -> None:
    found = {(bug.function, bug.old, bug.new) for bug in thought_of("fleet.agents.obedience")}
    assert ("refusal", "now_ns > command.expiry_ns", "now_ns >= command.expiry_ns") in found
    assert ("refusal", "not mandate.in_force(now_ns)", "mandate.in_force(now_ns)") in found
    statements = {bug.old for bug in thought_of("fleet.agents.vehicle") if bug.new == "pass"}
    assert "self._pending = scheduled" in statements


def test_a_row_says_what_found_it_or_why_not() -> None:
    bug = Bug("x", "m", "f", "a", "b")
    assert verdict(bug, ["hang"]) == "hang"
    assert verdict(bug, []) == "NOT FOUND: unexplained"
    assert verdict(Bug("x", "m", "f", "a", "b", equivalent="so"), []) == "no bug: so"
    assert verdict(Bug("x", "m", "f", "a", "b", survives="so"), []) == "NOT FOUND: so"
