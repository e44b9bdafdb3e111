"""A file of zenoh's own configuration: laid below what the fleet sets itself.

What the fleet needs wins, and nothing is overridden in silence: a key to which the file gives
another value is an error. Pure but for reading the file; zenoh itself reads the JSON5 in it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fleet.config.text_files import file_text
from fleet.errors import BusError, ScenarioError

CONFIG_BYTES = 1 << 20
DEEPEST = 64
"""zenoh's reader of JSON5 ends the process where brackets are nested some thousands deep."""
OF_EACH_PROCESS = ("id",)
"""What every process must have its own of, though the fleet does not set it."""

ZenohTable = dict[str, Any]


def zenoh_file_text(file: str) -> str:
    """What is in the file.

    Raises:
        BusError: it is not there, no text, too large or nested too deeply.

    """
    try:
        text = file_text(Path(file), file, CONFIG_BYTES, "zenoh's configuration", "JSON5 file")
    except ScenarioError as error:
        raise BusError(str(error)) from error
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise BusError(f"--zenoh-config {file}: cannot be read: {why}") from error
    depth = deepest = 0
    for character in text:
        depth += (character in "[{") - (character in "]}")
        deepest = max(deepest, depth)
    if deepest > DEEPEST:
        raise BusError(f"--zenoh-config {file}: nested over {DEEPEST} deep")
    return text


def laid_below(own: Mapping[str, Any], file_table: ZenohTable, file: str) -> ZenohTable:
    """What a session is opened with: the table of the file, and above it what the fleet sets.

    `own` has keys as zenoh writes them, `transport/link/tx/lease`.

    Raises:
        BusError: the file has another value for a key of these; the message names it.

    """
    whole = json.loads(json.dumps(file_table))
    for key in OF_EACH_PROCESS:
        if key in file_table:
            raise BusError(f"--zenoh-config {file}: {key}: each process has its own; leave it out")
    for key, value in own.items():
        *way, last = key.split("/")
        _put(whole, _within(way, {last: value}), file)
    return dict(whole)


def _within(way: list[str], inner: ZenohTable) -> ZenohTable:
    """A table inside tables of these names."""
    for name in reversed(way):
        inner = {name: inner}
    return inner


def _put(whole: ZenohTable, own: ZenohTable, file: str, above: str = "") -> None:
    """Add a table to another, which may not say otherwise."""
    for name, value in own.items():
        key = f"{above}{name}"
        if name not in whole:
            whole[name] = value
        elif isinstance(value, dict) and isinstance(whole[name], dict):
            _put(whole[name], value, file, f"{key}/")
        elif whole[name] != value:
            raise BusError(f"--zenoh-config {file}: {key}: the fleet sets it itself; leave it out")
