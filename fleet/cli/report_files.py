"""Where reports go: formats of figures, and files that are not to be overwritten."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path

from fleet.errors import LogError


class ReportFormat(StrEnum):
    """What figures are written as."""

    png = "png"
    svg = "svg"
    pdf = "pdf"


def check_free(files: Sequence[Path], force: bool) -> None:
    """Refuse to overwrite anything, before anything is drawn; raises LogError."""
    for file in files:
        if file.is_dir():
            raise LogError(f"{file} is a directory; name a file in it")
        if file.exists() and not force:
            raise LogError(f"{file} exists already, not overwriting; use --force or another place")
