"""Tables and progress bars: what is in them is made printable, what draws them is not."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from fleet.printing import printable, raw


class Screen(Console):
    """A console on standard output, or standard error, that shows no text as it is not meant."""

    def __init__(self, *, stderr: bool = False, **more: Any) -> None:
        super().__init__(file=raw(sys.stderr if stderr else sys.stdout), **more)

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
