"""How wide a figure for a paper is, and labels of levels in lines that fit beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths of a column and of a page with two, in inches, as journals of IEEE have them."""
BESIDE_IN, LETTER_IN, LINE_IN = 0.8, 0.06, 0.13
"""What stands beside the axes, a letter of a label and a line of it, in inches."""
MOST_LINES = 3
"""Labels of more lines than these take the width of a page."""
CUT_LINES = 6
BREAK_LETTERS = 5
"""Shorter words are never broken."""


def in_lines(label: str, letters: int, lines: int = CUT_LINES) -> str:
    """A label in lines of so many letters; what goes beyond so many lines is left out."""
    width = max(letters, BREAK_LETTERS)
    return "\n".join(wrap(label, width, max_lines=lines, placeholder=" …")) or label


def line_count(labels: Sequence[str]) -> int:
    """The most lines that one of these labels has."""
    return max((label.count("\n") + 1 for label in labels), default=1)


def fitted(labels: Sequence[str]) -> tuple[float, list[str]]:
    """The width in inches of a figure that has these labels along it, and the labels in lines."""
    texts: list[str] = []
    for width_in in (COLUMN_IN, PAGE_IN):
        letters = int((width_in - BESIDE_IN) / max(len(labels), 1) / LETTER_IN)
        texts = [in_lines(label, letters) for label in labels]
        words = max((len(word) for label in labels for word in label.split()), default=0)
        if line_count(texts) <= MOST_LINES and words <= max(letters, BREAK_LETTERS):
            return width_in, texts
    return PAGE_IN, texts
