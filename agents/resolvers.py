"""How a scenario's `resolver` name becomes a resolver: a built-in one, or `module:Class`."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from importlib.machinery import PathFinder

from fleet.agents.advisory import Advisory, Resolver, Situation
from fleet.agents.geometric import GeometricResolver
from fleet.config.scenario import Scenario

BUILT_IN = ("geometric", "none")

_importing: list[str] = []


class NoResolver:
    """The baseline: nobody is ever told anything."""

    def __init__(self, scenario: Scenario) -> None:
        """Needs nothing of the scenario."""

    def resolve(self, _situation: Situation) -> Sequence[Advisory]:
        """No advisories."""
        return ()


def code_behind(name: str) -> str:
    """What would be imported for a resolver of this name, and from where; empty if it is built in.

    Nothing is imported to find that out.
    """
    if name in BUILT_IN:
        return ""
    module = name.partition(":")[0]
    top = module.partition(".")[0]
    try:
        # As the import will find it, but its parents are not imported to look into them.
        found = PathFinder.find_spec(top, [*sys.path, os.getcwd()])
    except (OSError, ValueError, ImportError):
        found = None
    places = [found.origin, *(found.submodule_search_locations or ())] if found else []
    where = next((str(place) for place in places if place), "")
    return f"module '{module}'{f', from {where}' if where else ''}"


def module_in_import() -> str:
    """The module that is being imported just now for its resolver; empty if none is."""
    return _importing[-1] if _importing else ""


def load_resolver(scenario: Scenario) -> Resolver:
    """The resolver that the scenario names: `geometric`, `none` or `module:Class`.

    Raises:
        ValueError: there is no such resolver; the message says what was tried.

    """
    name = scenario.resolver
    if name == "none":
        return NoResolver(scenario)
    if name == "geometric":
        return GeometricResolver(scenario)
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        raise ValueError(f"resolver '{name}': use 'geometric', 'none' or 'module:Class'")
    _importing.append(module)
    try:
        if os.getcwd() not in sys.path:
            sys.path.append(os.getcwd())
        made = getattr(importlib.import_module(module), attribute)(scenario)
    except Exception as error:  # user code: whatever it raises is the user's to mend
        why = f"{type(error).__name__}: {error}"
        raise ValueError(f"resolver '{name}' cannot be loaded ({why})") from error
    finally:
        _importing.pop()
    if not callable(getattr(made, "resolve", None)):
        raise ValueError(f"resolver '{name}' has no method resolve(situation)")
    resolver: Resolver = made
    return resolver
