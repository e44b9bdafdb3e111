"""Rate: a link carries only so many bits a second."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Effect, LinkRule
from fleet.model.units import to_ns, to_s


class Rate(LinkRule, frozen=True, tag="rate", kw_only=True):
    """Each directed link sends one message after the other, at `bits_per_s`.

    A message waits until those before it are through; where `queue` messages wait already, it is
    dropped. Messages of a link must come in order of sending.
    """

    bits_per_s: Annotated[float, Meta(ge=1.0, le=1e12)]
    queue: Annotated[int, Meta(ge=0, le=1_000_000)] = 100

    @property
    def longest_s(self) -> float:
        """A queue may become as long as messages are."""
        return math.inf

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Delay by waiting and sending, or drop."""
        links: dict[tuple[int, int], deque[int]] = {}

        def send(link_message: LinkMessage, course: Effect) -> bool:
            ends_ns = links.setdefault((link_message.src, link_message.dst), deque())
            while ends_ns and ends_ns[0] <= link_message.t_ns:
                ends_ns.popleft()
            if len(ends_ns) > self.queue:  # the first of them is not waiting, but being sent
                return False
            begin_ns = ends_ns[-1] if ends_ns else link_message.t_ns
            ends_ns.append(begin_ns + to_ns(link_message.bits / self.bits_per_s))
            course.delay_s += to_s(ends_ns[-1] - link_message.t_ns)
            return True

        return send
