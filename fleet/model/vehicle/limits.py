"""What guidance, checks and resolvers ask of any vehicle: how it can turn, climb and speed up."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits(ABC):
    """What a vehicle can do at most; each is asked at a speed along its path, in m/s.

    `acceleration_mps2` is how fast that speed changes, up or down.
    """

    acceleration_mps2: float

    @abstractmethod
    def turn_rate_radps(self, speed_mps: float) -> float:
        """How fast it turns in level flight, right or left."""

    @abstractmethod
    def steepest_rad(self, speed_mps: float) -> float:
        """The greatest flight path angle, up or down."""

    @abstractmethod
    def pitch_rate_radps(self, speed_mps: float) -> float:
        """How fast the flight path angle changes."""

    def turn_radius_m(self, speed_mps: float) -> float:
        """Radius of the tightest level turn."""
        return speed_mps / self.turn_rate_radps(speed_mps)
