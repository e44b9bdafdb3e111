"""Whom a rule concerns: patterns of participants as `*`, `uav`, `coordinator`, `1-4,7`."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

from msgspec import Meta

from fleet.model.types import COORDINATOR

LAST = 1_000_000
"""The highest number of a UAV."""

ONE = r"(coordinator|[1-9]\d{0,6}(-[1-9]\d{0,6})?)"
SOME = rf"{ONE}(,{ONE})*"
WHO = rf"^(\*|uav|{SOME})$"

Who = Annotated[str, Meta(pattern=WHO)]
RuleSpan = tuple[int, int]


def names(who: str, number: int) -> bool:
    """Whether a pattern (`*`, `uav`, `coordinator`, "1-4,7") names this participant."""
    return any(low <= number <= high for low, high in spans(who))


@lru_cache(maxsize=1024)
def spans(who: str) -> tuple[RuleSpan, ...]:
    """First and last numbers that the parts of a pattern name; 0 is the coordinator."""
    return tuple(_span(part) for part in who.split(","))


def _span(part: str) -> RuleSpan:
    if part in _WORDS:
        return _WORDS[part]
    first, _, last = part.partition("-")
    return int(first), int(last or first)


_WORDS: dict[str, RuleSpan] = {
    "*": (COORDINATOR, LAST),
    "uav": (1, LAST),
    "coordinator": (COORDINATOR, COORDINATOR),
}
