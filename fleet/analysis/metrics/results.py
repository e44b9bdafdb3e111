"""What is measured in one run, as objects, maps and flat tables (docs/metrics.md has every field).

SI units, NED, seconds of simulated time; None is what does not apply or cannot be known. Field
names end in their unit.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import Any, get_type_hints

import msgspec

from fleet.analysis.metrics.commands import CommandMetrics, CommandRow
from fleet.analysis.metrics.definition import Compared, Shown, described, metric_row
from fleet.analysis.metrics.elections import ElectionMetrics, TermRow
from fleet.analysis.metrics.links import LinkMetrics
from fleet.analysis.metrics.pairs import PairMetrics
from fleet.analysis.metrics.totals import SafetyTotals
from fleet.analysis.metrics.uavs import UavMetrics
from fleet.analysis.metrics.values import Incursion, Incursions, Volume
from fleet.analysis.words import arrival_text, counted, separation_text
from fleet.config.scenario import Scenario
from fleet.faults.rules import Rule


def _arrived_text(run: RunMetrics) -> str:
    return arrival_text(asdict(run.totals), len(run.uavs))


@metric_row
class RunMetrics:
    """Everything measured in one run; pairs are in order of least separation."""

    scenario: Scenario = described(
        "-",
        "the effective scenario, all settings",
        source="docs/scenarios.md",
    )
    plan: tuple[Rule, ...] = described(
        "-",
        "the fault plan at the end of the run, live changes included",
        source="docs/faults.md",
    )
    realtime: bool = described("-", "whether the run was in realtime", source="docs/protocol")
    complete: bool = described(
        "-",
        "whether the run was completed and its log is whole",
        compared=Compared(),
    )
    end_s: float = described(
        "s",
        "time of the last message on record",
        symbol="T",
        compared=Compared("measured_s"),
    )
    required: Volume = described(
        "m",
        "the volume `zone`: H = r_i + r_j horizontally, V = h_i + h_j vertically; where UAVs have "
        "zones of their own, of two with the least of them",
        symbol="H, V",
        source="paper, protected zones (Table 1)",
    )
    volumes: tuple[Volume, ...] = described(
        "m",
        "the further [volumes](#volume) that were looked at; `nmac` unless others are given",
        source="see Volume",
    )
    totals: SafetyTotals = described(
        "-",
        "all pairs together: [SafetyTotals](#safetytotals)",
        source="-",
        shown=Shown("all arrived", _arrived_text),
    )
    pairs: tuple[PairMetrics, ...] = described(
        "-",
        "[PairMetrics](#pairmetrics), in order of least separation",
        source="-",
    )
    uavs: tuple[UavMetrics, ...] = described("-", "[UavMetrics](#uavmetrics)", source="-")
    commands: CommandMetrics = described("-", "[CommandMetrics](#commandmetrics)", source="-")
    elections: ElectionMetrics = described(
        "-",
        "[ElectionMetrics](#electionmetrics)",
        source="-",
    )
    classes: tuple[LinkMetrics, ...] = described(
        "-",
        "[LinkMetrics](#linkmetrics) by class, all links together",
        source="-",
    )
    links: tuple[LinkMetrics, ...] = described(
        "-",
        "[LinkMetrics](#linkmetrics) by directed link and class",
        source="-",
    )

    def __repr__(self) -> str:
        """What was measured, in short; everything is in `as_dict()`."""
        least = self.totals.least_separation
        nearest = "" if least is None else f", least separation {separation_text(least)}"
        lost = counted(self.totals.pairs_lost, "pair")
        return (
            f"<metrics of {self.scenario.name}: {counted(len(self.uavs), 'UAV')}, "
            f"{self.end_s:g} s{nearest}, {lost} lost separation>"
        )

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
