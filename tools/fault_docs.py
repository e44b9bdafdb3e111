"""The tables of the kinds of faults, as the kinds declare themselves."""

from __future__ import annotations

import inspect as python
import json
from collections.abc import Iterable, Sequence

import tomli_w
from msgspec import inspect

from fleet.faults.links import Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, Variation
from fleet.faults.registry import kinds_of, options
from fleet.faults.rules import NodeRule, Rule
from fleet.faults.shorthand import rules_of

KEYS = "| Key | Type | Unit | Default | Range | Meaning |\n|---|---|---|---|---|---|"
KIND_ROW = "| `kind` | text | - | required | - | one of the kinds below |"
PRESET_ROW = "| `--preset` | `wifi` | the rules of a [preset](#presets) |"

UNITS = {
    "bits_per_s": "bit/s",
    "_per_m2": "1/m^2",
    "_per_m": "1/m",
    "_mps": "m/s",
    "_dbm": "dBm",
    "_db": "dB",
    "_ppm": "ppm",
    "_ticks": "tick",
    "_m": "m",
    "_s": "s",
}
"""The unit of a key, by how it ends."""


def shared_keys() -> str:
    """The keys that every rule has."""
    return "\n".join([KEYS, KIND_ROW, *_rows(Rule, None)])


def faults_of_links() -> str:
    """What rules about links have, and each kind."""
    return _group(LinkRule)


def faults_of_participants() -> str:
    """What rules about participants have, and each kind."""
    return _group(NodeRule)


def shorthand_rows() -> str:
    """Each option, an example, and the rule that it makes."""
    rows = ["| Shorthand | Example | What it says |", "|---|---|---|", PRESET_ROW]
    for kind, option in options():
        says = _made(kind, option) if isinstance(option, Shorthand) else _varied(kind, option)
        says += f"; {option.note}" if option.note else ""
        rows.append(f"| `--{option.option}` | `{option.example}` | {says} |")
    return "\n".join(rows)


def _made(kind: str, option: Shorthand) -> str:
    (table,) = rules_of({option.option: [option.example]}, 0.2)
    return f"`{kind}` with {_keys(table)}"


def _varied(kind: str, option: Variation) -> str:
    """What is other than without this option."""
    (other,) = [o.example for _, o in options() if o.option == option.of]
    (plain,) = rules_of({option.of: [other]}, 0.2)
    (table,) = rules_of({option.of: [other], option.option: [option.example]}, 0.2)
    keys = _keys({key: value for key, value in table.items() if plain.get(key) != value})
    return f"{keys} for these" if plain["kind"] == kind else f"instead `{kind}` with {keys}"


def _keys(table: RuleTable) -> str:
    told = [key for key in table if key not in ("kind", "start_s", "end_s")]
    return " and ".join(f"`{key} = {_plain(table[key])}`" for key in told)


def expected_delivery() -> str:
    """With what probability messages pass rules of each kind."""
    rows = ["| Rule | Passes with probability |", "|---|---|"]
    for kind, cls in kinds_of(LinkRule).items():
        if cls.harms & Harm.DROP:
            says = (python.getdoc(cls.passes) or "").replace("\n", " ").rstrip(".")
            rows.append(f"| `{kind}` | {says[0].lower()}{says[1:]} |")
    return "\n".join([*rows, "| others | 1 |"])


def _group(group: type[Rule]) -> str:
    """The keys that a group shares, and a section for each of its kinds."""
    shared = "\n".join([KEYS, *_rows(group, Rule)])
    return "\n\n".join([shared, *(_section(k, cls, group) for k, cls in kinds_of(group).items())])


def _section(kind: str, cls: type[Rule], group: type[Rule]) -> str:
    rows = list(_rows(cls, group))
    parts = [f"#### `{kind}`", python.getdoc(cls) or "", "\n".join([KEYS, *rows]) if rows else ""]
    return "\n\n".join(filter(None, parts))


def _rows(cls: type[Rule], base: type[Rule] | None) -> Iterable[str]:
    """A row for each key that a class has and its base has not."""
    shared = base.__struct_encode_fields__ if base else ()
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    for field in info.fields:
        if field.encode_name not in shared:
            yield _row(field)


def _row(field: inspect.Field) -> str:
    kind = field.type
    assert isinstance(kind, inspect.Metadata), f"{field.name} has no description"
    meaning = (kind.extra_json_schema or {})["description"]
    units = [unit for end, unit in UNITS.items() if field.encode_name.endswith(end)]
    unit = (units or ["-"])[0]
    if field.required:
        default = "required"
    else:
        default = "none" if field.default is None else f"`{_plain(field.default)}`"
    shape, interval = _shape(kind)
    return f"| `{field.encode_name}` | {shape} | {unit} | {default} | {interval} | {meaning} |"


def _shape(kind: inspect.Type) -> tuple[str, str]:
    """The type of a key and the interval of its values."""
    match kind:
        case inspect.Metadata():
            return _shape(kind.type)
        case inspect.UnionType():
            (given,) = (t for t in kind.types if not isinstance(t, inspect.NoneType))
            return _shape(given)
        case inspect.BoolType():
            return "bool", "-"
        case inspect.FloatType() | inspect.IntType():
            low = f"[{_bound(kind.ge)}" if kind.ge is not None else f"({_bound(kind.gt)}"
            high = f"{_bound(kind.le)}]" if kind.le is not None else f"{_bound(kind.lt)})"
            return "float" if isinstance(kind, inspect.FloatType) else "int", f"{low}, {high}"
        case inspect.TupleType():
            shape, interval = _shape(kind.item_types[0])
            return f"{len(kind.item_types)} x {shape}", interval
    return "text", "-"


def _bound(value: float | None) -> str:
    return str(int(value)) if value is not None and value == int(value) else str(value)


def _plain(value: object) -> str:
    """A value as TOML has it."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return json.dumps(list(value))
    return tomli_w.dumps({"x": value}).strip().removeprefix("x = ")
