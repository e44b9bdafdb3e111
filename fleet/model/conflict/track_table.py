"""Tracks as columns: what several receivers know of the same UAVs, taken in together.

A row is a receiver, a column a UAV. What `Tracks` does with one report of one UAV after another is
done here with many at once, by the same arithmetic and so with the same result.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fleet.model.conflict.contact import ALL, INCARNATION, WINDOW, limit_ns
from fleet.model.conflict.tracks import (
    BELIEVED_AFTER,
    MISSED,
    UNHEARD_NS,
    StateReport,
    TrackRules,
    plausible,
)
from fleet.model.types import Array, Integers, Truths
from fleet.model.units import NS_PER_S, to_s

Objects = NDArray[np.object_]


@dataclass(frozen=True)
class ReportColumns:
    """Reports of n different UAVs: times and numbers (n,), north, east, down and speed (n, 4).

    `items` (n,) are what the reports are read from.
    """

    seq: Integers
    t_ns: Integers
    state: Array
    items: Objects


class TrackTable:
    """What each of several receivers knows of each UAV; `read` makes a report of an item."""

    def __init__(
        self,
        receivers: int,
        uavs: Iterable[int],
        rules: TrackRules,
        read: Callable[[Any], StateReport],
    ) -> None:
        self.uavs = np.array(sorted(uavs), dtype=np.int64)
        self.column = {uav: n for n, uav in enumerate(self.uavs.tolist())}
        self.rules = rules
        self._read = read
        by_count = [limit_ns(n, rules.silence_ns, rules.broadcast_ns) for n in range(WINDOW + 1)]
        self._limit_by_count_ns = np.array(by_count, dtype=np.int64)
        cells = receivers * len(self.uavs)
        self._receivers = receivers
        self.seqs = np.full(cells, -1, dtype=np.int64)
        self._t_ns = np.zeros(cells, dtype=np.int64)
        self._state = np.zeros((cells, 4))
        self.last_ns = np.full(cells, UNHEARD_NS, dtype=np.int64)
        self.limits_ns = np.full(cells, rules.silence_ns, dtype=np.int64)
        self.came = np.full(cells, ALL, dtype=np.uint64)
        self.answers_ns = np.full(cells, UNHEARD_NS, dtype=np.int64)
        self.latest_ns = np.full(receivers, UNHEARD_NS, dtype=np.int64)
        self.items: Objects = np.full(cells, None, dtype=object)
        self._doubted: dict[int, list[StateReport]] = {}

    def row(self, receiver: int) -> TrackRow:
        """What one receiver knows: nothing at first, even if there was one of that place before."""
        width = len(self.uavs)
        part = slice(receiver * width, (receiver + 1) * width)
        self.seqs[part] = -1
        self.last_ns[part] = self.answers_ns[part] = UNHEARD_NS
        self.limits_ns[part], self.came[part] = self.rules.silence_ns, ALL
        self.items[part] = None
        self.latest_ns[receiver] = UNHEARD_NS
        for cell in [c for c in self._doubted if part.start <= c < part.stop]:
            del self._doubted[cell]
        return TrackRow(self, receiver)

    def report(self, item: Any) -> StateReport:
        """What an item says."""
        return item if isinstance(item, StateReport) else self._read(item)

    def take(
        self,
        rows: Integers,
        columns: Integers,
        of: Integers,
        heard: ReportColumns,
        *,
        local_ns: Integers,
        answering: Truths,
    ) -> Truths:
        """Take in n reports, each in a cell of its own; returns which are believed, shape (n,).

        A report is given by its receiver's row, its UAV's column, its place in `heard`, when its
        receiver heard it, and whether it answers an election. See `Tracks.hear`.
        """
        cells = rows * len(self.uavs) + columns
        seq, known_seq = heard.seq[of], self.seqs[cells]
        believed: Truths = seq <= known_seq
        (news,) = np.nonzero(~believed)
        if len(news) < len(cells):
            rows, cells, of, seq = rows[news], cells[news], of[news], seq[news]
            known_seq, local_ns, answering = known_seq[news], local_ns[news], answering[news]
        fits = (known_seq < 0) | self._plausible(cells, known_seq, seq, of, heard)
        if not fits.all():
            for n in np.nonzero(~fits)[0].tolist():
                fits[n] = self._insists(int(cells[n]), self.report(heard.items[of[n]]))
            rows, cells, of, seq = rows[fits], cells[fits], of[fits], seq[fits]
            known_seq, local_ns, answering = known_seq[fits], local_ns[fits], answering[fits]
        believed[news] = fits
        self._believe(cells, known_seq, seq, of, heard)
        self.last_ns[cells] = local_ns
        self.latest_ns[rows] = local_ns
        if answering.any():
            self.answers_ns[cells[answering]] = local_ns[answering]
        return believed

    def _plausible(
        self,
        cells: Integers,
        known_seq: Integers,
        seq: Integers,
        of: Integers,
        heard: ReportColumns,
    ) -> Truths:
        """`fleet.model.conflict.tracks.plausible`, for each."""
        rules = self.rules
        elapsed_s = np.maximum(0.0, (heard.t_ns[of] - self._t_ns[cells]) / NS_PER_S)
        after, before = heard.state[of], self._state[cells]
        moved = after - before
        north, east, down = moved[:, 0], moved[:, 1], moved[:, 2]
        reach_m = np.maximum(before[:, 3], after[:, 3]) * elapsed_s + rules.jump_m
        came_m2 = north * north + east * east + down * down
        gained = np.abs(moved[:, 3])
        fits: Truths = (came_m2 <= reach_m * reach_m) & (
            gained <= rules.max_acceleration_mps2 * elapsed_s + rules.jump_m / 10.0
        )
        incarnations = seq // INCARNATION - known_seq // INCARNATION
        same = seq - known_seq <= elapsed_s / to_s(rules.broadcast_ns) + MISSED
        if incarnations.any():
            later = (incarnations > 0) & (incarnations < 10)
            same = np.where(incarnations == 0, same, later)
        return fits & same

    def _believe(
        self,
        cells: Integers,
        known_seq: Integers,
        seq: Integers,
        of: Integers,
        heard: ReportColumns,
    ) -> None:
        """Put these reports in the place of those before, and count what was missed."""
        rules = self.rules
        for cell in self._doubted.keys() & set(cells.tolist()) if self._doubted else ():
            del self._doubted[cell]
        self.seqs[cells] = seq
        self._t_ns[cells] = heard.t_ns[of]
        self._state[cells] = heard.state[of]
        self.items[cells] = heard.items[of]
        came, first = self.came[cells], known_seq < 0
        (changed,) = np.nonzero((came != ALL) | (seq - known_seq != 1))
        if len(changed):
            cells, came, first = cells[changed], came[changed], first[changed]
            seq, known_seq = seq[changed], known_seq[changed]
            most = rules.silence_ns // rules.broadcast_ns + 1
            same = seq // INCARNATION == known_seq // INCARNATION
            step = np.where(same, np.minimum(seq - known_seq, min(most, WINDOW)), 1)
            shifted = (came << step.astype(np.uint64) | np.uint64(1)) & np.uint64(ALL)
            self.came[cells] = came = np.where(first, np.uint64(ALL), shifted)
            self.limits_ns[cells] = self._limit_by_count_ns[np.bitwise_count(came)]

    def _insists(self, cell: int, report: StateReport) -> bool:
        doubted = self._doubted.setdefault(cell, [])
        if doubted and not plausible(doubted[-1], report, self.rules):
            doubted.clear()
        if not doubted or report.seq > doubted[-1].seq:
            doubted.append(report)
        return len(doubted) >= BELIEVED_AFTER


class TrackRow:
    """What one receiver knows, in its row of a table: a `TrafficPicture`, as `Tracks` is."""

    def __init__(self, table: TrackTable, receiver: int) -> None:
        self.table = table
        self.receiver = receiver
        width = len(table.uavs)
        self._part = slice(receiver * width, (receiver + 1) * width)

    def hear(self, report: StateReport, now_ns: int, *, answering: bool = False) -> bool:
        """Take in one report; `TrackTable.take` takes in many for the price of one."""
        state, zero = report.state, np.zeros(1, dtype=np.int64)
        items = np.empty(1, dtype=object)
        items[0] = report
        heard = ReportColumns(
            zero + report.seq,
            zero + report.t_ns,
            np.array([[state.north_m, state.east_m, state.down_m, state.speed_mps]]),
            items,
        )
        row, column = zero + self.receiver, zero + self.table.column[report.id]
        told = np.array([answering])
        taken = self.table.take(row, column, zero, heard, local_ns=zero + now_ns, answering=told)
        return bool(taken[0])

    def limit_ns(self, uav: int) -> int:
        """How long the silence of a UAV must last to mean something."""
        return int(self.table.limits_ns[self._cell(uav)])

    def answered_ns(self, uav: int) -> int:
        """When a UAV last answered an election."""
        return int(self.table.answers_ns[self._cell(uav)])

    def share(self, uavs: Iterable[int]) -> float:
        """Of what these UAVs sent lately, the share that came of the one heard worst."""
        table = self.table
        cells = [self._cell(u) for u in uavs if u in table.column]
        heard = [int(table.came[c]).bit_count() for c in cells if table.seqs[c] >= 0]
        return min(heard, default=WINDOW) / WINDOW

    def current(self, now_ns: int) -> list[StateReport]:
        """Reports heard within the time-out, in ID order; who is silent flies straight on."""
        since_ns = now_ns - self.table.last_ns[self._part]
        (kept,) = np.nonzero(since_ns <= self.table.rules.timeout_ns)
        silent = (since_ns > self.table.limits_ns[self._part])[kept]
        reports = [self.table.report(i) for i in self.table.items[self._part][kept]]
        if silent.any():
            straight = zip(reports, silent.tolist(), strict=True)
            return [report.straight() if still else report for report, still in straight]
        return reports

    def silent(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been silent for longer than the limit."""
        table, part = self.table, self._part
        silent = now_ns - table.last_ns[part] > table.limits_ns[part]
        return frozenset(table.uavs[silent & (table.seqs[part] >= 0)].tolist())

    def present(self, now_ns: int) -> frozenset[int]:
        """UAVs that have been heard within the limit, and whose tracks have not been dropped."""
        return frozenset(self.table.uavs[self._present(now_ns)].tolist())

    def hears_any(self, uavs: Collection[int] | None, now_ns: int) -> bool:
        """Whether any UAV is present, or any of these."""
        if uavs is not None:
            return not self.present(now_ns).isdisjoint(uavs)
        since_ns = now_ns - int(self.table.latest_ns[self.receiver])
        rules = self.table.rules
        return since_ns <= min(rules.silence_ns, rules.timeout_ns) or bool(
            self._present(now_ns).any()
        )

    def _present(self, now_ns: int) -> Truths:
        since_ns = now_ns - self.table.last_ns[self._part]
        within: Truths = since_ns <= self.table.limits_ns[self._part]
        return within & (since_ns <= self.table.rules.timeout_ns)

    def _cell(self, uav: int) -> int:
        return self._part.start + self.table.column[uav]
