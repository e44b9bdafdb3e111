"""What each participant had heard of the others when it decided."""

from __future__ import annotations

import numpy as np

from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import RunArrays
from fleet.model.units import to_s
from fleet.model.words import ArrivalFate
from fleet.protocol.messages import StateBroadcast

KnowledgeKey = tuple[int, int, int]
"""Receiver, source, incarnation of the receiver."""


class Knowledge:
    """What each participant had heard of each UAV's state, and how old that was."""

    def __init__(self, data: RunArrays) -> None:
        """Broadcasts that were received and believed."""
        self._heard: dict[KnowledgeKey, tuple[Ints, Ints]] = {}
        believed = [data.code(ArrivalFate.RECEIVED), data.code(ArrivalFate.ALTERED)]
        for receiver in {command.id for command in data.commands} | {d.id for d in data.decisions}:
            r = data.receipts.get(receiver)
            if r is None:
                continue
            good = (r.kind == data.code(StateBroadcast.kind)) & np.isin(r.fate, believed)
            for src in np.unique(r.src[good]).tolist():
                for incarnation in np.unique(r.incarnation[good]).tolist():
                    own = good & (r.src == src) & (r.incarnation == incarnation)
                    newest_ns = np.maximum.accumulate(r.sent_ns[own])
                    self._heard[receiver, src, incarnation] = r.step_ns[own], newest_ns

    def age_s(self, receiver: int, uav: int, t_ns: int, incarnation: int) -> float | None:
        """Age at a step of the newest broadcast heard of a UAV; None of oneself, or if none."""
        step_ns, newest_ns = self._heard.get((receiver, uav, incarnation), (None, None))
        if step_ns is None or newest_ns is None:
            return None
        count = int(np.searchsorted(step_ns, t_ns, side="right"))
        return to_s(t_ns - int(newest_ns[count - 1])) if count else None
