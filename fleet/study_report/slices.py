"""Parts of a grid that a figure shows: factors on its axes, one level of each of the others."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.study_report.study_data import ReportedCell, StudyData


@dataclass(frozen=True)
class GridSlice:
    """`axes` are the factors that vary, by number; `levels` the level of each other factor."""

    axes: tuple[int, ...]
    levels: dict[int, int]

    def counts(self, data: StudyData) -> tuple[int, ...]:
        """How many levels the factors on the axes have."""
        return tuple(len(data.factors[n].labels) for n in self.axes)

    def cell(self, data: StudyData, *at: int) -> ReportedCell:
        """The cell with these levels of the factors on the axes."""
        levels = {**self.levels, **dict(zip(self.axes, at, strict=True))}
        wanted = tuple(levels[n] for n in range(len(data.factors)))
        return next(cell for cell in data.cells if cell.at == wanted)

    def words(self, data: StudyData) -> str:
        """The levels of the other factors, where they have several; empty if there are none."""
        return ", ".join(
            f"{data.factors[n].name} {data.factors[n].labels[k]}"
            for n, k in self.levels.items()
            if len(data.factors[n].labels) > 1
        )
