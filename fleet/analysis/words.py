"""Numbers in words, the same in tables, pages and figures."""

from __future__ import annotations

DIGITS, MOST_DIGITS = 3, 6


def separation_text(value: float) -> str:
    """A normalised separation, with as many digits as it takes to see whether it is below 1.

    What is lost never reads as `1.000`: it is `0.9996`, or `<1` if that needs too many digits.
    """
    for digits in range(DIGITS, MOST_DIGITS + 1):
        text = f"{value:.{digits}f}"
        if value >= 1.0 or float(text) < 1.0:
            return text
    return "<1"


def counted(count: int, one: str, many: str = "") -> str:
    """As in `1 pair` and `2 pairs`."""
    return f"{count} {one if count == 1 else many or one + 's'}"
