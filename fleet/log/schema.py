"""The jsonschema of each message class, made from the class itself."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.messages import Logged


def json_schema(cls: type[Logged]) -> dict[str, Any]:
    """The schema of a message class."""
    return self_contained(cls, f"fleet.{cls.__name__}")


def self_contained(cls: type[msgspec.Struct], title: str) -> dict[str, Any]:
    """A JSON schema without references, whose root is the object itself."""
    schema = msgspec.json.schema(cls)
    definitions = schema.pop("$defs", {})
    root: dict[str, Any] = _inlined(schema, definitions)
    root["title"] = title
    return root


def schemas() -> dict[str, bytes]:
    """Class name (as in topics) to its schema, encoded."""
    return {c.kind: json.dumps(json_schema(c)).encode() for c in LOGGED_CLASSES}


def _inlined(node: Any, definitions: dict[str, Any]) -> Any:
    if isinstance(node, list):
        return [_inlined(item, definitions) for item in node]
    if not isinstance(node, dict):
        return node
    reference = node.get("$ref")
    if isinstance(reference, str):
        return _inlined(definitions[reference.rpartition("/")[2]], definitions)
    return {name: _inlined(value, definitions) for name, value in node.items()}
