"""What a caller gives to the functions of `fleet`: wrong types are told in a line, and at once.

Type checkers find them beforehand; this is for who does not use one.
"""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

from fleet.errors import ArgumentError

LONGEST_SHOWN = 40


def require(value: object, kinds: type[Any] | tuple[type[Any], ...], where: str, what: str) -> None:
    """Raises ArgumentError if a value is of none of these kinds: `what` is expected, in words."""
    if not isinstance(value, kinds):
        shown = repr(value)
        if len(shown) > LONGEST_SHOWN:
            shown = f"this {type(value).__name__}"
        raise ArgumentError(f"{where}: expected {what}, not {shown}")


def require_callable(value: object, where: str, what: str) -> None:
    """Raises ArgumentError for what is neither None nor can be called."""
    if value is not None and not callable(value):
        require(value, (), where, what)


def path_of(value: object, where: str, what: str) -> Path:
    """The path that a text or path object is; raises ArgumentError for anything else."""
    require(value, (str, PathLike), where, what)
    assert isinstance(value, str | PathLike)
    return Path(value)


def require_each(
    values: object, kinds: type[Any] | tuple[type[Any], ...], where: str, what: str
) -> None:
    """Raises ArgumentError if it is no list or other collection of values of these kinds."""
    require(values, Iterable, where, what)
    assert isinstance(values, Iterable)
    if isinstance(values, str):
        require(values, (), where, what)
    for value in values:
        require(value, kinds, where, what)
