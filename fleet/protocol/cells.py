"""Geographic cells: with a radio range, UAVs broadcast to the cell that they are in.

Cells are squares of the plane of north and east. Who listens to all within its reach hears whomever
it can hear, and is not sent what goes on further away.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from fleet.model.radio import SPARE, RadioRange
from fleet.model.types import Position

_NAME = re.compile(r"(0|-?[1-9]\d{0,9})_(0|-?[1-9]\d{0,9})")

CellBlock = tuple[int, int, int, int]
"""First and last row (north), first and last column (east) of a rectangle of cells."""


@dataclass(frozen=True, slots=True)
class Cells:
    """Squares of `size_m`; a UAV listens to all that are within `reach_m` north, south, east, west.

    Square 0_0 has its southwestern corner at the origin, square 2_-1 two to the north and one to
    the west of it.
    """

    size_m: float
    reach_m: float

    def name(self, place: Position) -> str:
        """The cell of a place."""
        row, column = self._square(place[0], place[1])
        return f"{row}_{column}"

    def block(self, place: Position) -> CellBlock:
        """The cells that a UAV at this place listens to."""
        north, east, _ = place
        low = self._square(north - self.reach_m, east - self.reach_m)
        high = self._square(north + self.reach_m, east + self.reach_m)
        return low[0], high[0], low[1], high[1]

    def _square(self, north: float, east: float) -> tuple[int, int]:
        return math.floor(north / self.size_m), math.floor(east / self.size_m)


def cells_for(radio: RadioRange) -> Cells | None:
    """The cells of a run; None: UAVs hear all others, and there is one cell for all."""
    if radio.uavs_m is None:
        return None
    size_m = max(radio.uavs_m, radio.margin_m)
    return Cells(size_m, SPARE * (radio.uavs_m + radio.margin_m))


def names_in(block: CellBlock) -> Iterator[str]:
    """The names of a rectangle of cells."""
    first_row, last_row, first_column, last_column = block
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            yield f"{row}_{column}"


def is_cell(name: str) -> bool:
    """Whether this can be the name of a cell."""
    return _NAME.fullmatch(name) is not None
