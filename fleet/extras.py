"""Libraries that only some functions need: loaded when they are needed, or a line that says how."""

from __future__ import annotations

import importlib
from typing import Any

from fleet.errors import MissingExtraError


def import_extra(module: str, extra: str, what: str = "this") -> Any:
    """A module that comes with an extra of this package, for `what`; raises MissingExtraError."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{what} needs the library '{module.partition('.')[0]}', which is not installed; "
            f"install it with: pip install 'zenoh-fleet[{extra}]'"
        ) from error
