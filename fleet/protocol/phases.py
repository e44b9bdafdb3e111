"""When in a tick a participant steps in realtime: not all at once, or nobody would be in time.

Multiples of the golden ratio, without what is before the point, lie apart from each other whatever
the numbers are, all of a fleet or those of one host (the low-discrepancy sequence of Weyl).
"""

from __future__ import annotations

_GOLDEN = 0x9E3779B97F4A7C15
"""2^64 over the golden ratio."""
_OF_THE_TICK = 3, 4
"""The last of the tick is left for what is under way to come before the next one."""


def phase_ns(number: int, tick_ns: int) -> int:
    """How long after the time of a tick a participant steps: 0 for the coordinator, number 0."""
    share, whole = _OF_THE_TICK
    return ((number * _GOLDEN) % 2**64 * (share * tick_ns // whole)) >> 64
