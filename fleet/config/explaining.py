"""What types find wrong with a scenario, as key, problem and remedy."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

import msgspec

from fleet.config.scenario import Scenario
from fleet.faults.registry import kinds
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
        known = _known_keys(path, table)
        near = nearest(unknown[1], known)
        key = f"{said}.{unknown[1]}".lstrip(".")
        return f"{key}: unknown key{near}; possible here: {', '.join(known)}"
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
    replaced = what.replace("`", "'").replace("Expected ", "expected ")
    for name, word in (("'float'", "a number"), ("'int'", "a whole number"), ("'str'", "text")):
        replaced = replaced.replace(name, word)
    replaced = replaced.replace("'array'", "a list").replace("'object'", "a table")
    return replaced[0].lower() + replaced[1:]


def _known_keys(path: str, table: dict[str, Any]) -> list[str]:
    """The keys that the table at a path may have."""
    current: Any = Scenario
    holder: Any = Scenario
    given: Any = table
    for part in filter(None, re.split(r"[.\[\]]+", path)):
        if part.isdigit():
            given = given[int(part)]
        else:
            given = given[part]
            holder = {f.encode_name: f.type for f in msgspec.structs.fields(current)}[part]
        current = _struct_in(holder, given if isinstance(given, dict) else {})
        if current is None:
            return []
    tag = current.__struct_config__.tag_field
    return [tag] * bool(tag) + [f.encode_name for f in msgspec.structs.fields(current)]


def _struct_in(kind: Any, given: dict[str, Any]) -> Any:
    """The Struct that a field's type holds: of several that whose tag is given, or the first."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind
    found = [_struct_in(a, given) for a in getattr(kind, "__args__", ())]
    structs = [f for f in found if f is not None]
    tagged = [s for s in structs if s.__struct_config__.tag == given.get(_tag_field(s))]
    return next(iter(tagged + structs), None)


def _tag_field(table: Any) -> str:
    return str(table.__struct_config__.tag_field)


def nearest(word: str, words: Iterable[str]) -> str:
    """As in ` (did you mean 'radius_m'?)`; empty if no word is near."""
    near = difflib.get_close_matches(word, list(words), n=1)
    return f" (did you mean '{near[0]}'?)" if near else ""
