"""Counter-based random numbers: a keyed hash instead of a generator's state."""

from __future__ import annotations

import hashlib
import math

from msgspec import Struct

from fleet.model.elementary import cos, log

_SCALE = 1.0 / (1 << 52)
LEAST = 0.5 * _SCALE
"""The least draw."""


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


class Draws:
    """The random numbers of one rule, each a function of seed, place in the plan and label."""

    def __init__(self, seed: int, rule: int) -> None:
        self._keyed = hashlib.blake2b(digest_size=8, key=seed.to_bytes(8, "little"))
        self._rule = rule

    def uniform(self, purpose: str, *label: object) -> float:
        """Uniform in (0, 1), both bounds excluded; equal labels give equal numbers."""
        text = "|".join(map(str, (purpose, self._rule, *label))).encode()
        hashed = self._keyed.copy()
        hashed.update(text)
        return ((int.from_bytes(hashed.digest(), "little") >> 12) + 0.5) * _SCALE

    def normal(self, purpose: str, *label: object) -> float:
        """Standard normal (Box and Muller, 1958)."""
        one, two = (self.uniform(purpose, *label, n) for n in (1, 2))
        return math.sqrt(-2.0 * log(one)) * cos(math.tau * two)

    def of_message(self, purpose: str, link_message: LinkMessage, count: int = 0) -> float:
        """Uniform in (0, 1), of one message on one link; `count` tells several of them apart."""
        return self.uniform(
            purpose, link_message.src, link_message.dst, link_message.kind, link_message.seq, count
        )

    def normal_of_message(self, purpose: str, link_message: LinkMessage) -> float:
        """Standard normal, of one message on one link."""
        return self.normal(
            purpose, link_message.src, link_message.dst, link_message.kind, link_message.seq
        )
