"""MessagePack maps with named fields, checked on decoding.

A payload that is not exactly one well-formed message of the class its topic names is rejected with
`ValueError`: truncation, trailing bytes, NaN, infinities, values out of bounds, unknown and missing
fields.
"""

from __future__ import annotations

import msgspec

from fleet.protocol.classes import MESSAGES
from fleet.protocol.messages import Clock, Logged, Message
from fleet.protocol.topics import topic_of

_encoder = msgspec.msgpack.Encoder()
_decoders = {m.kind: msgspec.msgpack.Decoder(m) for m in MESSAGES}
_LONG, _SHORT = 0xDE, 15
"""How a map of more fields than `_SHORT` begins, before their number in two bytes."""
_clock = msgspec.msgpack.Decoder(Clock)


def encode(message: Logged) -> bytes:
    """The message as a MessagePack map."""
    payload = _encoder.encode(message)
    if payload[0] == _LONG and payload[2] <= _SHORT and not payload[1]:
        # msgspec makes room for fields that are left out; the shortest form has none
        return bytes((0x80 | payload[2],)) + payload[3:]
    return payload


def on_wire(message: Message, cell: str = "") -> tuple[str, bytes]:
    """Topic and payload of a message, whose issuer is in this cell if the run has any."""
    return topic_of(message, cell), encode(message)


def decode(topic: str, payload: bytes) -> Message:
    """The message of a topic `issuer/class[/...]`.

    Raises:
        ValueError: the class is unknown or the payload is not a valid message of it.

    """
    return decode_as(kind_of(topic), payload)


def decode_as(kind: str, payload: bytes) -> Message:
    """The message of a class; raises ValueError as `decode` does."""
    decoder = _decoders.get(kind)
    if decoder is None:
        raise ValueError(f"no message class '{kind}'.")
    return decoder.decode(payload)


def decode_clock(payload: bytes) -> Clock:
    """A message of the simulation's clock; raises ValueError as `decode` does."""
    return _clock.decode(payload)


def kind_of(topic: str) -> str:
    """The class named by a topic `issuer/class[/...]`; empty if it names none."""
    _, _, rest = topic.partition("/")
    return rest.partition("/")[0]
