"""What bit flips make of a message on its way."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fleet.protocol import codec
from fleet.protocol.messages import Message
from fleet.protocol.topics import cell_in, topic_of


def read_altered(
    topic: str,
    payload: bytes,
    flips: Sequence[float],
    believe: Callable[[Message, int], bool],
    sent_ns: int,
) -> Message | None:
    """What flipped bits make of a message, if it can still be taken for one of its topic."""
    try:
        message = codec.decode(topic, flipped(payload, flips))
    except ValueError:
        return None
    own = topic_of(message, cell_in(topic)) == topic
    return message if own and believe(message, sent_ns) else None


def flipped(payload: bytes, places: Sequence[float]) -> bytes:
    """A payload with the bits at these places (fractions of its length) flipped."""
    out = bytearray(payload)
    for place in places:
        bit = int(place * 8 * len(out))
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)
