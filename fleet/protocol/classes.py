"""The classes of messages, sorted by what they declare of themselves.

Whoever must know which classes there are, who hears them and in which order asks here.
"""

from __future__ import annotations

from fleet.model.types import COORDINATOR
from fleet.protocol import messages
from fleet.protocol.audience import Audience, Issuers
from fleet.protocol.messages import Clock, Digest, Logged, Message, Outage, Rejected, RoundTime

MESSAGES: tuple[type[Message], ...] = tuple(
    cls
    for cls in vars(messages).values()
    if isinstance(cls, type) and issubclass(cls, Message) and cls.kind
)
"""What participants send."""
MESSAGE_BY_KIND = {cls.kind: cls for cls in MESSAGES}

_OF_SIMULATION: tuple[type[Logged], ...] = (Clock, Digest, Rejected, RoundTime, Outage)
LOGGED_CLASSES: tuple[type[Logged], ...] = (*MESSAGES, *_OF_SIMULATION)
"""What a log has: messages, and what the simulation adds."""

DELIVERY_ORDER = tuple(
    cls.kind
    for cls in sorted(MESSAGES, key=lambda cls: cls.rank)
    if cls.audience is not Audience.RECORDER
)
"""The order in which messages are handed over that one source has delivered at one time."""

AUDIBLE = frozenset(DELIVERY_ORDER)
"""Classes that participants hear, and wait for in lockstep; the others go to the recorder alone."""
ADDRESSED = frozenset(
    kind for kind, cls in MESSAGE_BY_KIND.items() if cls.audience is Audience.TARGET
)
"""Classes that go to the one whom their topic names."""
BROADCAST = AUDIBLE - ADDRESSED
"""Classes that go to all others: an issuer does not receive its own."""
CELLED = frozenset(kind for kind in BROADCAST if MESSAGE_BY_KIND[kind].by_cell)
"""Those that UAVs send to cells, in runs that have any."""


def hears_class(number: int, kind: str) -> bool:
    """Whether a participant hears messages of a class, from whomever."""
    audience = MESSAGE_BY_KIND[kind].audience
    if number == COORDINATOR:
        return audience is Audience.ALL
    return audience is not Audience.RECORDER


def issues_class(number: int, kind: str) -> bool:
    """Whether messages of a class can come from a participant."""
    other = Issuers.UAVS if number == COORDINATOR else Issuers.COORDINATOR
    return kind in MESSAGE_BY_KIND and MESSAGE_BY_KIND[kind].issuers is not other
