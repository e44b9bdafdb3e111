"""A run as it is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import positions_of
from fleet.analysis.separation import Nearness, PairCurve, nearness_of, pair_curve
from fleet.log.reader import Summary, read
from fleet.log.run_metadata import run_metadata_of
from fleet.model.types import Array
from fleet.model.words import AVOIDING
from fleet.protocol import codec
from fleet.protocol.messages import Election, Truth

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
"""Okabe and Ito's, told apart by colour-blind readers too; UAVs beyond the eighth begin again."""


@dataclass(frozen=True)
class Flight:
    """What one UAV did: times (s), NED positions (m), and whether it flew a manoeuvre.

    `zone_m` is the radius of its own protected zone.
    """

    uav: int
    zone_m: float
    times_s: Array
    ned_m: Array
    avoiding: NDArray[np.bool_]

    @property
    def colour(self) -> str:
        """The same in all plots."""
        return COLOURS[(self.uav - 1) % len(COLOURS)]

    def spans(self) -> list[tuple[int, int]]:
        """First and last sample of each manoeuvre."""
        edges = np.diff(np.concatenate([[0], self.avoiding.astype(np.int8), [0]]))
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        last = len(self.times_s) - 1
        return [(int(a), min(int(b), last)) for a, b in zip(starts, ends, strict=True)]


@dataclass(frozen=True)
class PicturedRun:
    """A run as it is drawn; `elected` is the first computing UAV (0: nobody)."""

    name: str
    flights: list[Flight]
    elected: int
    elected_s: float
    near: Nearness
    pairs: list[PairCurve]


def pictured_run(log: Path) -> PicturedRun:
    """Read a log."""
    summary = Summary(log)
    truths: dict[int, list[Truth]] = {}
    elected, elected_s = 0, 0.0
    for record in read(log, summary):
        kind = codec.kind_of(record.topic)
        if kind not in ("truth", "election"):
            continue
        message = codec.decode(record.topic, record.payload)
        if isinstance(message, Truth):
            truths.setdefault(message.id, []).append(message)
        elif isinstance(message, Election) and not elected:
            elected, elected_s = message.computing, message.t_ns / 1e9
    scenario = run_metadata_of(log, summary.metadata).scenario
    ids = sorted(truths)
    flown = {uav: {t.t_ns: t.position_ned_m for t in own} for uav, own in truths.items()}
    times_ns, positions = positions_of(ids, flown)
    near = nearness_of(ids, times_ns, positions, scenario.required(), scenario.zone_ratios())
    place = dict(zip(ids, positions, strict=True))
    apart = [(m, place[m.a] - place[m.b], scenario.required_of(m.pair)) for m in near.minima]
    return PicturedRun(
        scenario.name,
        [_flight(uav, scenario.zone_of(uav).radius_m, truths[uav]) for uav in ids],
        elected,
        elected_s,
        near,
        [pair_curve(m, times_ns, relative_m, required) for m, relative_m, required in apart],
    )


def _flight(uav: int, zone_m: float, truths: Sequence[Truth]) -> Flight:
    return Flight(
        uav,
        zone_m,
        np.array([t.t_ns for t in truths]) / 1e9,
        np.array([t.position_ned_m for t in truths]),
        np.array([t.mode in AVOIDING for t in truths]),
    )
