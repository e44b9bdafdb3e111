"""What the package raises on purpose is one tree, and stands in one module."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

from fleet import errors

ROOT = Path(__file__).parent.parent
PARTS = ("fleet", "agents", "coordinator")
INTERNAL = {
    "AnswerError",
    "DamagedError",
    "HangError",
    "InterruptedCommandError",
    "MisfitError",
    "NoReplyError",
    "NotTriedError",
    "RefusedError",
    "StalledError",
}
"""Caught where they are raised for: none of them reaches who calls this package."""


def test_all_errors_have_one_base() -> None:
    found = dict(inspect.getmembers(errors, inspect.isclass))
    assert len(found) > 8
    assert all(issubclass(error, errors.FleetError) for error in found.values())


def test_no_other_module_defines_an_error_that_a_caller_sees() -> None:
    elsewhere = set()
    for path in (p for part in PARTS for p in (ROOT / part).rglob("*.py")):
        if path.name != "errors.py":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    bases = [ast.unparse(base) for base in node.bases]
                    if any(base.endswith(("Error", "Exception")) for base in bases):
                        elsewhere.add(node.name)
    assert elsewhere == INTERNAL


def test_a_scenario_is_an_argument_too() -> None:
    with pytest.raises(ValueError, match="raise generate"):
        raise errors.TooDenseError("no room; raise generate.radius_m")
