"""Counter-based random numbers: a keyed hash instead of a generator's state."""

from __future__ import annotations

import hashlib
import math

from msgspec import Struct

_SCALE = 2.0**-64


class Hop(Struct, frozen=True):
    """One message on its way to one receiver, both by number; 0 is the coordinator."""

    src: int
    dst: int
    kind: str
    seq: int
    t_ns: int


class Draws:
    """Uniform numbers in (0, 1), each a function of the seed and its label alone."""

    def __init__(self, seed: int) -> None:
        self._key = seed.to_bytes(8, "little")

    def uniform(self, *label: object) -> float:
        """The number of a label; equal labels give equal numbers."""
        text = "|".join(map(str, label)).encode()
        digest = hashlib.blake2b(text, digest_size=8, key=self._key).digest()
        return (int.from_bytes(digest, "little") + 0.5) * _SCALE

    def of_hop(self, purpose: str, rule: int, hop: Hop, count: int = 0) -> float:
        """The number of one rule for one message on one link."""
        return self.uniform(purpose, rule, hop.src, hop.dst, hop.kind, hop.seq, count)

    def normal(self, purpose: str, rule: int, hop: Hop) -> float:
        """A standard normal number (Box and Muller, 1958)."""
        one, two = (self.of_hop(purpose, rule, hop, n) for n in (1, 2))
        return math.sqrt(-2.0 * math.log(one)) * math.cos(math.tau * two)
