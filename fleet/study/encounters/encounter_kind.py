"""What every kind of encounter is: a table of a study file, from which encounters are drawn.

A draw is a function of the seed of the study and the number of the encounter alone, so that each
cell meets the same ones, in whatever order they are flown.
"""

from __future__ import annotations

import hashlib
import random
from abc import abstractmethod
from typing import Annotated

from msgspec import Meta, Struct

from fleet.config.scenario import Crossing, Scenario, Uav
from fleet.errors import ScenarioError

DRAW_ATTEMPTS = 1000
"""So many draws are tried for one that starts with enough room."""


Span = tuple[float, float]
"""The least and the greatest of what is drawn uniformly."""

Speeds = tuple[Annotated[float, Meta(gt=1.0, le=500.0)], Annotated[float, Meta(gt=1.0, le=500.0)]]
Lengths = tuple[Annotated[float, Meta(ge=0.0, le=1e5)], Annotated[float, Meta(ge=0.0, le=1e5)]]
TimeSpan = tuple[Annotated[float, Meta(ge=0.0, le=1e4)], Annotated[float, Meta(ge=0.0, le=1e4)]]
FlightTime = Annotated[float, Meta(ge=1e-3, le=86_400.0)]
Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]


class DrawnEncounter(Struct, frozen=True):
    """Who flies, or how it is generated; without both as the scenario says.

    `weight` is how much more often it occurs than it is drawn, but for a common factor.
    """

    uavs: tuple[Uav, ...] = ()
    generate: Crossing | None = None
    duration_s: float | None = None
    weight: float = 1.0


class EncounterKind(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """[encounters]: draws encounter number k of a study."""

    @abstractmethod
    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:
        """The encounter of this number, with random numbers that are its own.

        `scenario` is the base scenario of the study. Raises ScenarioError if none can be drawn.
        """

    def problem(self) -> str:
        """What is wrong with the table that types cannot say, as `key: what`; empty if nothing."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            span = isinstance(value, tuple) and len(value) == 2 and not isinstance(value[0], str)
            if span and value[0] > value[1]:
                return f"{name}: the first is greater than the second"
        return ""


def dice_of(seed: int, number: int) -> random.Random:
    """The random numbers of encounter `number` in a study of this seed."""
    return random.Random(f"encounter {seed} {number}")


def fault_seed(seed: int, number: int) -> int:
    """The seed of the fault draws of run `number` in a study of this seed: 63 bits of BLAKE2b."""
    text = f"fault draws {seed} {number}".encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "little") >> 1


def either_sign(dice: random.Random, value: float) -> float:
    """The value, or just as probably its negative."""
    return -value if dice.random() < 0.5 else value


def uniform(dice: random.Random, span: Span) -> float:
    """Uniform between two values."""
    return span[0] + dice.random() * (span[1] - span[0])


def no_room(kind: str, number: int) -> ScenarioError:
    """That no encounter with enough room at its start was found."""
    return ScenarioError(
        f"encounters: no {kind} encounter for run {number} in {DRAW_ATTEMPTS} draws whose UAVs "
        "start apart_m from each other; lower apart_m, or give more room or time"
    )
