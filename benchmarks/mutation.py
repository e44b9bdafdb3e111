"""Faults put into the code on purpose: how one is applied, and how a tool thinks of more.

A bug names a module, a function in it, and a snippet of that function with what replaces it. It is
applied to the source as the module is imported, in a process of its own: no file is changed. A
snippet that is not there exactly once is an error, so that a list of bugs cannot go stale unseen.

    python -m benchmarks.mutation COUNT SEED MODULE ...     (prints bugs as the list has them)
"""

from __future__ import annotations

import ast
import importlib.abc
import importlib.machinery
import importlib.util
import random
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

LIST = Path(__file__).with_name("protocol_bugs.toml")

SIGNS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", "<"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", ">"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
}
OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.And: ("and", "or"),
    ast.Or: ("or", "and"),
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
}


@dataclass(frozen=True)
class Bug:
    """One fault: `old` in `function` (dotted, within its module) is `new`.

    `equivalent`, if not empty, says why nothing can be wrong with it; `survives` why it is not
    found, though something is wrong.
    """

    name: str
    module: str
    function: str
    old: str
    new: str
    equivalent: str = ""
    survives: str = ""


class StaleBugError(Exception):
    """A bug does not fit the code any more."""


def bugs() -> list[Bug]:
    """The committed list."""
    table = tomllib.loads(LIST.read_text(encoding="utf-8"))
    return [Bug(**entry) for entry in table["bug"]]


def mutated(bug: Bug) -> str:
    """The source of the bug's module with the bug in it; raises StaleBugError."""
    source = _source(bug.module)
    lines = source.splitlines(keepends=True)
    node = _function(ast.parse(source).body, bug.function.split("."))
    if node is None or node.end_lineno is None:
        raise StaleBugError(f"{bug.name}: no {bug.function} in {bug.module}")
    first, last = node.lineno - 1, node.end_lineno
    body = "".join(lines[first:last])
    times = body.count(bug.old)
    if times != 1:
        raise StaleBugError(f"{bug.name}: {bug.function} has the old snippet {times} times")
    return "".join([*lines[:first], body.replace(bug.old, bug.new), *lines[last:]])


class Saboteur(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module with a bug in it."""

    def __init__(self, bug: Bug) -> None:
        self._module = bug.module
        self._code = compile(mutated(bug), f"<{bug.module} with a bug>", "exec")

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The one module is ours."""
        if fullname != self._module:
            return None
        return importlib.util.spec_from_loader(fullname, self)

    def exec_module(self, module: ModuleType) -> None:
        """Run the source that has the bug."""
        exec(self._code, module.__dict__)


def sabotage(bug: Bug) -> None:
    """From now on this process imports the bug's module with the bug in it."""
    if bug.module in sys.modules:
        raise StaleBugError(f"{bug.module} is imported already")
    sys.meta_path.insert(0, Saboteur(bug))


def thought_of(module: str) -> Iterator[Bug]:
    """Every fault of one operator or statement that the tool can think of."""
    source = _source(module)
    for name, function in _functions(ast.parse(source).body, ""):
        text = ast.get_source_segment(source, function) or ""
        for node in ast.walk(function):
            old = ast.get_source_segment(source, node) or ""
            new = _changed(node, old)
            if new and new != old and text.count(old) == 1:
                yield Bug(f"{module.rpartition('.')[2]}.{name}", module, name, old, new)


def _source(module: str) -> str:
    path = Path(__file__).parent.parent.joinpath(*module.split(".")).with_suffix(".py")
    return path.read_text(encoding="utf-8")


def _function(body: Sequence[ast.stmt], names: list[str]) -> ast.FunctionDef | None:
    return next((f for name, f in _functions(body, "") if name.split(".") == names), None)


def _functions(body: Sequence[ast.stmt], inside: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in body:
        if isinstance(node, ast.FunctionDef):
            yield inside + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node.body, f"{inside}{node.name}.")


def _changed(node: ast.AST, text: str) -> str:
    """What a node may become; empty if the tool leaves it alone."""
    match node:
        case ast.Compare(ops=[op]) if type(op) in SIGNS:
            sign, other = SIGNS[type(op)]
            return text.replace(f" {sign} ", f" {other} ", 1)
        case ast.BoolOp(op=op) | ast.BinOp(op=op) if type(op) in OPERATORS:
            word, other = OPERATORS[type(op)]
            return text.replace(f" {word} ", f" {other} ", 1)
        case ast.UnaryOp(op=ast.Not()):
            return text.removeprefix("not ")
        case ast.Call(func=ast.Name(id="max" | "min" as name)):
            return ("min" if name == "max" else "max") + text[3:]
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Assign(targets=[ast.Attribute()]):
            return "pass"
    return ""


def main() -> None:
    """Print a sample."""
    count, seed, *modules = sys.argv[1:]
    found = [bug for module in modules for bug in thought_of(module)]
    print(f"# {count} of {len(found)} faults that the tool thinks of, drawn with seed {seed}")
    for bug in random.Random(int(seed)).sample(found, int(count)):
        print(f'\n[[bug]]\nname = "{bug.name}"')
        print(f'module = "{bug.module}"\nfunction = "{bug.function}"')
        for key, text in (("old", bug.old), ("new", bug.new)):
            quote = "'''" if "\n" in text else "'"
            print(f"{key} = {quote}{text}{quote}")


if __name__ == "__main__":
    main()
