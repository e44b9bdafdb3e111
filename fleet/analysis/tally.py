"""Counts of a run: elections, commands and their latency, unresolved encounters, delivery."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import Any

from fleet.analysis.clock_offsets import ClockOffsets
from fleet.analysis.latency_bins import LATENCY_BIN_NS, binned_quantiles_s, latency_bin
from fleet.analysis.range_count import RangeCount
from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.model.equipment import hears
from fleet.model.types import COORDINATOR
from fleet.model.units import to_s
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import (
    Ack,
    AddressedMessage,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Election,
    Late,
    Message,
    Truth,
)

SLIP_NS = 2_000_000
SLIP_FRACTION = 0.1
"""A realtime run is degraded if one delay in a hundred slips by more than 2 ms and a tenth."""

TALLIED = frozenset(
    cls.kind for cls in (Election, Command, Ack, Decision, Conflict, DeliveryReport, Late)
)
"""Classes of which more is told than how many there were."""


@dataclass
class RunTally:
    """Fed every message of a run once, in any order within a tick.

    Where no delivery report will tell what came, it need not count for how many receivers that was.
    """

    uavs: int = 0
    coordinator: bool = True
    deaf: frozenset[int] = frozenset()
    terms: dict[int, int] = field(default_factory=dict)
    issued: dict[tuple[int, int, int], str] = field(default_factory=dict)
    first_ns: dict[tuple[int, int, int], int] = field(default_factory=dict)
    transmissions: int = 0
    applied: dict[tuple[int, int, int], float] = field(default_factory=dict)
    refused: Counter[str] = field(default_factory=Counter)
    unresolved_encounters: set[tuple[int, int]] = field(default_factory=set)
    leaderless: set[int] = field(default_factory=set)
    late: Counter[int] = field(default_factory=Counter)
    fates: Counter[tuple[str, str]] = field(default_factory=Counter)
    transmitted: Counter[str] = field(default_factory=Counter)
    sent: Counter[str] = field(default_factory=Counter)
    latencies: dict[str, Counter[int]] = field(default_factory=lambda: defaultdict(Counter))
    delays: Counter[int] = field(default_factory=Counter)
    slips: Counter[int] = field(default_factory=Counter)
    transits: Counter[int] = field(default_factory=Counter)
    one_way: dict[tuple[int, int], Counter[int]] = field(
        default_factory=lambda: defaultdict(Counter)
    )
    clocks: ClockOffsets = field(default_factory=ClockOffsets)
    standing: dict[int, tuple[int, int]] = field(default_factory=dict)
    ranging: RangeCount | None = None
    hearing: dict[tuple[str, int], int] = field(default_factory=dict)
    counts_receivers: bool = True

    def add(self, message: Message) -> None:
        """Count one message."""
        if message.kind in AUDIBLE:
            self._add_sent(message)
        if message.kind in TALLIED:
            self._add_told(message)

    def _add_told(self, message: Message) -> None:
        match message:
            case Election():
                self.terms[message.term] = message.computing
                for group in set(self.standing) & set(message.members):
                    del self.standing[group]  # it has become part of this one
                self.standing[message.group] = (message.computing, message.valid_until_ns)
            case Command():
                self.transmissions += 1
                key = (message.term, message.id, message.number)
                self.issued[key] = message.manoeuvre
                self.first_ns.setdefault(key, message.t_ns)
            case Ack() if message.accepted:
                key = (message.term, message.target, message.number)
                sent_ns = self.first_ns.get(key, message.t_ns)  # not by the issuer's own clock
                self.applied[key] = to_s(message.actuate_ns - sent_ns)
            case Ack() if message.reason != "duplicate":
                self.refused[message.reason] += 1
            case Decision() | Conflict():
                self._add_unsolved(message)
            case DeliveryReport():
                self._add_delivery(message)
            case Late():
                self.late[latency_bin(message.late_ns)] += 1

    def _add_unsolved(self, message: Decision | Conflict) -> None:
        """For whom no candidate was good enough, and who had no computing UAV."""
        if isinstance(message, Conflict):
            self.leaderless |= {*message.leaderless}
            return
        stuck = [e.target for e in message.encounters if e.unresolved]
        self.unresolved_encounters |= {(message.term, target) for target in stuck}

    def _add_delivery(self, message: DeliveryReport) -> None:
        self.fates.update(zip(message.kinds, message.fates, strict=True))
        alike = Counter(zip(message.kinds, message.sent_ns, message.delivered_ns, strict=True))
        for (kind, sent, got), count in alike.items():
            if got:
                self.latencies[kind][latency_bin(got - sent)] += count
        if message.transit_ns:
            self._add_transits(message)
        for delay, slip in zip(message.delay_ns, message.slip_ns, strict=True):
            if delay:
                self.delays[latency_bin(delay)] += 1
                self.slips[latency_bin(slip)] += 1

    def _add_transits(self, message: DeliveryReport) -> None:
        """What zenoh took, less what the clocks of sender and receiver are apart by.

        It waits in `one_way` until that is known.
        """
        dst = message.id
        for src, transit_ns in zip(message.src, message.transit_ns, strict=True):
            if not transit_ns:
                continue
            if src != dst:
                self.clocks.add(src, dst, message.t_ns, transit_ns)
            apart_ns = self.clocks.correction_ns(src, dst) if src != dst else 0
            if apart_ns is None:
                self.one_way[src, dst][latency_bin(transit_ns)] += 1
                continue
            self.transits[latency_bin(transit_ns - apart_ns)] += 1
            for link in ((src, dst), (dst, src)) if self.one_way else ():
                bins, sign = self.one_way.pop(link, Counter()), 1 if link == (src, dst) else -1
                for bin_, count in bins.items():
                    self.transits[latency_bin(bin_ * LATENCY_BIN_NS - sign * apart_ns)] += count

    def _add_sent(self, message: Message) -> None:
        self.transmitted[message.kind] += 1
        if not self.counts_receivers:
            return
        if self.ranging:
            self.ranging.wait(message)
        else:
            self.sent[message.kind] += self._receivers(message)

    def add_truth(self, truth: Truth) -> None:
        """Take a true state, for who was within radio range."""
        if self.ranging and self.counts_receivers:
            self.ranging.wait(truth)

    def settle(self, t_ns: int) -> None:
        """Nothing more comes of times up to this one: count who was within radio range then."""
        if self.ranging and self.counts_receivers:
            self.sent += self.ranging.count(t_ns, self.deaf)

    def _receivers(self, message: Message) -> int:
        """How many hear a message, if all are there."""
        if isinstance(message, AddressedMessage):
            return int(message.target not in self.deaf)
        known = self.hearing.get((message.kind, message.id))
        if known is None:
            known = self.uavs - len(self.deaf)
            if message.id != COORDINATOR and message.id not in self.deaf:
                known -= 1  # not its own
            known += self.coordinator and message.is_for(COORDINATOR)
            self.hearing[message.kind, message.id] = known
        return known

    def accuracy(self) -> dict[str, Any]:
        """Realtime: how much later than intended delayed messages came, and whether too much."""
        slip_s, delay_s = binned_quantiles_s(self.slips), binned_quantiles_s(self.delays)
        limit_s = max(to_s(SLIP_NS), SLIP_FRACTION * delay_s.get("p50", 0.0))
        return {
            "count": self.slips.total(),
            "delay_s": delay_s,
            "slip_s": slip_s,
            "degraded": slip_s.get("p99", 0.0) > limit_s,
        }

    @property
    def unresolved(self) -> int:
        """Encounters (one for each term and UAV) in which no candidate kept the separation."""
        return len(self.unresolved_encounters)

    def computing_now(self, now_ns: int) -> list[int]:
        """UAVs that hold a mandate at this time."""
        return sorted({uav for uav, until in self.standing.values() if until >= now_ns})


def quantiles(values: list[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum; empty for no values."""
    if not values:
        return {}
    ordered = sorted(values)
    last = len(ordered) - 1
    return {
        "p50": ordered[round(0.50 * last)],
        "p99": ordered[round(0.99 * last)],
        "max": ordered[-1],
    }


def run_tally(scenario: Scenario) -> RunTally:
    """The empty tally of a scenario's run."""
    uavs = uavs_of(scenario)
    deaf = frozenset(u.id for u in uavs if not hears(u.equipment))
    ranging = RangeCount(scenario) if scenario.radio().limited else None
    coordinator = scenario.coordination.electors == "coordinator"
    clocks = ClockOffsets(scenario.tick_ns, frozenset(participants(scenario)))
    return RunTally(len(uavs), coordinator, deaf, ranging=ranging, clocks=clocks)
