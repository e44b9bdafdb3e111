"""Two values that are unlike, shown where they are first unlike, however long they are."""

from __future__ import annotations

from typing import Any

from fleet.analysis.words import plain_text

WIDEST_VALUE = 60
"""Characters of a value that are shown."""
SHOWN_BEFORE = 10
"""Characters of a longer text that are shown before the first unlike one."""

MISSING = "(missing)"
"""What stands for a part that only the other value has."""


def unlike_text(name: str, a: Any, b: Any) -> str:
    """As in `computing: 3 -> 1`, or `encounters[0].candidates[2].cost: 1.0 -> 1.5` of long values.

    Raises:
        ValueError: the values are the same.

    """
    if a == b:
        raise ValueError(f"{name} is the same in both")
    while max(len(plain_text(a)), len(plain_text(b))) > WIDEST_VALUE:
        part = _first_part(a, b)
        if part is None:
            break
        step, a, b = part
        name += step
    return f"{name}: {' -> '.join(_cut(plain_text(a), plain_text(b)))}"


def _first_part(a: Any, b: Any) -> tuple[str, Any, Any] | None:
    """The first part of two values that is unlike, and how it is named; None if they have none."""
    if isinstance(a, dict) and isinstance(b, dict):
        key = next(k for k in (*a, *b) if a.get(k, MISSING) != b.get(k, MISSING))
        return f".{key}", a.get(key, MISSING), b.get(key, MISSING)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        shorter = min(len(a), len(b))
        place = next((n for n in range(shorter) if a[n] != b[n]), shorter)
        one, other = (v[place] if place < len(v) else MISSING for v in (a, b))
        return f"[{place}]", one, other
    return None


def _cut(a: str, b: str) -> tuple[str, str]:
    """Both texts from shortly before the first character that is unlike, if one is too long."""
    if max(len(a), len(b)) <= WIDEST_VALUE:
        return a, b
    shorter = min(len(a), len(b))
    first = next((n for n in range(shorter) if a[n] != b[n]), shorter)
    begin = max(0, first - SHOWN_BEFORE)
    return _from(begin, a), _from(begin, b)


def _from(begin: int, text: str) -> str:
    rest = text[begin:]
    shown = rest if len(rest) <= WIDEST_VALUE else f"{rest[:WIDEST_VALUE]}..."
    return f"...{shown}" if begin else shown
