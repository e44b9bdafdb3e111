"""Text files that users give: read whole, in UTF-8, and refused in a line if they are no such."""

from __future__ import annotations

import codecs
import os
import stat
from pathlib import Path

from fleet.errors import ScenarioError

_MARKS = {
    codecs.BOM_UTF32_LE: "UTF-32",
    codecs.BOM_UTF32_BE: "UTF-32",
    codecs.BOM_UTF16_LE: "UTF-16",
    codecs.BOM_UTF16_BE: "UTF-16",
}
"""How text in other encodings begins; the longer marks first, for one begins another."""


def file_text(path: Path, source: str, max_bytes: int, what: str, wanted: str) -> str:
    """The text of a file, with line feeds alone at the ends of lines.

    It is for `what`, as a scenario, and should be a `wanted`, as a TOML file: so say the errors.

    Raises:
        OSError: it cannot be opened or read; ValueError for a name that cannot be one.
        ScenarioError: it is no regular file, too large, or not UTF-8.

    """
    return _decoded(_read(path, max_bytes, what, wanted), source)


def _read(path: Path, max_bytes: int, what: str, wanted: str) -> bytes:
    """What is in a file; never waits for a pipe, nor reads a device that has no end."""
    with open(path, "rb", opener=_at_once) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ScenarioError(f"{path}: a device or a pipe, no file; name a {wanted}")
        text = file.read(max_bytes + 1)
    if len(text) > max_bytes:
        raise ScenarioError(f"{path}: too large for {what}, over {max_bytes >> 20} MiB")
    return text


def _at_once(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


def _decoded(text: bytes, source: str) -> str:
    """Text in UTF-8, with or without the mark that some editors put before it."""
    for mark, encoding in _MARKS.items():
        if text.startswith(mark):
            raise ScenarioError(f"{source}: text in {encoding}; save it as UTF-8")
    try:
        return text.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{source}: not a text file in UTF-8") from error
