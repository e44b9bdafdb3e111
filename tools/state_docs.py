"""The tables of the states of a mandate and of a command."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TypeVar

from fleet.agents.command_states import COMMAND_MEANINGS, COMMAND_STATES
from fleet.agents.mandate_states import MANDATE_STATES, STATE_MEANINGS

S = TypeVar("S", bound=StrEnum)
E = TypeVar("E", bound=StrEnum)


def mandate_states() -> str:
    """How a UAV stands to elections, and what changes that."""
    return _table(STATE_MEANINGS, MANDATE_STATES)


def command_states() -> str:
    """What becomes of a command."""
    return _table(COMMAND_MEANINGS, COMMAND_STATES)


def _table(meanings: Mapping[S, str], after: Mapping[tuple[S, E], S]) -> str:
    """The states with their meanings, and a row for each event with the state after it."""
    events = list(dict.fromkeys(event for _, event in after))
    rows = ["| State | Meaning |", "|---|---|"]
    rows += [f"| `{state}` | {meaning} |" for state, meaning in meanings.items()]
    rows += ["", f"| What happens | {' | '.join(f'in `{state}`' for state in meanings)} |"]
    rows += ["|---" * (len(meanings) + 1) + "|"]
    for event in events:
        cells = [_cell(state, after[state, event]) for state in meanings]
        rows.append(f"| {event} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _cell(before: StrEnum, after: StrEnum) -> str:
    return "-" if after == before else f"`{after}`"
