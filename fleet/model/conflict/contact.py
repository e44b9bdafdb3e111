"""Contact: when somebody was last heard, and from when on its silence means something.

On a clean link a limit of a few broadcasts tells the dead from the living. On a lossy one it does
not: at 80 percent loss eight broadcasts in a row are lost one time in six. So the limit is made
longer, to as many broadcasts as are lost in a row one time in a thousand at the loss that the
sequence numbers of what came lately show, but not beyond a multiple of it.
"""

from __future__ import annotations

INCARNATION = 10**9
"""A process that is restarted counts on from the next multiple."""

WINDOW = 32
"""Of so many broadcasts the loss is taken."""

ALL = (1 << WINDOW) - 1

RARE = 1e-3
"""So rarely lost messages may be taken for silence."""

STRETCH = 4
"""The limit is at most so many times as long as on a clean link."""


class Contact:
    """One sender of numbered, periodic messages, as one receiver hears it.

    At first the link is taken to be clean. An outage counts as no more than what is lost within the
    plain limit: it says little about the link before and after.
    """

    __slots__ = ("_came", "_clean_ns", "_period_ns", "_seq", "last_ns", "limit_ns")

    def __init__(self, clean_ns: int, period_ns: int, seq: int, now_ns: int) -> None:
        """`clean_ns` is the limit without loss; the first message has just come."""
        self._clean_ns = clean_ns
        self._period_ns = period_ns
        self._came = ALL
        self._seq = seq
        self.last_ns = now_ns
        self.limit_ns = clean_ns

    def hear(self, seq: int, now_ns: int) -> None:
        """A later message has come."""
        same_incarnation = seq // INCARNATION == self._seq // INCARNATION
        step = (
            min(seq - self._seq, self._clean_ns // self._period_ns + 1) if same_incarnation else 1
        )
        self._seq, self.last_ns = seq, now_ns
        if step > 1 or self._came != ALL:
            self._came = (self._came << step | 1) & ALL
            self.limit_ns = limit_ns(self._came.bit_count(), self._clean_ns, self._period_ns)

    @property
    def share(self) -> float:
        """Of what it sent lately, the share that came."""
        return self._came.bit_count() / WINDOW

    def silent(self, now_ns: int) -> bool:
        """Whether it has not been heard for longer than the limit."""
        return now_ns - self.last_ns > self.limit_ns


def limit_ns(came: int, clean_ns: int, period_ns: int) -> int:
    """How long silence must last to mean something, where so many of the last `WINDOW` came."""
    loss = 1.0 - came / WINDOW
    longest_ns = STRETCH * clean_ns
    chance, limit = loss, period_ns
    while chance > RARE and limit < longest_ns:
        chance *= loss
        limit += period_ns
    return max(clean_ns, min(limit, longest_ns))
