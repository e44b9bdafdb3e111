"""All vehicle models: those of `fleet.model.vehicle.models`, and such as a user defines.

A model makes itself known with `@vehicle_model`, before its class of `Performance`. Models of a
user are in modules that are imported before the first scenario is loaded: by the program that loads
it, or because the environment variable FLEET_VEHICLE_MODELS names them ("my_vehicle,other.one"),
which every process of a run sees. A scenario or a log only ever names a model that is known; no
code is imported because of what stands there.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, TypeVar, Union

from msgspec import structs

from fleet.model.vehicle.model import Performance
from fleet.own_modules import import_modules

OWN_MODELS = "FLEET_VEHICLE_MODELS"
DEFAULT_MODEL = "point_mass"

_known: dict[str, type[Performance]] = {}
_closed = False

P = TypeVar("P", bound=Performance)


def vehicle_model(cls: type[P]) -> type[P]:
    """Make a vehicle model known; raises TypeError if its class does not say all that it must."""
    name = str(cls.__struct_config__.tag)
    required = [field.name for field in structs.fields(cls) if field.required]
    if required:
        raise TypeError(f"{cls.__name__}: a vehicle model needs a default of {required[0]}")
    if cls.model is Performance.model:
        raise TypeError(f"{cls.__name__}: a vehicle model has to say what model() makes")
    other = _known.get(name)
    if other is not None and other.__qualname__ != cls.__qualname__:
        raise TypeError(f"{cls.__name__}: there is another vehicle model '{name}'")
    if _closed:
        raise TypeError(
            f"{cls.__name__}: a vehicle model has to be defined before a scenario is loaded"
        )
    _known[name] = cls
    return cls


def models() -> dict[str, type[Performance]]:
    """The class of each model's performance, by name; the paper's first."""
    _discover()
    return dict(sorted(_known.items(), key=lambda item: (item[0] != DEFAULT_MODEL, item[0])))


@functools.cache
def _discover() -> None:
    import_modules("fleet.model.vehicle.models", OWN_MODELS)


if TYPE_CHECKING:
    AnyPerformance = Performance
else:

    def __getattr__(name: str) -> Any:
        """`AnyPerformance`: that of any model, told by `vehicle`; from now on there are no more."""
        global _closed  # noqa: PLW0603
        if name != "AnyPerformance":
            raise AttributeError(name)
        found = Union[tuple(models().values())]  # noqa: UP007
        _closed = True
        return found
