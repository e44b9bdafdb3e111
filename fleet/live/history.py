"""What was flown before a moment of a log: a page that went there from another has not seen it."""

from __future__ import annotations

from functools import lru_cache

from fleet.live.source import Source
from fleet.live.view import LiveView, ViewData
from fleet.model.units import to_ns

STEP_NS = 1_000_000_000
"""It is told of every full second."""
SEPARATION_NS, PATHS_NS = 120_000_000_000, 60_000_000_000
"""The page draws separations and paths of so long a time."""
MOMENTS_KEPT = 600


class History:
    """Tells moments of a source's past; those that were told of late are not worked out again."""

    def __init__(self, source: Source, view: LiveView) -> None:
        self._source, self._view = source, view
        self._at = lru_cache(maxsize=MOMENTS_KEPT)(self._worked_out)

    def between(self, shown: ViewData | None, now: ViewData) -> list[ViewData]:
        """The moments from the view that was shown last to another: all, if that is an earlier."""
        now_ns = to_ns(now["t_s"])
        begin_ns = max(0, now_ns - SEPARATION_NS)
        if shown is not None and shown["t_s"] <= now["t_s"]:
            begin_ns = max(begin_ns, to_ns(shown["t_s"]) + 1)
        times_ns = range(-(-begin_ns // STEP_NS) * STEP_NS, now_ns, STEP_NS)
        told = [(t_ns, self._at(t_ns)) for t_ns in times_ns]
        return [
            moment if t_ns >= now_ns - PATHS_NS else {**moment, "uavs": []}
            for t_ns, moment in told
            if moment is not None
        ]

    def _worked_out(self, t_ns: int) -> ViewData | None:
        frame = self._source.past(t_ns)
        return None if frame is None else self._view.moment(frame)
