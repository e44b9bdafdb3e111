"""Text from logs, keys and other people's code, made fit for a terminal.

Control characters can move its cursor, set its title or hide text, and format characters, as those
that change the direction of writing, can make text look like another. They are shown as escapes in
the manner of JSON, so that lines of JSON mean the same afterwards.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Any

_UNSEEN = (
    r"\x00-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u0890\u0891\u08e2\u180e\u200b-\u200f"
    r"\u2028-\u202e\u2060-\u206f\ud800-\udfff\ufeff\ufff9-\ufffb\U000110bd\U000110cd"
    r"\U00013430-\U0001343f\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e007f"
)
"""Unicode's categories Cc, Cf, Cs, Zl and Zp."""

_ANY = re.compile(f"[{_UNSEEN}]")
_NOT_LAYOUT = re.compile(f"(?![\t\n])[{_UNSEEN}]")


def printable(text: str, *, layout: bool = False) -> str:
    """The text with escapes for what is unseen; with `layout` but for tabs and new lines."""
    return (_NOT_LAYOUT if layout else _ANY).sub(_escape, text)


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    if code < 0x10000:
        return f"\\u{code:04x}"
    high, low = divmod(code - 0x10000, 0x400)
    return f"\\u{0xD800 + high:04x}\\u{0xDC00 + low:04x}"


class PrintableStream:
    """A text stream that makes everything printable on its way to `raw`."""

    def __init__(self, raw: IO[str]) -> None:
        self.raw = raw

    def write(self, text: str) -> int:
        """Write the text, made printable, but for tabs and new lines."""
        self.raw.write(printable(text, layout=True))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write one after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        """All else is as with `raw`."""
        return getattr(self.raw, name)


def raw(stream: Any) -> IO[str]:
    """The stream as it was: for what is printable already, and has escape sequences of its own."""
    found: IO[str] = stream.raw if isinstance(stream, PrintableStream) else stream
    return found


@contextmanager
def printable_streams() -> Iterator[None]:
    """Make standard output and standard error printable for as long as the context lasts."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (PrintableStream(raw(s)) for s in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
