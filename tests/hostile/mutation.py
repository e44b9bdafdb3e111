"""Mutation of what is read: trees of MessagePack, JSON and TOML, text, and plain bytes.

All draws come from the random generator that is handed over, so an input follows from its seed.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import msgpack

T = TypeVar("T")

INTEGERS = (
    0, 1, 2, 3, -1, 7, 100, 999, 2**31 - 1, 2**31, 2**32, 2**52, 2**52 + 1, 2**53 - 1, 2**53,
    2**62 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1, -(2**31), -(2**53), -(2**62), -(2**63),
)  # fmt: skip
FLOATS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 5e-324, 1e-9, 3.141592653589793, -3.141592653589793,
    6.283185307179586, 7.0, -7.0, 25.0, 999.999, 1e3, -1e3, 1e6, 1e7, -1e7, 1e12, 1e15, 1e100,
    1e300, 1.7976931348623157e308, float("inf"), float("-inf"), float("nan"),
)  # fmt: skip
TEXTS = (
    "", "turn", "climb", "turn_climb", "speed", "resume", "full", "plan", "stop", "run", "epoch",
    "none", "x" * 64, "x" * 65, "x" * 5000, "\x00", "\x1b[2J", "\ud7ff", "\U0001f6e9", "-1", "1",
    "é" * 40, "../../etc/passwd", "%s%n{0}", "1/adsb/0", "*", "**", "a/b/c", "[]", "{}", "null",
)  # fmt: skip
DEPTHS = (3, 40, 200, 2000)
MOST_BYTES = 20_000
"""No mutated input is longer."""


def pick(rng: random.Random, items: Sequence[T]) -> T:
    """One of several."""
    return items[int(rng.random() * len(items))]


def integer_near(rng: random.Random, value: int) -> int:
    """A number beside another one, or an extreme one."""
    turn = rng.random()
    if turn < 0.35:
        return value + pick(rng, (-2, -1, 1, 2, 100_000_000, -100_000_000, 1 << 33))
    if turn < 0.5:
        return value ^ (1 << int(rng.random() * 63))
    if turn < 0.6:
        return int(rng.random() * 10)
    return int(pick(rng, INTEGERS))


def float_near(rng: random.Random, value: float) -> float:
    """A number beside another one, or an extreme one."""
    turn = rng.random()
    if turn < 0.25:
        return value + rng.gauss(0.0, 1.0)
    if turn < 0.4:
        return value + rng.gauss(0.0, 500.0)
    if turn < 0.5:
        return -value
    if turn < 0.65:
        return value * pick(rng, (0.5, 2.0, 1e3, 1e-3, 1e7))
    return float(pick(rng, FLOATS))


def any_value(rng: random.Random) -> Any:
    """A value of any type."""
    kind = int(rng.random() * 9)
    if kind == 0:
        return pick(rng, INTEGERS)
    if kind == 1:
        return pick(rng, FLOATS)
    if kind == 2:
        return pick(rng, TEXTS)
    if kind == 3:
        return rng.random() < 0.5
    if kind == 4:
        return [any_value(rng) for _ in range(int(rng.random() * 4))]
    if kind == 5:
        return {pick(rng, TEXTS): any_value(rng) for _ in range(int(rng.random() * 4))}
    if kind == 6:
        return pick(rng, TEXTS).encode("utf-8", "surrogatepass")
    return nested(pick(rng, DEPTHS), rng.random() < 0.5) if kind == 7 else None


def nested(depth: int, maps: bool) -> Any:
    """Arrays or maps in one another."""
    value: Any = 0
    for _ in range(depth):
        value = {"x": value} if maps else [value]
    return value


def changed_leaf(rng: random.Random, value: Any) -> Any:
    """Another value in the place of one, most often of its type."""
    if rng.random() < 0.1:
        return any_value(rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return integer_near(rng, value) if rng.random() < 0.95 else float(value)
    if isinstance(value, float):
        return float_near(rng, value)
    if isinstance(value, str):
        return pick(rng, TEXTS) if rng.random() < 0.7 else changed_text(rng, value)
    return any_value(rng)


def changed_text(rng: random.Random, text: str) -> str:
    """A text with a piece left out, doubled, or something put in."""
    begin = int(rng.random() * (len(text) + 1))
    end = min(len(text), begin + int(rng.random() * 12))
    put_in = pick(rng, ("", text[begin:end] * 2, pick(rng, TEXTS), pick(rng, "0\n\t\"'[]{}=,#-.e")))
    return text[:begin] + put_in + text[end:]


def mutated_tree(rng: random.Random, tree: Any, share: float = 0.0) -> Any:
    """A copy of a tree with something changed at one place.

    `share` is the probability that the change is at this node rather than further below.
    """
    if isinstance(tree, dict) and tree:
        return _changed_map(rng, tree, share)
    if isinstance(tree, list | tuple) and tree:
        return _changed_array(rng, list(tree), share)
    return changed_leaf(rng, tree)


def _changed_map(rng: random.Random, tree: dict[Any, Any], share: float) -> dict[Any, Any]:
    copy = dict(tree)
    name = pick(rng, list(copy))
    turn = rng.random()
    if turn > 0.06 + share:
        copy[name] = mutated_tree(rng, copy[name], 0.15)
    elif turn < 0.02:
        del copy[name]
    elif turn < 0.04:
        copy[pick(rng, TEXTS)] = any_value(rng)
    else:
        copy[pick(rng, list(copy))] = copy[name]
    return copy


def _changed_array(rng: random.Random, copy: list[Any], share: float) -> Any:
    place = int(rng.random() * len(copy))
    turn = rng.random()
    if turn > 0.15 + share:
        copy[place] = mutated_tree(rng, copy[place], 0.15)
    elif turn < 0.05:
        del copy[place]
    elif turn < 0.1:
        copy.insert(place, copy[place])
    elif turn < 0.12:
        copy = copy * int(2 + rng.random() * 100)
    elif turn < 0.16:
        return changed_leaf(rng, None)
    else:
        copy[place] = copy[int(rng.random() * len(copy))]
    return copy


def mutated_bytes(rng: random.Random, data: bytes) -> bytes:
    """Bytes with bits flipped, cut off, put in or doubled."""
    out = bytearray(data)
    for _ in range(1 + int(rng.random() * 3)):
        place = int(rng.random() * (len(out) + 1))
        turn = rng.random()
        if turn < 0.4 and place < len(out):
            out[place] ^= 1 << int(rng.random() * 8)
        elif turn < 0.6 and place < len(out):
            out[place] = pick(rng, (0, 1, 0x7F, 0x80, 0x90, 0xC0, 0xC1, 0xCB, 0xDF, 0xFF))
        elif turn < 0.7:
            del out[place : place + 1 + int(rng.random() * 8)]
        elif turn < 0.8:
            del out[place:]
        else:
            piece = out[place : place + 1 + int(rng.random() * 16)]
            out[place:place] = piece if rng.random() < 0.5 else rng.randbytes(4)
    return bytes(out)


Unpack = Callable[[bytes], Any]
Pack = Callable[[Any], bytes]


def unpacked(data: bytes) -> Any:
    """The tree of a MessagePack payload; raises ValueError."""
    return msgpack.unpackb(data, strict_map_key=False)


def packed(tree: Any) -> bytes:
    """The payload of a tree; raises ValueError or OverflowError."""
    out: bytes = msgpack.packb(tree, unicode_errors="surrogatepass")
    return out


def mutated_payload(
    rng: random.Random, data: bytes, unpack: Unpack = unpacked, pack: Pack = packed
) -> bytes:
    """A payload changed as a tree, and now and then as bytes."""
    if rng.random() < 0.15:
        return mutated_bytes(rng, data)[:MOST_BYTES]
    try:
        tree = unpack(data)
        for _ in range(1 + int(rng.random() * rng.random() * 4)):
            tree = mutated_tree(rng, tree)
        return pack(tree)[:MOST_BYTES]
    except (ValueError, TypeError, OverflowError, RecursionError):
        return mutated_bytes(rng, data)[:MOST_BYTES]
