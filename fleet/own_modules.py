"""Modules that make something known when they are imported: those of a package, and the user's."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys

from fleet.errors import FleetError


def import_modules(package: str, variable: str) -> None:
    """Import every module of a package, and those that an environment variable names.

    That is a list with commas; they are looked for in the working directory, too.

    Raises:
        FleetError: one that is named cannot be imported.

    """
    for module in pkgutil.iter_modules(importlib.import_module(package).__path__, f"{package}."):
        importlib.import_module(module.name)
    own = [name for name in os.environ.get(variable, "").split(",") if name]
    if own and os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    for name in own:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise FleetError(f"{variable}: {error}") from error
