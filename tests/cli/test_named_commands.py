"""Whoever reads of a command can give it: documents and messages name those that there are."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from fleet.cli import application

ROOT = Path(__file__).parent.parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
MODULES = sorted(
    path for part in ("fleet", "agents", "coordinator") for path in (ROOT / part).rglob("*.py")
)
IN_A_DOCUMENT = re.compile(r"`fleet ([^`]+)`|^(?:\$ )?fleet ([^|#\n]+)", re.MULTILINE)
IN_A_TEXT = re.compile(r"'fleet ([^']+)'|`fleet ([^`]+)`|\n +fleet ([^|#\n]+)")


def named(path: Path) -> Iterator[str]:
    """What a document or the texts of a module say after `fleet`, where it is a command."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield from ("".join(found) for found in IN_A_DOCUMENT.findall(text))
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from ("".join(found) for found in IN_A_TEXT.findall(node.value))


def unknown(said: str, group: Any) -> list[str]:
    """The command, or those options of it, that there are not."""
    words = re.sub(r'"[^"]*"| -- .*', " ", said).split()  # but what other programs are given
    while hasattr(group, "commands") and words and re.match("[a-z]", words[0]):
        name = words.pop(0).rstrip(",;:.")
        if name not in group.commands:
            return [name]
        group = group.commands[name]
    given = re.findall(r"(?<![\w-])--[a-z][a-z-]*", " ".join(words))
    known = {flag for option in group.params for flag in (*option.opts, *option.secondary_opts)}
    return [flag for flag in given if flag not in known | {"--help", "--version"}]


@pytest.fixture(scope="module")
def fleet() -> Any:
    return typer.main.get_command(application([]))


@pytest.mark.parametrize("path", [*PAGES, *MODULES], ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_that_is_named_is_one(path: Path, fleet: Any) -> None:
    assert {said: wrong for said in named(path) if (wrong := unknown(said, fleet))} == {}


def test_a_command_that_is_none_is_found(fleet: Any) -> None:
    assert unknown("nosuch LOG --loss 30%", fleet) == ["nosuch"]
    assert unknown("study nosuch", fleet) == ["nosuch"]
    assert unknown("run four_way --nosuch --loss 30%", fleet) == ["--nosuch"]
    assert unknown("repeat LOG --loss ...", fleet) == []
