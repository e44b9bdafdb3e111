"""Counter-based random numbers: a keyed hash instead of a generator's state.

Labels are hashed one after the other, each by a step of SplitMix64 (Steele, Lea and Flood, "Fast
splittable pseudorandom number generators", OOPSLA 2014): the last one counts through a stream of
that generator, whose seed the others make. Scalars and arrays give the same numbers.
"""

from __future__ import annotations

import hashlib
import math
from typing import overload

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from fleet.model.elementary import cos, log
from fleet.model.types import Array, Integers

Words = NDArray[np.uint64]

_SCALE = 1.0 / (1 << 52)
LEAST = 0.5 * _SCALE
"""The least draw."""

_WORD = (1 << 64) - 1
_STEP, _FIRST, _SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB


class LinkMessage(Struct, frozen=True, gc=False):
    """One message on its way to one receiver, both by number; 0 is the coordinator.

    `bits` is the size of its payload, `distance_m` the true distance of sender and receiver when
    it was sent, None where it is not known.
    """

    src: int
    dst: int
    kind: str
    seq: int
    t_ns: int
    bits: int = 0
    distance_m: float | None = None


class LinkMessageColumns(Struct, frozen=True, gc=False):
    """Messages of one class and time on their way to one receiver: the same as columns (n,).

    A distance that is not known is NaN.
    """

    src: Integers
    dst: int
    kind: str
    seq: Integers
    t_ns: int
    bits: Integers
    distance_m: Array | None = None

    def one(self, n: int) -> LinkMessage:
        """The n-th of them."""
        distance_m = None if self.distance_m is None else float(self.distance_m[n])
        distance_m = None if distance_m is None or math.isnan(distance_m) else distance_m
        src, seq, bits = int(self.src[n]), int(self.seq[n]), int(self.bits[n])
        return LinkMessage(src, self.dst, self.kind, seq, self.t_ns, bits, distance_m)

    def part(self, rows: NDArray[np.intp]) -> LinkMessageColumns:
        """Some of them."""
        distance_m = None if self.distance_m is None else self.distance_m[rows]
        src, seq, bits = self.src[rows], self.seq[rows], self.bits[rows]
        return LinkMessageColumns(src, self.dst, self.kind, seq, self.t_ns, bits, distance_m)


class Draws:
    """The random numbers of one rule, each a function of seed, place in the plan and label."""

    def __init__(self, seed: int, rule: int) -> None:
        self._seed = seed.to_bytes(8, "little")
        self._rule = rule
        self._streams: dict[str | tuple[object, ...], int] = {}

    def uniform(self, purpose: str, *labels: int) -> float:
        """Uniform in (0, 1), both bounds excluded; equal labels, from 0 on, give equal numbers."""
        word = self._purpose(purpose)
        for label in labels:
            word = _mixed(word, label)
        return ((word >> 12) + 0.5) * _SCALE

    def normal(self, purpose: str, *labels: int) -> float:
        """Standard normal (Box and Muller, 1958)."""
        one, two = (self.uniform(purpose, *labels, n) for n in (1, 2))
        return math.sqrt(-2.0 * log(one)) * cos(math.tau * two)

    @overload
    def of_message(self, purpose: str, sent: LinkMessage, count: int = ...) -> float: ...

    @overload
    def of_message(self, purpose: str, sent: LinkMessageColumns, count: int = ...) -> Array: ...

    @overload
    def of_message(
        self, purpose: str, sent: LinkMessage | LinkMessageColumns, count: int = ...
    ) -> float | Array: ...

    def of_message(
        self, purpose: str, sent: LinkMessage | LinkMessageColumns, count: int = 0
    ) -> float | Array:
        """Uniform in (0, 1), of one message on one link, or of each of several.

        `count` tells several draws for a message apart.
        """
        receiver = self._stream(purpose, sent.dst, sent.kind, count)
        if isinstance(sent, LinkMessageColumns):
            words = _mixed_all(_mixed_all(np.uint64(receiver), sent.src), sent.seq)
            drawn: Array = ((words >> np.uint64(12)).astype(np.float64) + 0.5) * _SCALE
            return drawn
        link = self._streams.get((receiver, sent.src))
        if link is None:
            link = self._streams[receiver, sent.src] = _mixed(receiver, sent.src)
        return ((_mixed(link, sent.seq) >> 12) + 0.5) * _SCALE

    @overload
    def normal_of_message(self, purpose: str, sent: LinkMessage) -> float: ...

    @overload
    def normal_of_message(self, purpose: str, sent: LinkMessageColumns) -> Array: ...

    @overload
    def normal_of_message(
        self, purpose: str, sent: LinkMessage | LinkMessageColumns
    ) -> float | Array: ...

    def normal_of_message(
        self, purpose: str, sent: LinkMessage | LinkMessageColumns
    ) -> float | Array:
        """Standard normal, of one message on one link, or of each of several."""
        one, two = (self.of_message(purpose, sent, n) for n in (1, 2))
        if isinstance(one, float) and isinstance(two, float):
            return math.sqrt(-2.0 * log(one)) * cos(math.tau * two)
        several: Array = np.sqrt(-2.0 * log(one)) * cos(math.tau * two)
        return several

    def _stream(self, purpose: str, dst: int, kind: str, count: int) -> int:
        known = self._streams.get((purpose, dst, kind, count))
        if known is None:
            word = _mixed(_mixed(self._purpose(f"{purpose} of {kind}"), count), dst)
            known = self._streams[purpose, dst, kind, count] = word
        return known

    def _purpose(self, purpose: str) -> int:
        known = self._streams.get(purpose)
        if known is None:
            text = f"{purpose}|{self._rule}".encode()
            word = hashlib.blake2b(text, digest_size=8, key=self._seed).digest()
            known = self._streams[purpose] = int.from_bytes(word, "little")
        return known


def _mixed(word: int, label: int) -> int:
    """The number at a place of a SplitMix64 generator with this seed."""
    word = (word + (label + 1) * _STEP) & _WORD
    word = ((word ^ (word >> 30)) * _FIRST) & _WORD
    word = ((word ^ (word >> 27)) * _SECOND) & _WORD
    return word ^ (word >> 31)


def _mixed_all(word: Words | np.uint64, labels: Integers) -> Words:
    """The same of several; numbers of 64 bits wrap around, as they are to."""
    words: Words = word + (labels.astype(np.uint64) + np.uint64(1)) * np.uint64(_STEP)
    words = (words ^ (words >> np.uint64(30))) * np.uint64(_FIRST)
    words = (words ^ (words >> np.uint64(27))) * np.uint64(_SECOND)
    return words ^ (words >> np.uint64(31))
