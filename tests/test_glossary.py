"""One word for one thing: names and texts use the words of docs/glossary.md, each for one thing."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
MODULES = sorted(
    path for part in ("fleet", "agents", "coordinator") for path in (ROOT / part).rglob("*.py")
)
BESIDE = sorted(
    path
    for part in ("benchmarks", "examples", "tests", "tools")
    for path in (ROOT / part).rglob("*.py")
)
"""Code that is not installed; its names may be defined twice, as `main` is."""
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term")
]
PROSE = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
OTHER_SENSE = (
    *("sign of life", "escape sequences", "as escapes", "with escapes", "error escape"),
    "ros2 bag play",
)
"""Phrases in which such a word means something else."""
GENERAL = {"aim", "option", "order", "collision", "route", "frame", "lease", "checksum", "range"}
GENERAL |= {"cluster", "leader", "guard", "epoch", "trace", "lookahead", "mission", "vote", "roll"}
"""Words that also mean something else, which may be named so."""


HOOKS = {"register"}
"""What the command line calls in each of its modules."""


def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def identifiers(path: Path) -> Iterator[str]:
    """Names that a module gives to something."""
    for node in ast.walk(tree(path)):
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.arg(arg=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name


def _plain(identifier: str) -> str:
    """A name without phrases in which a word means something else."""
    for phrase in OTHER_SENSE:
        identifier = identifier.replace(phrase.replace(" ", "_"), "")
    return identifier


def words(identifier: str) -> set[str]:
    return {w.lower() for w in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)}


def prose(path: Path) -> str:
    """Texts and comments of a module (docstrings only if BESIDE); of a document what is no code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return re.sub(
            r"`[^`\n]+`", "", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
        )
    comments = [
        token.string
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    ]
    nodes = ast.walk(ast.parse(text))
    if path in BESIDE:
        nodes = (node.value for node in nodes if isinstance(node, ast.Expr))
    strings = [
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    return "\n".join([*comments, *strings])


def second_names() -> set[str]:
    """Single words that the glossary says are not used."""
    told = {word.strip() for *_, other in ROWS for word in other.split(",")}
    return {word for word in told if re.fullmatch("[a-z]+", word)} - GENERAL


def test_the_glossary_names_what_is_not_said() -> None:
    assert {"ledger", "escape", "advice", "station", "crew", "beat"} <= second_names()


@pytest.mark.parametrize("path", [*MODULES, *BESIDE], ids=lambda p: str(p.relative_to(ROOT)))
def test_nothing_has_a_second_name(path: Path) -> None:
    wrong = {
        name: sorted(said)
        for name in identifiers(path)
        if (said := {w.removesuffix("s") for w in words(_plain(name))} & second_names())
    }
    if path.name in ("printing.py", "rerun_view.py", "test_printing.py"):
        wrong = {name: said for name, said in wrong.items() if said != ["escape"]}
    assert wrong == {}


def test_every_name_of_the_glossary_is_in_the_code() -> None:
    said = {word for path in MODULES for word in identifiers(path)}
    told = {name for row in ROWS for name in re.findall(r"`([A-Za-z_]+)`", row[2])}
    assert told - said <= {"cmd", "sim", "simulation", "adsb", "resume"}


def top_level(path: Path) -> Iterator[str]:
    """Public names that a module defines."""
    for node in tree(path).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.Assign(targets=targets):
                yield from (t.id for t in targets if isinstance(t, ast.Name))
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name


def test_no_public_name_is_defined_twice() -> None:
    where: defaultdict[str, list[str]] = defaultdict(list)
    for path in MODULES:
        for name in top_level(path):
            if not name.startswith("_") and name not in HOOKS:
                where[name].append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in where.items() if len(paths) > 1} == {}


@pytest.mark.parametrize(
    "path",
    [p for p in [*MODULES, *BESIDE, *PROSE] if p.name != "glossary.md"],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_comments_and_documents_use_the_words_of_the_glossary_too(path: Path) -> None:
    text = " ".join(prose(path).lower().split())
    for phrase in OTHER_SENSE:
        text = text.replace(phrase, "")
    said = set(re.findall("[a-z]+", text))
    assert {name for name in second_names() if {name, f"{name}s"} & said} == set()
