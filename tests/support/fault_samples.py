"""What tests of faults share: channels, long streams of messages, and statistics."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hypothesis import settings
from hypothesis import strategies as st

from fleet.faults.channel import Channel
from fleet.faults.draws import LinkMessage
from fleet.faults.rules import Rule

TICK_NS = 100_000_000
MANY = 100_000
fast = settings(deadline=None, derandomize=True, max_examples=50)

link_messages = st.builds(
    LinkMessage,
    st.integers(0, 9),
    st.integers(10, 19),
    st.sampled_from(("adsb", "heartbeat", "election", "cmd", "ack")),
    st.integers(0, 10**6),
    st.integers(0, 10**12),
    st.integers(0, 10**5),
    st.one_of(st.none(), st.floats(0.0, 1e5)),
)


def channel(*rules: Rule, seed: int = 1) -> Channel:
    return Channel(rules, seed, TICK_NS)


def stream(
    count: int = MANY,
    src: int = 1,
    dst: int = 2,
    bits: int = 0,
    distance_m: float | None = None,
) -> list[LinkMessage]:
    """Broadcasts of one UAV as one receiver gets them, one a tick."""
    return [LinkMessage(src, dst, "adsb", n, n * TICK_NS, bits, distance_m) for n in range(count)]


def lost(found: Channel, sent: Sequence[LinkMessage]) -> list[bool]:
    return [bool(found.fate(link_message).dropped_by) for link_message in sent]


def within_99_percent(found: float, probability: float, count: int = MANY) -> bool:
    """Whether a frequency is in the interval that holds 99 % of those of `count` trials."""
    spread = math.sqrt(probability * (1.0 - probability) / count)
    return abs(found - probability) <= 2.576 * spread
