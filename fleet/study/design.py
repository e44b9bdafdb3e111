"""The cells of a study: which combinations of its factors are flown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from fleet.extras import import_extra
from fleet.model.types import Array
from fleet.study.statistics.sensitivity import saltelli_points
from fleet.study.study_file import Factor, LevelValue, Study


@dataclass(frozen=True)
class FactorLevel:
    """A level of a factor: its name, its number if it has one, and what it sets."""

    factor: str
    label: str
    number: float | None
    settings: dict[str, Any]
    faults: dict[str, str | list[str]]


@dataclass(frozen=True)
class Cell:
    """A combination of levels, one of each factor; without factors there is one cell."""

    number: int
    levels: tuple[FactorLevel, ...]

    @cached_property
    def settings(self) -> dict[str, Any]:
        """All that its levels set, by dotted key."""
        return {k: v for level in self.levels for k, v in level.settings.items()}

    @cached_property
    def faults(self) -> dict[str, list[str]]:
        """All its levels' faults, by option."""
        out: dict[str, list[str]] = {}
        for level in self.levels:
            for name, texts in level.faults.items():
                out.setdefault(name, []).extend([texts] if isinstance(texts, str) else texts)
        return out

    @property
    def text(self) -> str:
        """The levels in words."""
        return ", ".join(f"{level.factor} {level.label}" for level in self.levels) or "no factor"


def cells_of(study: Study) -> list[Cell]:
    """The cells in order; in a grid the last factor varies fastest.

    Raises:
        MissingExtraError: the design draws points, and scipy is not installed.

    """
    if study.design.kind == "grid":
        chosen: Iterator[Sequence[FactorLevel]] = product(*(list(_levels(f)) for f in study.factor))
    else:
        chosen = (drawn_levels(study, row) for row in _points(study).tolist())
    return [Cell(number, tuple(levels)) for number, levels in enumerate(chosen)]


def drawn_levels(study: Study, numbers: Sequence[float]) -> list[FactorLevel]:
    """The levels of factors at a point, a number each."""
    return [_level(factor, number) for factor, number in zip(study.factor, numbers, strict=True)]


def _levels(factor: Factor) -> Iterator[FactorLevel]:
    for table in factor.level:
        yield FactorLevel(factor.name, table.label, None, table.set, table.faults)
    for value in factor.values:
        yield _level(factor, value)


def _level(factor: Factor, value: LevelValue) -> FactorLevel:
    number = None if isinstance(value, str | bool) else float(value)
    label = f"{label_of(value)}{factor.unit}"
    if factor.fault:
        return FactorLevel(factor.name, label, number, {}, {factor.fault: label})
    return FactorLevel(factor.name, label, number, {factor.key: value}, {})


def label_of(value: LevelValue) -> str:
    """A level in words, without its unit."""
    return str(value) if isinstance(value, str | bool) else f"{float(value):.10g}"


def _points(study: Study) -> Array:
    """Points (n, factors) of a design, scaled to the bounds of the factors."""
    qmc = import_extra("scipy.stats", "study").qmc
    bounds = [(f.low or 0.0, f.high or 0.0) for f in study.factor if f.drawn]
    if not bounds:
        return np.empty((1, 0))
    low, high = zip(*bounds, strict=True)
    kind, points, count = study.design.kind, study.design.points, len(bounds)
    if kind == "latin_hypercube":
        unit = qmc.LatinHypercube(count, rng=study.seed).random(points)
    elif kind == "sobol":
        unit = qmc.Sobol(count, rng=study.seed).random(points)
    else:
        unit = saltelli_points(count, points, study.seed)
    scaled: Array = qmc.scale(unit, low, high)
    return scaled
