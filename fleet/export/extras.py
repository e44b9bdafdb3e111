"""Libraries that only some exports need: loaded when they are needed, or a line that says how."""

from __future__ import annotations

import importlib
from typing import Any

from fleet.log.recorder import LogError


class MissingExtraError(LogError):
    """A library is not installed; the message has the command that installs it."""


def import_extra(module: str, extra: str) -> Any:
    """A module that comes with an extra of this package; raises MissingExtraError."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"this needs the library '{module.partition('.')[0]}', which is not installed; "
            f"install it with: pip install 'zenoh-fleet[{extra}]'"
        ) from error
