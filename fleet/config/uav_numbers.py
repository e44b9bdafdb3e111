"""Numbers of UAVs as people write them: `1-8`, `1,2,30-40`."""

from __future__ import annotations

import re
from collections.abc import Iterable

MOST_NUMBERS = 10_000
"""So many a range may have."""
HIGHEST_NUMBER = 1_000_000

_PART = re.compile(r"\s*([0-9]{1,7})\s*(?:-\s*([0-9]{1,7})\s*)?")


def numbers_in(text: str) -> list[int]:
    """The numbers in a list of ranges, each once, in order of mention.

    Raises:
        ValueError: it is none; the message says how to write one.

    """
    found: dict[int, None] = {}
    for part in text.split(","):
        match = _PART.fullmatch(part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not 1 <= first <= last <= HIGHEST_NUMBER or last - first >= MOST_NUMBERS:
            raise ValueError(
                f"'{text[:80]}': IDs from 1, as in 1-8 or 1,2,30-40, at most {MOST_NUMBERS}"
            )
        found |= dict.fromkeys(range(first, last + 1))
    return list(found)


def ranges_of(numbers: Iterable[int]) -> str:
    """The shortest such text for these numbers: `1-3, 7`."""
    ranges: list[list[int]] = []
    for number in sorted(set(numbers)):
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    return ", ".join(_range_text(first, last) for first, last in ranges)


def _range_text(first: int, last: int) -> str:
    if first == last:
        return str(first)
    return f"{first}-{last}" if last > first + 1 else f"{first}, {last}"
