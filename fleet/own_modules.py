"""Modules that make something known when they are imported: those of a package, and the user's."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys
import traceback
from pathlib import Path

from fleet.errors import FleetError

_OURS = Path(__file__).parent


def import_modules(package: str, variable: str) -> None:
    """Import every module of a package, and those that an environment variable names.

    That is a list with commas; they are looked for in the working directory, too.

    Raises:
        FleetError: one that is named is no module, or cannot be imported.

    """
    for module in pkgutil.iter_modules(importlib.import_module(package).__path__, f"{package}."):
        importlib.import_module(module.name)
    own = [name.strip() for name in os.environ.get(variable, "").split(",") if name.strip()]
    if own and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    for name in own:
        _import(name, variable)


def _import(name: str, variable: str) -> None:
    if name.startswith(".") or "/" in name or name.endswith(".py"):
        raise FleetError(f"{variable}: '{name}' is a path; name a module, as my_own or package.own")
    try:
        importlib.import_module(name)
    except ImportError as error:
        raise FleetError(f"{variable}: {error}") from error
    except Exception as error:  # user code: whatever it raises is the user's to mend
        why = f"{type(error).__name__}: {error}{_place(error)}"
        raise FleetError(f"{variable}: {name}: {why}") from error


def _place(error: Exception) -> str:
    """Where in the user's code, as in ` (my_own.py, line 3)`; a SyntaxError tells that itself."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith("<") and _OURS not in Path(frame.filename).parents
    ]
    theirs = [frame for frame in frames if "importlib" not in Path(frame.filename).parts]
    return f" ({Path(theirs[-1].filename).name}, line {theirs[-1].lineno})" if theirs else ""
