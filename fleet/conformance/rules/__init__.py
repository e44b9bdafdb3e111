"""The rules of the protocol that the conformance test knows, in the order of its table."""

from importlib import import_module

from fleet.conformance.rule import RULES

MODULES = ("joining", "telling", "electing", "obeying", "faults", "wall_clock")
"""The modules of rules, in that order."""

for _name in MODULES:
    import_module(f"{__name__}.{_name}")

__all__ = ["MODULES", "RULES"]
