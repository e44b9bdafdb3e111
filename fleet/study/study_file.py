"""The study file: strict, typed TOML (docs/studies.md explains every key)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, field

from fleet.config.scenario import ConfigTable, Positive, Seed
from fleet.study.encounters.as_planned import AsPlanned
from fleet.study.encounters.kinds import AnyEncounters

RunCount = Annotated[int, Meta(ge=1, le=10_000_000)]
FactorName = Annotated[str, Meta(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
LevelText = Annotated[str, Meta(min_length=1, max_length=100)]
LevelValue = int | float | str | bool
Number = Annotated[float, Meta(ge=-1e12, le=1e12)]


class LevelTable(ConfigTable, frozen=True):
    """[[factor.level]]: one level of a factor by name, and all that it sets."""

    label: LevelText
    set: dict[str, Any] = field(default_factory=dict)
    faults: dict[str, str | list[str]] = field(default_factory=dict)


class Factor(ConfigTable, frozen=True):
    """[[factor]]: what is varied: a scenario's key, an option for faults, or named levels.

    `values` are its levels in a grid; `low` and `high` bound it where the design draws points.
    `unit` follows the number in the text of a fault, as `s` or `%`.
    """

    name: FactorName
    key: str = ""
    fault: str = ""
    unit: str = ""
    values: tuple[LevelValue, ...] = ()
    level: tuple[LevelTable, ...] = ()
    low: Number | None = None
    high: Number | None = None

    @property
    def drawn(self) -> bool:
        """Whether it has a range and no levels."""
        return self.low is not None


class Design(ConfigTable, frozen=True):
    """[design]: which combinations of factors are flown, and how many points are drawn.

    `saltelli` draws what Sobol indices need: `points` times the number of factors and 2 cells.
    """

    kind: Literal["grid", "latin_hypercube", "sobol", "saltelli"] = "grid"
    points: Annotated[int, Meta(ge=2, le=100_000)] = 64


class NmacVolume(ConfigTable, frozen=True):
    """[nmac]: nearer than both is a near mid-air collision; by default 50 by 15 ft."""

    horizontal_m: Positive = 15.24
    vertical_m: Positive = 4.572


class Stopping(ConfigTable, frozen=True):
    """[stop]: a cell needs no more runs once an interval is this narrow.

    `half_width` is that of the probability of `event` (`lost` or `nmac`) at the confidence level
    `level`; it is looked at after every `look_every` runs, by intervals that cover at all looks
    together. Reports have the interval of their own level.
    """

    half_width: Annotated[float, Meta(ge=1e-6, lt=0.5)]
    event: Literal["lost", "nmac"] = "lost"
    look_every: RunCount = 100
    level: Annotated[float, Meta(gt=0.5, lt=1.0)] = 0.95


class Study(ConfigTable, frozen=True):
    """A whole study: a scenario, encounters in it, what is varied, and how often each is flown.

    `runs` of each cell are flown (with [stop] at most), each with an encounter of its number and
    with fault draws of its number, which are the same in all cells.
    """

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
    scenario: str = ""
    description: str = ""
    seed: Seed = 0
    runs: RunCount = 100
    set: dict[str, Any] = field(default_factory=dict)
    faults: dict[str, str | list[str]] = field(default_factory=dict)
    encounters: AnyEncounters = field(default_factory=AsPlanned)
    factor: tuple[Factor, ...] = ()
    design: Design = field(default_factory=Design)
    nmac: NmacVolume = field(default_factory=NmacVolume)
    stop: Stopping | None = None
    zenoh_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
