"""What the metrics are computed from: a run, sorted into arrays in one pass.

The rest of this package knows a run by `Data` alone.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from fleet.analysis.common_times import Ints, positions_of
from fleet.analysis.recorded_run import RecordedRun
from fleet.config.scenario import Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import INCARNATION
from fleet.model.types import Array
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import (
    Ack,
    Command,
    Conflict,
    Decision,
    DeliveryReport,
    Election,
    Message,
    Truth,
)

"""Two UAVs, the lower number first."""

SEQ = 0xFFFFFFFF
"""A log keeps so many bits of a sequence number."""

"""Modes of the true states that the simulation writes for processes that do not run."""

_DECODED = {m.kind for m in (Truth, Election, Command, Ack, Decision, Conflict, DeliveryReport)}


@dataclass(frozen=True)
class Sends:
    """What one participant sent of one class: columns of shape (n,), by time of sending.

    `dst` is the receiver of addressed messages, and -1 for broadcasts.
    """

    seq: Ints
    t_ns: Ints
    bits: Ints
    dst: Ints


@dataclass(frozen=True)
class Receipts:
    """All delivery reports of one participant: columns of shape (n,), in order of the log.

    `step_ns` and `incarnation` are those of the report; `kind` and `fate` are places in
    `RunArrays.names`.
    """

    step_ns: Ints
    incarnation: Ints
    src: Ints
    kind: Ints
    seq: Ints
    sent_ns: Ints
    delivered_ns: Ints
    fate: Ints


@dataclass
class RunArrays:
    """One run. `positions_ned_m` has shape (UAVs, times, 3), NaN where a UAV is not on record."""

    scenario: Scenario
    plan: tuple[Rule, ...]
    realtime: bool
    complete: bool
    uavs: tuple[Uav, ...]
    times_ns: Ints
    positions_ned_m: Array
    truths: dict[int, dict[int, Truth]]
    end_ns: int = 0
    sends: dict[tuple[int, str], Sends] = field(default_factory=dict)
    receipts: dict[int, Receipts] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    elections: list[Election] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    acks: list[Ack] = field(default_factory=list)
    conflicts: list[Conflict] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)

    @property
    def ids(self) -> tuple[int, ...]:
        """Numbers of the UAVs, in order; the first axis of the positions."""
        return tuple(uav.id for uav in self.uavs)

    @property
    def coordinated(self) -> bool:
        """Whether there is a coordinator."""
        return self.scenario.coordination.electors == "coordinator"

    def code(self, name: str) -> int:
        """The number that stands for the name of a class or fate; -1 for none that occurs."""
        return self.names.index(name) if name in self.names else -1


def run_arrays(run: RecordedRun) -> RunArrays:
    """Sort a run; what is no valid message is left out (`fleet check` reports it)."""
    found, participant_filter = _Found(), run.participant_filter()
    sends: _Columns = defaultdict(list)
    end_ns = 0
    for record in run.records:
        address = participant_filter.address(record)
        if address is None:
            continue
        end_ns = max(end_ns, record.sent_ns)
        kind = codec.kind_of(record.topic)
        if kind in AUDIBLE:
            row = (record.seq & SEQ, record.sent_ns, 8 * len(record.payload), address.target)
            sends[address.issuer, kind].append(row)
        message = participant_filter.decode(record) if kind in _DECODED else None
        if message is not None:
            found.add(message)
    uavs = uavs_of(run.scenario)
    flown = {
        uav: {t: m.position_ned_m for t, m in own.items()} for uav, own in found.truths.items()
    }
    times_ns, positions = positions_of([uav.id for uav in uavs], flown)
    receipts, names = _receipts(found.deliveries)
    return RunArrays(
        run.scenario,
        run.plan,
        run.realtime,
        run.complete,
        uavs,
        times_ns,
        positions,
        found.truths,
        end_ns,
        {key: _sends(rows) for key, rows in sends.items()},
        receipts,
        names,
        found.elections,
        found.commands,
        found.acks,
        found.conflicts,
        found.decisions,
    )


_Columns = defaultdict[tuple[int, str], list[tuple[int, int, int, int]]]
"""Sequence number, time, bits and receiver, by sender and class."""


class _Found:
    """Decoded messages by class."""

    def __init__(self) -> None:
        self.truths: defaultdict[int, dict[int, Truth]] = defaultdict(dict)
        self.deliveries: defaultdict[int, list[DeliveryReport]] = defaultdict(list)
        self.elections: list[Election] = []
        self.commands: list[Command] = []
        self.acks: list[Ack] = []
        self.conflicts: list[Conflict] = []
        self.decisions: list[Decision] = []

    def add(self, message: Message) -> None:
        """Take in a message; of two true states of a moment the last one counts."""
        match message:
            case Truth():
                self.truths[message.id][message.t_ns] = message
            case DeliveryReport():
                self.deliveries[message.id].append(message)
            case Election():
                self.elections.append(message)
            case Command():
                self.commands.append(message)
            case Ack():
                self.acks.append(message)
            case Conflict():
                self.conflicts.append(message)
            case Decision():
                self.decisions.append(message)


def _sends(rows: list[tuple[int, int, int, int]]) -> Sends:
    return Sends(*np.array(sorted(rows, key=lambda r: r[1]), dtype=np.int64).T)


def _receipts(
    reports: dict[int, list[DeliveryReport]],
) -> tuple[dict[int, Receipts], tuple[str, ...]]:
    codes: dict[str, int] = {}
    out = {}
    for receiver, told in reports.items():
        lengths = [len(m.src) for m in told]
        columns: list[Ints] = [
            np.repeat(np.array([m.t_ns for m in told], dtype=np.int64), lengths),
            np.repeat(np.array([m.seq // INCARNATION for m in told], dtype=np.int64), lengths),
            _joined([m.src for m in told]),
            _joined([_coded(m.kinds, codes) for m in told]),
            _joined([m.seqs for m in told]) & SEQ,
            _joined([m.sent_ns for m in told]),
            _joined([m.delivered_ns for m in told]),
            _joined([_coded(m.fates, codes) for m in told]),
        ]
        out[receiver] = Receipts(*columns)
    return out, tuple(codes)


def _coded(names: tuple[str, ...], codes: dict[str, int]) -> tuple[int, ...]:
    return tuple([codes.setdefault(name, len(codes)) for name in names])


def _joined(parts: list[tuple[int, ...]]) -> Ints:
    return np.array([value for part in parts for value in part], dtype=np.int64)
