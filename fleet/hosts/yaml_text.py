"""Plain tables and lists as YAML, in block style; texts are quoted as in JSON, which YAML reads."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

YamlValue: TypeAlias = "str | int | bool | Mapping[str, YamlValue] | Sequence[YamlValue]"


_UNPRINTABLE = re.compile("[\\x7f-\\x9f\\u2028\\u2029\\ud800-\\udfff\\ufeff\\ufffe\\uffff]")
"""What YAML wants escaped, and JSON does not."""


def yaml_text(value: YamlValue) -> str:
    """A document, with a line feed at its end."""
    return "\n".join(_lines(value)) + "\n"


def _lines(value: YamlValue) -> Iterator[str]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _entry(f"{key}:", "  ", inner)
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for inner in value:
            first, *rest = list(_lines(inner)) if _nested(inner) else [_flat(inner)]
            yield f"- {first}"
            yield from (f"  {line}" for line in rest)


def _entry(begin: str, indent: str, value: YamlValue) -> Iterator[str]:
    if _nested(value):
        yield begin
        yield from (f"{indent}{line}" for line in _lines(value))
    else:
        yield f"{begin} {_flat(value)}"


def _nested(value: YamlValue) -> bool:
    """Whether it needs lines of its own: a list of plain values goes into one."""
    if isinstance(value, Mapping):
        return bool(value)
    if isinstance(value, str) or not isinstance(value, Sequence):
        return False
    return any(isinstance(inner, Mapping) for inner in value)


def _flat(value: YamlValue) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
