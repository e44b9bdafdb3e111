"""Which of the ways home from a manoeuvre is the first that meets nobody.

Of many others most stand in nobody's way, and one that blocks a way home blocks those of the next
moments, too. So a way is held against all others only where those who blocked the ways before it
leave it free; what is found is the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.blocks import FEW_PAIRS, first_overlaps_s
from fleet.model.conflict.outlook import Outlook
from fleet.model.types import Array, Indices

REMEMBERED = 4
"""So many of those who blocked a way are asked first, the latest first."""


class WaysHome:
    """Ways home are asked for one after the other, in order of time.

    `far` are the trajectories of the others (k, 2n - 1, 3), from the first moment on; `scale`
    (k, 1, 3) is laid on positions relative to them, if zones grow or some are larger.
    """

    def __init__(self, outlook: Outlook, far: Array, scale: Array | None) -> None:
        self._outlook = outlook
        self._far = far
        self._scale = scale
        self._blocking: list[int] = []

    def first_free(self, home: Array, starts: Indices) -> int | None:
        """The first of some ways home (s, n, 3), each from its sample in `starts` on, that is free.

        None if none is.
        """
        everybody = range(len(self._far))
        if not everybody:
            return 0
        ways: Indices = np.arange(len(home))
        if len(home) * len(everybody) <= FEW_PAIRS:
            free = ~self._met(home, starts, ways, everybody).any(axis=1)
            return int(np.argmax(free)) if free.any() else None
        if self._blocking:
            ways = ways[~self._met(home, starts, ways, self._blocking).any(axis=1)]
        while len(ways):
            met = self._met(home, starts, ways[:1], everybody)[0]
            if not met.any():
                return int(ways[0])
            blocking = int(np.argmax(met))
            self._blocking = [blocking, *self._blocking][:REMEMBERED]
            ways = ways[1:]
            if len(ways):
                ways = ways[~self._met(home, starts, ways, [blocking])[:, 0]]
        return None

    def _met(
        self, home: Array, starts: Indices, ways: Indices, others: Sequence[int]
    ) -> NDArray[np.bool_]:
        """Whether some of the ways meet some of the others, shape (ways, others)."""
        times, which = self._outlook.times_s, np.array(others)
        count, far = len(times), self._far if len(which) == len(self._far) else self._far[which]
        scale = None if self._scale is None else self._scale[which]
        windows = np.stack([far[:, k : k + count] for k in starts[ways].tolist()])
        first = first_overlaps_s(home[ways][:, None], windows, times, self._outlook.required, scale)
        return np.asarray(np.isfinite(first), dtype=np.bool_)
