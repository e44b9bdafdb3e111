"""Shrinking: the smallest case that still fails in the same way."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

ShrunkTable = dict[str, Any]


def shrink(
    table: ShrunkTable, fails: Callable[[ShrunkTable], bool], budget: int = 200
) -> ShrunkTable:
    """Make a case simpler, step by step, as long as `fails` says that it still fails.

    At most `budget` cases are tried. `fails` must be False for a table that is no scenario.
    """
    best = table
    again = True
    while again:
        again = False
        for candidate in _simpler(best):
            if budget <= 0:
                return best
            budget -= 1
            if fails(candidate):
                best, again = candidate, True
                break
    return best


def _simpler(table: ShrunkTable) -> Iterator[ShrunkTable]:
    """Cases one step simpler, the boldest steps first."""
    for n in range(len(table["fault"])):
        yield _without(table, "fault", n)
    if len(table["uav"]) > 2:
        for n in range(len(table["uav"])):
            yield _without(table, "uav", n)
    for factor in (0.5, 0.75, 0.9):
        yield {**table, "duration_s": round(table["duration_s"] * factor, 1)}
    for key in ("coordination", "surveillance", "resolution", "zone", "tick_s"):
        if key in table:
            yield {k: v for k, v in table.items() if k != key}
    for n, rule in enumerate(table["fault"]):
        for key in rule:
            if key not in ("kind", "start_s"):
                simpler = copy.deepcopy(table)
                del simpler["fault"][n][key]
                yield simpler


def _without(table: ShrunkTable, key: str, place: int) -> ShrunkTable:
    kept = [item for n, item in enumerate(table[key]) if n != place]
    return {**table, key: kept}
