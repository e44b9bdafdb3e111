"""A hostile message as a fuzzer keeps it: where and when it is put, and what goes with it."""

from __future__ import annotations

import random
import struct

import msgspec

from tests.hostile.mutation import (
    INTEGERS,
    changed_text,
    mutated_bytes,
    mutated_payload,
    pick,
)

SHIFTED, LISTED, MANY, FAULTY, REALTIME = 1, 2, 4, 8, 16
"""Marks of an input: its times are moved to now; its number is that of a message that is due; it is
put to a fleet of many; to one under faults; to the simulation of a realtime run."""
_TIME = struct.Struct("<q")


class HostileInput(msgspec.Struct, frozen=True, array_like=True):
    """A message, and where and when it is put."""

    marks: int
    topic: str
    attachment: bytes
    payload: bytes


def read_input(data: bytes) -> HostileInput:
    """The input of some bytes; bytes that are none are a payload."""
    try:
        return msgspec.msgpack.decode(data, type=HostileInput)
    except (ValueError, RecursionError):
        return HostileInput(SHIFTED | LISTED, "1/adsb/0", b"", data)


def input_bytes(marks: int, topic: str, payload: bytes, attachment: bytes = b"") -> bytes:
    """An input as bytes."""
    return msgspec.msgpack.encode(HostileInput(marks, topic, attachment, payload))


def mutated_input(rng: random.Random, data: bytes) -> bytes:
    """Another input: most often another payload, now and then another topic, attachment or time."""
    old = read_input(data)
    marks, topic, attachment, payload = old.marks, old.topic, old.attachment, old.payload
    turn = rng.random()
    if turn < 0.8:
        payload = mutated_payload(rng, payload)
    elif turn < 0.9:
        marks = SHIFTED | LISTED | int(rng.random() * 8) << 2
        marks ^= (rng.random() < 0.2) * SHIFTED | (rng.random() < 0.2) * LISTED
    elif turn < 0.95:
        topic = _changed_topic(rng, topic)
    else:
        attachment = _any_attachment(rng, attachment)
    return input_bytes(marks, topic, payload, attachment)


def _changed_topic(rng: random.Random, topic: str) -> str:
    issuer, _, rest = topic.partition("/")
    if rng.random() < 0.6:
        return f"{pick(rng, ('1', '2', '3', '12', 'coordinator', '0', '99', 'sim', ''))}/{rest}"
    if rng.random() < 0.5:
        return (
            f"{issuer}/{rest.partition('/')[0]}/{pick(rng, ('0', '1', '2', '3', '1_-1', '', 'x'))}"
        )
    return changed_text(rng, topic).encode("utf-8", "replace").decode()


def _any_attachment(rng: random.Random, attachment: bytes) -> bytes:
    if rng.random() < 0.3:
        return mutated_bytes(rng, attachment)[:100]
    size = pick(rng, (8, 16, 32, 40))
    numbers = [_TIME.pack(min(pick(rng, INTEGERS), 2**63 - 1)) for _ in range(size // 8)]
    return b"".join(numbers)
