"""All kinds of faults: those of `fleet.faults.kinds`, and such as a user defines.

A kind makes itself known with `@fault_kind`. Kinds of a user are in modules that are imported
before the first scenario is loaded: by the program that loads it, or because the environment
variable FLEET_FAULT_KINDS names them ("my_faults,other.faults"), which every process of a run sees.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, TypeVar, Union

from fleet.faults.clock import ClockRule
from fleet.faults.lifecycle import ProcessRule
from fleet.faults.links import LinkRule
from fleet.faults.options import Shorthand, Variation
from fleet.faults.rules import Rule
from fleet.faults.sensors import SensorRule
from fleet.own_modules import import_modules

OWN_KINDS = "FLEET_FAULT_KINDS"

GROUPS: tuple[type[Rule], ...] = (LinkRule, ProcessRule, SensorRule, ClockRule)
"""The groups of kinds, in the order in which options of the command line make rules of them."""

_FIRST = (
    *("latency", "loss", "burst", "range", "partition"),
    *("duplicate", "replay", "reorder", "corrupt", "rate"),
    *("clock", "navigation", "kill", "pause", "slow"),
)
"""The order of the oldest kinds, as random cases are drawn from them; others follow by name."""

_known: dict[str, type[Rule]] = {}
_closed = False

R = TypeVar("R", bound=Rule)


def fault_kind(cls: type[R]) -> type[R]:
    """Make a kind of rule known; raises TypeError if it does not say all that it must."""
    kind = str(cls.__struct_config__.tag)
    unsaid = list(cls.unsaid())
    if unsaid or not issubclass(cls, GROUPS):
        what = ", ".join(unsaid) or "link, process, sensor or clock"
        raise TypeError(f"{cls.__name__}: a kind of fault has to say {what}")
    other = _known.get(kind)
    if other is not None and other.__qualname__ != cls.__qualname__:
        raise TypeError(f"{cls.__name__}: there is another kind of fault '{kind}'")
    if _closed:
        raise TypeError(
            f"{cls.__name__}: a kind of fault has to be defined before the first scenario is "
            "loaded; to define it anew, start Python anew"
        )
    _known[kind] = cls
    return cls


def kinds() -> dict[str, type[Rule]]:
    """The class of each kind, by name, in a fixed order."""
    _discover()
    place = {kind: n for n, kind in enumerate(_FIRST)}
    return dict(sorted(_known.items(), key=lambda item: (place.get(item[0], len(place)), item[0])))


def kinds_of(group: type[R]) -> dict[str, type[R]]:
    """The kinds of a group."""
    return {kind: cls for kind, cls in kinds().items() if issubclass(cls, group)}


def options() -> list[tuple[str, Shorthand | Variation]]:
    """The options of the command line, each with its kind, in the order of the rules they make."""
    found = [
        (kind, option)
        for group in GROUPS
        for kind, cls in kinds_of(group).items()
        for option in cls.shorthands
        if "shorthands" in vars(cls)
    ]
    names = [option.option for _, option in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise TypeError(f"two kinds of faults have the option --{min(twice)}")
    return found


@functools.cache
def _discover() -> None:
    """Import every module of a kind."""
    import_modules("fleet.faults.kinds", OWN_KINDS)


if TYPE_CHECKING:
    FaultRule = Rule
else:

    def __getattr__(name: str) -> Any:
        """`FaultRule`: any kind of rule, told apart by `kind`; from now on there are no others."""
        global _closed  # noqa: PLW0603
        if name != "FaultRule":
            raise AttributeError(name)
        found = Union[tuple(kinds().values())]  # noqa: UP007
        _closed = True
        return found
