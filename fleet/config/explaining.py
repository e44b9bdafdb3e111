"""What types find wrong with a scenario, as key, problem and remedy."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from fleet.config.scenario import Scenario
from fleet.faults import registry
from fleet.faults.options import RuleTable
from fleet.faults.registry import kinds
from fleet.faults.rules import Rule
from fleet.model.vehicle.registry import OWN_MODELS, models
from fleet.protocol.classes import DELIVERY_ORDER

_WHO = "'*', 'uav', 'coordinator' or a list, as '1-4,7'"
_FORMS = {
    "name": "1 to 64 letters, digits, '-' or '_'",
    "src": _WHO,
    "dst": _WHO,
    "node": _WHO,
    "class": f"'*' or some of {', '.join(DELIVERY_ORDER)}, as 'cmd,ack'",
    "groups": "two groups or more, as '1-3/4,coordinator'",
}
"""What text has to look like, in words, by key."""


def explained(message: str, table: dict[str, Any]) -> str:
    """Msgspec's message as key, problem and remedy."""
    what, _, where = message.partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    said = _as_set(path, table)
    unknown = re.match(r"Object contains unknown field `(.*)`", what)
    if unknown:
        return f"{said}.{unknown[1]}: {_unknown_key(unknown[1], path, table)}".lstrip(".")
    missing = re.match(r"Object missing required field `(.*)`", what)
    if missing:
        return f"{f'{said}.{missing[1]}'.lstrip('.')}: missing; add it"
    form = _FORMS.get(path.rpartition(".")[2])
    if form and "matching regex" in what:
        return f"{said}: expected {form}"
    if path.endswith("kind"):
        possible = ("converge", "crossing") if path.startswith("generate") else tuple(kinds())
        return f"{said}: {_words(what)}; use one of {', '.join(possible)}"
    if path.endswith("vehicle"):
        names = ", ".join(models())
        return f"{said}: {_words(what)}; use one of {names}, or name its module in {OWN_MODELS}"
    return f"{said}: {_words(what)}"


def plainly(message: str, forms: Mapping[str, str]) -> str:
    """Msgspec's message about any table as key, problem and remedy.

    `forms` says by key what text has to look like.
    """
    what, _, where = message.partition(" - at `$")
    path = where.rstrip("`").lstrip(".")
    named = re.match(r"Object (contains unknown|missing required) field `(.*)`", what)
    if named:
        problem = (
            "missing; add it" if named[1].startswith("missing") else "unknown key; leave it out"
        )
        return f"{path}.{named[2]}".lstrip(".") + f": {problem}"
    form = forms.get(re.sub(r"\[\d+\]", "", path))
    if form and "matching regex" in what:
        return f"{path}: expected {form}"
    if form and what.startswith("Invalid"):
        return f"{path}: {_words(what)}; expected {form}"
    return f"{path}: {_words(what)}".removeprefix(": ")


def plan_of_tables(tables: Sequence[RuleTable]) -> tuple[Rule, ...]:
    """The rules of `[[fault]]` tables; raises ValueError, with key, problem and remedy."""
    try:
        return msgspec.convert(tables, tuple[registry.FaultRule, ...])
    except msgspec.ValidationError as error:
        what = str(error).replace("`$[", "`$.fault[")
        raise ValueError(explained(what, {"fault": tables})) from error


def _unknown_key(key: str, path: str, table: dict[str, Any]) -> str:
    """What is possible in place of a key, or in which other table it would be."""
    this, *others = _tables_at(path, table)
    known = _keys_of(this)
    having = [f"'{_tag(other)}'" for other in others if key in _keys_of(other)]
    if having:
        what = f"of {_tag_key(this)} '{_tag(this)}', but one of {', '.join(having)}"
        return f"unknown key {what}; possible here: {', '.join(known)}"
    return f"unknown key{nearest(key, known)}; possible here: {', '.join(known)}"


def _as_set(path: str, table: dict[str, Any]) -> str:
    """A path with its UAV named by ID, as `--set` does; by its place only if no ID says which."""
    found = re.match(r"uav\[(\d+)\]", path)
    if not found:
        return path
    place, uavs = int(found[1]), table["uav"]
    ids = [uav.get("id") if isinstance(uav, dict) else None for uav in uavs]
    own = ids[place]
    if type(own) is int and ids.count(own) == 1:
        return f"uav.{own}{path[found.end() :]}"
    return f"uav (table {place + 1} of {len(uavs)}){path[found.end() :]}"


def _words(what: str) -> str:
    replaced = what.replace(" | null`", "`").replace("`", "'").replace("Expected ", "expected ")
    for name, word in (("'float'", "a number"), ("'int'", "a whole number"), ("'str'", "text")):
        replaced = replaced.replace(name, word)
    replaced = replaced.replace("'array'", "a list").replace("'object'", "a table")
    return replaced[0].lower() + replaced[1:]


def _tables_at(path: str, table: dict[str, Any]) -> list[Any]:
    """The classes of tables that may be at a path; the one that is given there is the first."""
    current: list[Any] = [Scenario]
    holder: Any = Scenario
    given: Any = table
    for part in filter(None, re.split(r"[.\[\]]+", path)):
        if part.isdigit():
            given = given[int(part)]
        else:
            given = given[part]
            holder = {f.encode_name: f.type for f in msgspec.structs.fields(current[0])}[part]
        current = _structs_in(holder, given if isinstance(given, dict) else {})
    return current


def _structs_in(kind: Any, given: dict[str, Any]) -> list[Any]:
    """The Structs that a field's type can hold; first the one whose tag is given."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return [kind]
    found = [s for a in getattr(kind, "__args__", ()) for s in _structs_in(a, given)]
    return sorted(found, key=lambda s: _tag(s) is None or _tag(s) != given.get(_tag_key(s)))


def _keys_of(table: Any) -> list[str]:
    tag = _tag_key(table)
    return [tag] * bool(tag) + [f.encode_name for f in msgspec.structs.fields(table)]


def _tag_key(table: Any) -> str:
    """The key by which a table says which of several it is, as `kind`; empty if there is none."""
    return table.__struct_config__.tag_field or ""


def _tag(table: Any) -> Any:
    return table.__struct_config__.tag


def nearest(word: str, words: Iterable[str]) -> str:
    """As in ` (did you mean 'radius_m'?)`; empty if no word is near."""
    near = difflib.get_close_matches(word, list(words), n=1)
    return f" (did you mean '{near[0]}'?)" if near else ""
