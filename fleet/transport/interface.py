"""What a lockstep run needs of a transport: ticks go out on it, and comes back what they bring.

zenoh (`fleet.simulation.zenoh_transport`) and memory (`fleet.simulation.in_memory`) are the two.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from fleet.protocol.messages import Clock, Message

ReceivedMessage = tuple[str, bytes, Message]
"""Topic, payload and message; the payload is empty in memory if nobody keeps a record."""


class Transport(Protocol):
    """Reaches the participants of a lockstep run.

    All of its methods may raise FleetStoppedError: the run cannot go on.
    """

    def await_ready(self, numbers: Iterable[int], now_ns: int) -> None:
        """Wait until these participants, who have been started, can take a tick."""
        ...

    def grant(self, clock: Clock, payload: bytes) -> None:
        """Give everybody a tick, with all messages that the clock lists; `payload` is the clock."""
        ...

    def collect(self) -> list[ReceivedMessage]:
        """All that is sent in the tick that was granted last, in any order; waits for it."""
        ...

    def audit(self, *, last: bool = False) -> None:
        """Check that what was collected is its issuers' own.

        They are busy with the next tick meanwhile; after the `last` one nothing more may come.
        """
        ...

    def stop(self, clock: Clock, payload: bytes) -> None:
        """Tell everybody that the run is over."""
        ...
