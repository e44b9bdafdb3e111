"""What the metrics of a run are: frozen rows of numbers (docs/metrics.md defines every field).

SI units, NED, seconds of simulated time; None is what does not apply or cannot be known. Field
names end in their unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, get_type_hints

import msgspec
import numpy as np

from fleet.config.scenario import Scenario
from fleet.faults.rules import Rule

FOOT_M = 0.3048


@dataclass(frozen=True, slots=True)
class Volume:
    """A cylinder round one UAV that others must stay out of: its radius and half its height."""

    name: str
    horizontal_m: float
    vertical_m: float


NMAC = Volume("nmac", 500.0 * FOOT_M, 100.0 * FOOT_M)
"""Near mid-air collision: nearer than 500 ft horizontally and than 100 ft vertically at once."""


@dataclass(frozen=True, slots=True)
class Spread:
    """How a number is distributed: quantiles are values that occur (the nearest rank)."""

    count: int = 0
    mean: float | None = None
    p50: float | None = None
    p95: float | None = None
    p99: float | None = None
    max: float | None = None

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread:
        """The spread of these values; blank for none."""
        ordered = np.sort(np.fromiter(values, dtype=np.float64))
        if not len(ordered):
            return cls()
        last = len(ordered) - 1
        p50, p95, p99 = (float(ordered[round(q * last)]) for q in (0.50, 0.95, 0.99))
        return cls(len(ordered), float(ordered.mean()), p50, p95, p99, float(ordered[-1]))


@dataclass(frozen=True, slots=True)
class Incursion:
    """One time for which a pair was inside a volume."""

    start_s: float
    end_s: float
    severity: float


@dataclass(frozen=True, slots=True)
class Incursions:
    """How often, how long and how far a pair was inside a volume."""

    volume: str
    count: int
    duration_s: float
    severity: float
    first_s: float | None
    events: tuple[Incursion, ...]


@dataclass(frozen=True, slots=True)
class PairMetrics:
    """Two UAVs: how near they came, and when that was foreseen."""

    a: int
    b: int
    least_separation: float
    horizontal_m: float
    vertical_m: float
    t_s: float
    cpa_m: float
    cpa_at_s: float
    horizontal_miss_m: float
    vertical_miss_m: float
    losses: Incursions
    volumes: tuple[Incursions, ...]
    alerted_s: float | None
    time_to_violation_s: float | None
    true_time_to_violation_s: float | None
    alert_lead_s: float | None
    at_risk_s: float
    without_computing_s: float


@dataclass(frozen=True, slots=True)
class UavMetrics:
    """One UAV: whether it arrived, how far avoidance took it from its plan, and for how long."""

    id: int
    aircraft: str
    arrived: bool
    arrival_s: float | None
    planned_arrival_s: float | None
    due: bool
    delay_s: float | None
    flown_s: float
    commanded_s: float
    unmanned_s: float
    path_deviation_mean_m: float
    path_deviation_max_m: float
    altitude_deviation_mean_m: float
    altitude_deviation_max_m: float
    off_plan_s: float
    released_s: float | None
    back_on_plan: bool
    back_on_plan_s: float | None


@dataclass(frozen=True, slots=True)
class CommandRow:
    """One command, with all its repetitions and answers."""

    term: int
    issuer: int
    number: int
    target: int
    manoeuvre: str
    issued_s: float
    transmissions: int
    outcome: str
    reason: str
    latency_s: float | None
    state_age_s: float | None


@dataclass(frozen=True, slots=True)
class CommandMetrics:
    """All commands of a run."""

    issued: int
    transmissions: int
    applied: int
    unanswered: int
    duplicates: int
    refused: int
    refused_by_reason: dict[str, int]
    latency_s: Spread
    rounds: int
    unresolved: int
    state_age_s: Spread
    rows: tuple[CommandRow, ...]


@dataclass(frozen=True, slots=True)
class TermRow:
    """One term: who elected whom."""

    term: int
    elector: int
    computing: int
    members: tuple[int, ...]
    announced_s: float
    announcements: int
    change: bool


@dataclass(frozen=True, slots=True)
class ElectionMetrics:
    """All elections of a run, and the time for which they left somebody without a computing UAV."""

    terms: int
    by_uavs: int
    changes: int
    announcements: int
    at_risk_s: float
    without_computing_s: float
    longest_without_s: float
    rows: tuple[TermRow, ...]


@dataclass(frozen=True, slots=True)
class LinkMetrics:
    """One directed link (0 is the coordinator), or all together (None), and a class of messages."""

    src: int | None
    dst: int | None
    kind: str
    sent: int
    delivered: int
    copies: int
    dropped: dict[str, int]
    settled: int
    delivery_ratio: float | None
    delivery_low: float | None
    delivery_high: float | None
    expected_ratio: float | None
    latency_s: Spread
    expected_latency_s: Spread


@dataclass(frozen=True, slots=True)
class SafetyTotals:
    """The safety of a run in a line: what all pairs make together."""

    pairs: int
    least_separation: float | None
    pairs_lost: int
    losses: int
    loss_s: float
    severity: float
    incursions: dict[str, int]
    pairs_alerted: int
    missed_alerts: int
    path_deviation_max_m: float
    altitude_deviation_max_m: float
    all_arrived: str
    arrived: int
    due: int
    not_arrived: tuple[int, ...]
    delay_mean_s: float | None
    delay_max_s: float | None


@dataclass(frozen=True, slots=True)
class RunMetrics:
    """Everything measured in one run; pairs are in order of least separation."""

    scenario: Scenario
    plan: tuple[Rule, ...]
    realtime: bool
    complete: bool
    end_s: float
    required: Volume
    volumes: tuple[Volume, ...]
    totals: SafetyTotals
    pairs: tuple[PairMetrics, ...]
    uavs: tuple[UavMetrics, ...]
    commands: CommandMetrics
    elections: ElectionMetrics
    classes: tuple[LinkMetrics, ...]
    links: tuple[LinkMetrics, ...]

    def as_dict(self) -> dict[str, Any]:
        """Everything as maps, lists, text and numbers, for JSON."""
        found: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(self))
        return found

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """Flat rows by name of table, as for CSV files and data frames."""
        rows: dict[str, Iterable[Any]] = {
            "pairs": self.pairs,
            "uavs": self.uavs,
            "commands": self.commands.rows,
            "elections": self.elections.rows,
            "classes": self.classes,
            "links": self.links,
        }
        tables = {name: [flat(row) for row in found] for name, found in rows.items()}
        tables["incursions"] = [
            {"a": pair.a, "b": pair.b, "volume": held.volume, **flat(event)}
            for pair in self.pairs
            for held in (pair.losses, *pair.volumes)
            for event in held.events
        ]
        return tables

    def columns(self) -> dict[str, list[str]]:
        """The names of the columns of all tables, also of those without rows."""
        rows = {
            "pairs": PairMetrics,
            "uavs": UavMetrics,
            "commands": CommandRow,
            "elections": TermRow,
            "classes": LinkMetrics,
            "links": LinkMetrics,
        }
        columns = {name: metric_columns(row, self.volumes) for name, row in rows.items()}
        return {**columns, "incursions": ["a", "b", "volume", *metric_columns(Incursion, ())]}


def flat(row: Any) -> dict[str, Any]:
    """A row as one map: rows inside it add columns with their names in front, lists are text."""
    out: dict[str, Any] = {}
    for name in (f.name for f in fields(row)):
        value = getattr(row, name)
        if isinstance(value, Incursions):
            out |= _incursions(name, value)
        elif isinstance(value, tuple) and all(isinstance(v, Incursions) for v in value):
            for held in value:
                out |= _incursions(f"incursions_{held.volume}", held)
        elif is_dataclass(value):
            out |= {f"{name}_{key}": part for key, part in flat(value).items()}
        elif isinstance(value, dict):
            out[name] = " ".join(f"{key}={part}" for key, part in value.items())
        elif isinstance(value, tuple):
            out[name] = " ".join(map(str, value))
        else:
            out[name] = value
    return out


def metric_columns(row: type[Any], volumes: Sequence[Volume]) -> list[str]:
    """The names that `flat` gives to the columns of a class of rows."""
    out: list[str] = []
    for name, hint in get_type_hints(row).items():
        if hint is Incursions:
            out += _incursion_columns(name)
        elif hint == tuple[Incursions, ...]:
            for volume in volumes:
                out += _incursion_columns(f"incursions_{volume.name}")
        elif is_dataclass(hint):
            assert isinstance(hint, type)
            out += [f"{name}_{key}" for key in metric_columns(hint, volumes)]
        else:
            out.append(name)
    return out


def _incursions(name: str, held: Incursions) -> dict[str, Any]:
    values = (held.count, held.duration_s, held.severity, held.first_s)
    return dict(zip(_incursion_columns(name), values, strict=True))


def _incursion_columns(name: str) -> list[str]:
    return [name, f"{name}_s", f"{name}_severity", f"{name}_first_s"]
