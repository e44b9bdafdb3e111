"""The election rule, shared by the coordinator and the UAVs: the lowest eligible ID computes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Mandate:
    """One election: in this term this UAV computes for these members, until then."""

    term: int
    members: tuple[int, ...]
    computing: int
    valid_until_ns: int


def lowest_eligible(
    members: Iterable[int], last_heard_ns: Mapping[int, int], now_ns: int, silence_limit_ns: int
) -> int | None:
    """The lowest ID among the members not silent for longer than the limit, if any."""
    eligible = (
        m for m in members if m in last_heard_ns and now_ns - last_heard_ns[m] <= silence_limit_ns
    )
    return min(eligible, default=None)
