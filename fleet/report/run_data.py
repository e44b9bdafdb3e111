"""A run as it is drawn: flights on common times, what was said, and what became of it on the way.

Nothing is computed here that is not in the log; times in s, positions NED in m, angles in rad.
"""

from __future__ import annotations

from array import array
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.arrival import ArrivalMonitor, Arrivals
from fleet.analysis.common_times import Ints, positions_of
from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.separation import PairMinimum, nearness_of
from fleet.analysis.tally import RunTally, run_tally
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.errors import LogError
from fleet.faults.rules import Rule
from fleet.log.reader import Record
from fleet.log.run_metadata import RunMetadata
from fleet.model.types import COORDINATOR, Array
from fleet.model.words import ClockState
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import (
    Ack,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Election,
    Late,
    Message,
    Truth,
)
from fleet.protocol.topics import CLOCK

SAID = (Election, Command, Ack, Decision, Conflict)
"""Classes of which every message is kept."""
Said = TypeVar("Said", bound=Message)
READ = AUDIBLE | {Truth.kind, DeliveryReport.kind, Late.kind, Decision.kind, Conflict.kind}
NS = 1e9
MERGED_S = 1.0
"""Absences so near to each other are one: a slow process is held in most ticks."""


@dataclass(frozen=True)
class Flight:
    """One UAV at each of the run's times; NaN where it is not there.

    `index` is its place in the fleet, which gives its colour. Commands are (term, issuer, number),
    all zero where none is in force.
    """

    uav: Uav
    index: int
    ned_m: Array
    speed_mps: Array
    heading_rad: Array
    flight_path_rad: Array
    modes: NDArray[np.str_]
    waypoints: NDArray[np.int64]
    guidance: Array
    commanded: Array
    commands: NDArray[np.int64]

    @property
    def id(self) -> int:
        """Its number."""
        return self.uav.id


@dataclass(frozen=True)
class LinkMessages:
    """Every delivery report entry as columns: one message on its way to one receiver.

    `kinds` and `fates` index `kind_names` and `fate_names`; `delivered_s` is NaN if it was lost.
    """

    src: NDArray[np.int64]
    dst: NDArray[np.int64]
    kinds: NDArray[np.int64]
    fates: NDArray[np.int64]
    sent_s: Array
    delivered_s: Array
    kind_names: tuple[str, ...]
    fate_names: tuple[str, ...]

    def __len__(self) -> int:
        """How many there are."""
        return len(self.src)


@dataclass(frozen=True)
class RunData:
    """A run. `about` is from the log's metadata; `damage` says what is missing of it."""

    scenario: Scenario
    plan: tuple[Rule, ...]
    times_ns: Ints
    flights: tuple[Flight, ...]
    minima: tuple[PairMinimum, ...]
    arrivals: Arrivals
    said: Mapping[type[Message], list[Message]]
    absences: Mapping[tuple[int, str], list[tuple[float, float]]]
    link_messages: LinkMessages
    tally: RunTally
    about: RunMetadata
    damage: str = ""

    @cached_property
    def times_s(self) -> Array:
        """When true states were logged, in s."""
        return self.times_ns / NS

    @property
    def end_s(self) -> float:
        """When the last true state was logged."""
        return float(self.times_s[-1]) if len(self.times_s) else 0.0

    @property
    def vanished(self) -> frozenset[int]:
        """UAVs whose aircraft are gone before the end."""
        return frozenset(row.id for row in self.arrivals.rows if row.aircraft == "vanished")

    @property
    def processes(self) -> tuple[int, ...]:
        """Numbers of all processes, the coordinator (0) first where there is one."""
        coordinated = self.scenario.coordination.electors == "coordinator"
        return ((COORDINATOR,) if coordinated else ()) + tuple(f.id for f in self.flights)

    def of(self, kind: type[Said]) -> list[Said]:
        """All messages of a class, in order of the log."""
        return [m for m in self.said.get(kind, []) if isinstance(m, kind)]

    def index_of(self, uav: int) -> int:
        """The place of a UAV in the fleet; raises KeyError for a stranger."""
        return {f.id: f.index for f in self.flights}[uav]

    def at(self, time_s: float) -> int:
        """The place of the last time that is not after this one."""
        return max(0, int(np.searchsorted(self.times_s, time_s + 1e-6)) - 1)


def run_data_of(run: RecordedRun) -> RunData:
    """What is drawn of a run; messages that cannot be of it are counted in `damage`.

    Raises:
        LogError: there is nothing to draw.

    """
    scenario, damage = run.scenario, run.damage
    gathered = _Gathered(run)
    for record in run.records:
        gathered.take(record)
    if gathered.strange:
        damage = f"{damage} {gathered.strange} messages are malformed, or not of this run.".strip()
    uavs = uavs_of(scenario)
    ids = [uav.id for uav in uavs]
    flown = {n: {t.t_ns: t.position_ned_m for t in own} for n, own in gathered.truths.items()}
    times_ns, positions_ned_m = positions_of(ids, flown)
    if not len(times_ns):
        raise LogError(
            f"{run.path}: no true state of any UAV is on record; there is nothing to draw"
        )
    end_s = float(times_ns[-1]) / NS
    required, zones = scenario.required(), scenario.zone_ratios()
    near = nearness_of(ids, times_ns, positions_ned_m, required, zones)
    if damage:
        damage = f"{damage} Everything up to {end_s:g} s is shown."
    return RunData(
        scenario,
        run.plan,
        times_ns,
        tuple(
            _flight(uav, n, times_ns.tolist(), gathered.truths[uav.id])
            for n, uav in enumerate(uavs)
        ),
        tuple(near.minima),
        gathered.arrivals.arrivals(),
        gathered.said,
        gathered.absences(end_s),
        gathered.link_messages.columns(),
        gathered.tally,
        run.about,
        damage,
    )


class _MessageLists:
    """Delivery reports as growing columns."""

    def __init__(self) -> None:
        self._numbers = {name: array("q") for name in ("src", "dst", "kind", "fate", "sent", "got")}
        self._kinds: dict[str, int] = {}
        self._fates: dict[str, int] = {}

    def add(self, report: DeliveryReport) -> None:
        """Take in one report."""
        n, kinds, fates = self._numbers, self._kinds, self._fates
        n["src"].extend(report.src)
        n["dst"].extend([report.id] * len(report.src))
        n["kind"].extend([kinds.setdefault(k, len(kinds)) for k in report.kinds])
        n["fate"].extend([fates.setdefault(f, len(fates)) for f in report.fates])
        n["sent"].extend(report.sent_ns)
        n["got"].extend(report.delivered_ns)

    def columns(self) -> LinkMessages:
        """The columns."""
        src, dst, kind, fate, sent, got = (
            np.array(column, dtype=np.int64) for column in self._numbers.values()
        )
        delivered = np.where(got > 0, got / NS, np.nan)
        return LinkMessages(
            src, dst, kind, fate, sent / NS, delivered, tuple(self._kinds), tuple(self._fates)
        )


class _Gathered:
    """What one pass over the records leaves."""

    def __init__(self, run: RecordedRun) -> None:
        scenario = run.scenario
        self.tally = run_tally(scenario)
        self.arrivals = ArrivalMonitor(scenario)
        self.truths: defaultdict[int, list[Truth]] = defaultdict(list)
        self.said: defaultdict[type[Message], list[Message]] = defaultdict(list)
        self.link_messages = _MessageLists()
        self.strange = 0
        self._participants = run.participant_filter()
        self._gone: dict[tuple[int, str], list[list[float]]] = {}

    def take(self, record: Record) -> None:
        """Take in one record."""
        kind = codec.kind_of(record.topic)
        if record.topic != CLOCK and kind not in READ:
            return
        if record.topic == CLOCK:
            clock = self._participants.clock(record)
            self.strange += clock is None
            # Grants of other states do not say who is away.
            if clock is not None and clock.state in (ClockState.RUN, ClockState.PLAN):
                self._absent(clock.t_ns / NS, clock.held, clock.down)
            return
        message = self._participants.decode(record)
        if message is None:
            self.strange += 1
            return
        self.arrivals.add(message)
        if isinstance(message, Truth):
            self.truths[message.id].append(message)
            return
        self.tally.add(message)
        if isinstance(message, DeliveryReport):
            self.link_messages.add(message)
        elif isinstance(message, SAID):
            self.said[type(message)].append(message)

    def absences(self, end_s: float) -> dict[tuple[int, str], list[tuple[float, float]]]:
        """When each process was held or down."""
        return {
            key: [(since, min(until, end_s)) for since, until in spans]
            for key, spans in self._gone.items()
        }

    def _absent(self, now_s: float, held: tuple[int, ...], down: tuple[int, ...]) -> None:
        now = {(n, "held") for n in held} | {(n, "down") for n in down}
        for key in now:
            spans = self._gone.setdefault(key, [])
            if spans and now_s - spans[-1][1] < MERGED_S:
                spans[-1][1] = np.inf
            elif not spans or spans[-1][1] < np.inf:
                spans.append([now_s, np.inf])
        for key, spans in self._gone.items():
            if key not in now and spans[-1][1] == np.inf:
                spans[-1][1] = now_s


def _flight(uav: Uav, index: int, times_ns: list[int], truths: list[Truth]) -> Flight:
    """The true states of one UAV, laid on common times."""
    rows = np.full((len(times_ns), 12), np.nan)
    modes = np.full(len(times_ns), "", dtype="<U10")
    numbers = np.zeros((len(times_ns), 4), dtype=np.int64)
    place = {t_ns: at for at, t_ns in enumerate(times_ns)}
    for t in truths:
        at = place[t.t_ns]
        rows[at] = (
            *t.position_ned_m,
            t.speed_mps,
            t.heading_rad,
            t.flight_path_rad,
            t.guidance_heading_rad,
            t.guidance_climb_mps,
            t.commanded_heading_rad,
            t.commanded_climb_mps,
            t.commanded_level_down_m,
            np.nan if t.commanded_speed_mps is None else t.commanded_speed_mps,
        )
        modes[at] = t.mode
        numbers[at] = (t.waypoint_index, t.command_term, t.command_issuer, t.command_number)
    ned, speed, heading, path, guidance, commanded = np.split(rows, [3, 4, 5, 6, 8], axis=1)
    return Flight(
        uav,
        index,
        ned,
        speed[:, 0],
        heading[:, 0],
        path[:, 0],
        modes,
        numbers[:, 0],
        guidance,
        commanded,
        numbers[:, 1:],
    )
