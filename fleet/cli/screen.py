"""Tables and progress bars: what is in them is made printable, what draws them is not."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement, measure_renderables
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from fleet.printing import printable, raw


class Screen(Console):
    """A console on standard output, or standard error, that shows no text as it is not meant."""

    def __init__(self, *, stderr: bool = False, **more: Any) -> None:
        super().__init__(file=raw(sys.stderr if stderr else sys.stdout), **more)

    def print(self, *objects: Any, **more: Any) -> None:
        """Print as ever; no table breaks a word unless it is too long for any."""
        for table in objects:
            if isinstance(table, Table):
                fit_words(table, self.width)
        super().print(*objects, **more)

    def render_str(self, text: str, **more: Any) -> Text:
        """The text with its markup; made printable before it is measured."""
        return super().render_str(printable(text, layout=True), **more)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """The pieces of something that is drawn, each printable."""
        for piece in super().render(renderable, options):
            if piece.control:
                yield piece
            else:
                yield Segment(printable(piece.text, layout=True), piece.style)


def side_by_side(draw: Callable[[Sequence[int]], Table], columns: int, width: int) -> list[Table]:
    """A table as one, or as several below each other, so that no word is broken to fit `width`.

    `draw` makes the table of some of the columns; the first one, 0, is in each.
    """
    tables, part = list[Table](), [0]
    for column in range(1, columns):
        if len(part) > 1 and _room(draw([*part, column]), width) < 0:
            tables.append(draw(part))
            part = [0]
        part.append(column)
    return [*tables, draw(part)]


def fit_words(table: Table, width: int) -> None:
    """Fix the widths of columns so that lines end between words, if the words leave that room.

    Left to itself rich makes the widest columns narrower, also such as are one long word.
    """
    spans = _spans(table)
    widths = [span.maximum for span in spans]
    excess = sum(widths) + _BETWEEN * len(widths) + 1 - width
    if excess <= 0 or _room(table, width) < 0:
        return
    for _ in range(excess):
        widest = max(
            (n for n, span in enumerate(spans) if widths[n] > span.minimum), key=widths.__getitem__
        )
        widths[widest] -= 1
    for column, fitting in zip(table.columns, widths, strict=True):
        column.width = fitting


def _room(table: Table, width: int) -> int:
    """What a table has left of a width beside its longest words; negative if it is too narrow."""
    spans = _spans(table)
    return width - sum(span.minimum for span in spans) - (_BETWEEN * len(spans) + 1)


def _spans(table: Table) -> list[Measurement]:
    """Of each column its longest word, and its longest line."""
    console = Console(width=_UNBOUNDED)
    return [
        measure_renderables(console, console.options, [column.header, *column.cells])
        for column in table.columns
    ]


_UNBOUNDED = 10_000
_BETWEEN = 3
"""A line and two blanks go with each column; a line more ends the table."""


def name_in_lines(name: str, width: int) -> str:
    """A long name in lines of this width, if it can be parted behind `-`, `_`, `.` and `/`."""
    lines = [""]
    for piece in filter(None, re.findall(r"[^-_./]*[-_./]?", name)):
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(lines)
