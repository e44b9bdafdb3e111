"""An account of what one issuer sent: how many messages to each topic, and their digest."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

from fleet.protocol.topics import suffix_of

DIGEST_BYTES = 8


class Account:
    """Counts and digests of messages, by topic without issuer, in order of sending."""

    def __init__(self, sent: Iterable[tuple[str, bytes]] = ()) -> None:
        """`sent` are topics and payloads."""
        self._counts: dict[str, int] = {}
        self._hashes: dict[str, Any] = {}
        for topic, payload in sent:
            self.add(topic, payload)

    def add(self, topic: str, payload: bytes) -> None:
        """Enter one message."""
        suffix = suffix_of(topic)
        if suffix in self._counts:
            self._counts[suffix] += 1
            self._hashes[suffix].update(payload)
        else:
            self._counts[suffix] = 1
            self._hashes[suffix] = hashlib.blake2b(payload, digest_size=DIGEST_BYTES)

    @property
    def counts(self) -> dict[str, int]:
        """Messages by topic without issuer, in the order of topics."""
        return dict(sorted(self._counts.items()))

    @property
    def digests(self) -> dict[str, str]:
        """BLAKE2b over the payloads of each topic, in hexadecimal digits."""
        return {suffix: self._hashes[suffix].hexdigest() for suffix in sorted(self._hashes)}

    def total(self) -> int:
        """All messages."""
        return sum(self._counts.values())

    def exceeds(self, counts: dict[str, int]) -> str:
        """The first topic of which more came than somebody tells; empty if there is none."""
        own = self.counts
        return next((suffix for suffix, n in own.items() if n > counts.get(suffix, 0)), "")

    def differs(self, counts: dict[str, int], digests: dict[str, str]) -> str:
        """The first topic of which somebody tells other counts or digests; empty if none."""
        own = self.digests
        if self._counts == counts and own == digests:
            return ""
        for suffix in sorted({*own, *counts}):
            if self._counts.get(suffix, 0) != counts.get(suffix, 0):
                return suffix
            if own.get(suffix) != digests.get(suffix):
                return suffix
        return ""
