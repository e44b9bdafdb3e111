"""Message classes of a log that this fleet does not know: of an extension, or of another version.

Topics and schemas are named as ours are, so these are no foreign topics; but what their messages
say, and who should have heard them, nobody can tell here.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from fleet.log.foreign import OUR_KINDS
from fleet.protocol.codec import kind_of
from fleet.protocol.topics import issuer_of


@dataclass(frozen=True, slots=True)
class UnknownClass:
    """A class by the name that its topics give it, how many messages there are, of how many."""

    kind: str
    messages: int
    issuers: int


def is_unknown(topic: str) -> bool:
    """Whether a topic names no class that is known here."""
    return kind_of(topic) not in OUR_KINDS


def unknown_classes(messages: Mapping[str, int]) -> tuple[UnknownClass, ...]:
    """The classes of such topics; `messages` has how many there are of each topic."""
    count, issuers = Counter[str](), defaultdict[str, set[str]](set)
    for topic, n in messages.items():
        kind = kind_of(topic) or topic
        count[kind] += n
        issuers[kind].add(issuer_of(topic))
    return tuple(UnknownClass(kind, n, len(issuers[kind])) for kind, n in sorted(count.items()))
