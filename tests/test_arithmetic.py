"""What decides in a run computes by what is the same to the last bit on every machine.

That is IEEE 754's + - * / and square root, and what needs no rounding. The functions of `math` and
numpy that are not in the lists here come from a C library, or go by the processor or the version of
Python; `fleet.model.elementary` has others in their place.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from tests.test_architecture import MODULES

DECIDING = ("model", "faults", "config", "protocol", "node", "agents", "coordinator", "simulation")
CHECKED = [
    name
    for name in MODULES
    if name.startswith(tuple(f"fleet.{p}" for p in DECIDING)) or name == "fleet.fuzz.cases"
]

EXACT_MATH = {"nan", "inf", "pi", "tau", "isnan", "isinf", "isfinite", "floor", "ceil", "copysign"}
EXACT_MATH |= {"sqrt", "remainder", "fsum", "frexp", "ldexp"}
EXACT_MATH |= {"radians", "degrees"}  # one multiplication
EXACT_NUMPY = {"nan", "inf", "pi", "isnan", "isinf", "isfinite", "rint", "copysign", "sign", "abs"}
EXACT_NUMPY |= {
    "sqrt",
    "remainder",
    "frexp",
    "ldexp",
    "floor",
    "minimum",
    "maximum",
    "clip",
    "diff",
    "add",
    "bitwise_count",
}
EXACT_NUMPY |= {"linspace", "arange"}  # the second of integers alone
PLACES = {
    "ndarray",
    "float64",
    "intp",
    "int64",
    "uint64",
    "bool_",
    "object_",
    "array",
    "asarray",
    "fromiter",
    "empty",
    "zeros",
}
PLACES |= {"ones", "full", "zeros_like", "ones_like", "where", "stack", "concatenate", "repeat"}
PLACES |= {"tile", "broadcast_to", "shape", "nonzero", "flatnonzero", "count_nonzero", "argmax"}
PLACES |= {
    "argsort",
    "lexsort",
    "searchsorted",
    "array_split",
    "broadcast_shapes",
    "triu_indices",
    "errstate",
}
"""Of numpy what computes nothing."""

IN_SOME_ORDER = {"sum", "mean", "dot", "prod", "std", "var", "cumsum", "cumprod", "reduce", "trace"}
"""Methods that add or multiply in an order that depends on the processor."""

INTEGERS = {"fleet.faults.clock", "fleet.protocol.account", "fleet.simulation.zenoh_transport"}
"""Modules that sum integers."""

EXPECTATIONS = {"fleet.faults.kinds.latency"}
"""What is expected of a rule, for metrics, decides nothing."""

OTHER_MODULES = {"math", "cmath", "statistics"}
"""Nothing is taken from these by name."""


def problems(name: str, tree: ast.AST) -> Iterator[str]:
    """What a module does that is not the same everywhere."""
    for node in ast.walk(tree):
        for found in (_function(node), _call(name, node), _operator(node), _import(name, node)):
            if found:
                yield f"line {getattr(node, 'lineno', 0)}: {found}"


def _function(node: ast.AST) -> str:
    match node:
        case ast.Attribute(value=ast.Name(id="math"), attr=attr) if attr not in EXACT_MATH:
            return f"math.{attr}"
        case ast.Attribute(value=ast.Name(id="np" | "numpy"), attr=attr):
            return "" if attr in EXACT_NUMPY | PLACES else f"np.{attr}"
    return ""


def _call(name: str, node: ast.AST) -> str:
    match node:
        case ast.Call(func=ast.Attribute(attr=attr)) if attr in IN_SOME_ORDER:
            return f".{attr}(...)"
        case ast.Call(func=ast.Attribute(attr="argsort"), keywords=keywords):
            return "" if "kind" in [k.arg for k in keywords] else "argsort that is not stable"
        case ast.Call(func=ast.Name(id="pow")):
            return "pow(...)"
        case ast.Call(func=ast.Name(id="sum")) if name not in INTEGERS:
            return "sum(...)"
    return ""


def _operator(node: ast.AST) -> str:
    match node:
        case ast.BinOp(op=ast.Pow(), left=left, right=right):
            return "" if _integer(left) and _integer(right) else "**"
        case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.Pow() | ast.MatMult()):
            return "@, **= or @="
        case ast.Constant(value=complex()):
            return "a complex number"
    return ""


def _import(name: str, node: ast.AST) -> str:
    match node:
        case ast.Import(names=names):
            found = {n.name.split(".")[0] for n in names} & (OTHER_MODULES - {"math"})
            return f"import of {found}" if found else ""
        case ast.ImportFrom(module=str(module)) if module != "numpy.typing":
            wrong = module.split(".")[0] in OTHER_MODULES | {"numpy"}
            return f"from {module}" if wrong and name not in EXPECTATIONS else ""
    return ""


def _integer(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int


@pytest.mark.parametrize("name", CHECKED)
def test_what_decides_is_computed_alike_everywhere(name: str) -> None:
    tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
    assert not list(problems(name, tree)), "fleet.model.elementary has it, the same everywhere"


@pytest.mark.parametrize(
    "text",
    [
        "math.sin(x)",
        "math.hypot(x, y)",
        "math.dist(p, q)",
        "math.pow(x, 2)",
        "np.exp(x)",
        "np.hypot(x, y)",
        "np.interp(x, a, b)",
        "np.linalg.norm(x)",
        "np.add.reduce(x)",
        "np.cumsum(x)",
        "values.mean(axis=1)",
        "a @ b",
        "x**2",
        "2.0**-52",
        "x **= 2",
        "sum(values)",
        "1j * x",
        "a.argsort()",
        "from math import sin",
        "from numpy import exp",
        "import statistics",
    ],
)
def test_the_rule_finds(text: str) -> None:
    assert list(problems("fleet.model.any", ast.parse(text)))


@pytest.mark.parametrize("text", ["2**63 - 1", "math.sqrt(x * x)", "dict(**more)", "np.abs(x)"])
def test_the_rule_lets_pass(text: str) -> None:
    assert not list(problems("fleet.model.any", ast.parse(text)))


def test_those_that_are_let_off_are_there_and_need_it() -> None:
    for name in INTEGERS | EXPECTATIONS:
        tree = ast.parse(MODULES[name].read_text(encoding="utf-8"))
        assert list(problems("", tree)), f"{name} needs no exception any more"
