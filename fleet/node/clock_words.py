"""The simulation's word, as participants take it."""

from __future__ import annotations

from fleet.faults.plan import plan_of
from fleet.protocol import codec
from fleet.protocol.messages import Clock
from fleet.protocol.sample import Sample

FOREVER_NS = 2**62

READY = -1
"""The tick of which a process reports that it is ready."""


def clock_of(arrival: Sample) -> Clock | None:
    """The simulation's word, if it is one that can be understood."""
    try:
        clock = codec.decode_clock(arrival.payload)
        if clock.plan:
            plan_of(clock.plan)
    except (ValueError, RecursionError):
        return None
    return None if arrival.flaw else clock
