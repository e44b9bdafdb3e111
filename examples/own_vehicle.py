"""A vehicle of your own: a multicopter, which turns at the same rate however fast it flies.

In a program import this module before a scenario is loaded; for the command line, name it:

    FLEET_VEHICLE_MODELS=own_vehicle fleet run head_on --set performance.vehicle=multicopter
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta

import fleet
from fleet.model.elementary import asin, exp, sin, sincos
from fleet.model.types import Array
from fleet.model.vehicle.limits import Limits
from fleet.model.vehicle.model import Performance
from fleet.model.vehicle.registry import vehicle_model
from fleet.model.vehicle.stepped import SteppedModel

G_MPS2 = 9.81


@vehicle_model
class MulticopterPerformance(Performance, frozen=True, tag="multicopter"):
    """The keys of `[performance]`, each with its range and default."""

    max_yaw_rate_degps: Annotated[float, Meta(ge=0.01, le=90.0)] = 20.0
    max_climb_mps: Annotated[float, Meta(ge=0.01, le=50.0)] = 6.0
    max_acceleration_mps2: Annotated[float, Meta(ge=0.01, le=20.0)] = 2.0
    max_vertical_acceleration_mps2: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.5
    response_s: Annotated[float, Meta(ge=0.01, le=5.0)] = 0.6

    def model(self, level_off_s: float) -> Multicopter:
        """In SI units and radians."""
        limits = MulticopterLimits(
            acceleration_mps2=self.max_acceleration_mps2,
            yaw_rate_radps=math.radians(self.max_yaw_rate_degps),
            climb_mps=self.max_climb_mps,
            vertical_mps2=self.max_vertical_acceleration_mps2,
        )
        return Multicopter(limits, level_off_s, self.response_s)

    def validate(self, speed_mps: float) -> Iterator[str]:
        """What types and ranges cannot say."""
        fastest = G_MPS2 / speed_mps
        if math.radians(self.max_yaw_rate_degps) > fastest:
            yield (
                f"performance.max_yaw_rate_degps: turns at {speed_mps:g} m/s would need more than "
                f"1 g; at most {math.degrees(fastest):.3g}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class MulticopterLimits(Limits):
    """What guidance and resolvers ask of it."""

    yaw_rate_radps: float
    climb_mps: float
    vertical_mps2: float

    def turn_rate_radps(self, speed_mps: float) -> float:
        """The same at each speed."""
        return self.yaw_rate_radps

    def steepest_rad(self, speed_mps: float) -> float:
        """Up to straight up, where it is slow."""
        return asin(min(1.0, self.climb_mps / speed_mps))

    def pitch_rate_radps(self, speed_mps: float) -> float:
        """What its vertical acceleration makes of the path."""
        return self.vertical_mps2 / speed_mps


@dataclass(frozen=True, slots=True)
class Multicopter(SteppedModel):
    """Heading, climb and speed each approach the setpoint, within a time constant of `response_s`.

    None of them faster than the limits.
    """

    limits: MulticopterLimits
    response_s: float

    def advance(self, states: Array, setpoints: Array, dt_s: float) -> Array:
        """Fly all of them for a short time."""
        north, east, down, speed, heading, path = states.T
        to_heading, to_climb, to_speed = setpoints.T
        limits, part = self.limits, 1.0 - exp(-dt_s / self.response_s)

        def towards(error: Array, limit: float) -> Array:
            return np.clip(part * error, -limit * dt_s, limit * dt_s)

        climb = speed * sin(path)
        to_climb = np.clip(to_climb, -limits.climb_mps, limits.climb_mps)
        turned = towards(to_heading - heading, limits.yaw_rate_radps)
        faster = towards(to_speed - speed, limits.acceleration_mps2)
        steeper = towards(to_climb - climb, limits.vertical_mps2)
        rate, ahead = climb + 0.5 * steeper, heading + 0.5 * turned
        mean, (sine, cosine) = speed + 0.5 * faster, sincos(ahead)
        level = np.sqrt(np.maximum(mean * mean - rate * rate, 0.0))
        columns = (
            north + dt_s * level * cosine,
            east + dt_s * level * sine,
            down - dt_s * rate,
            speed + faster,
            heading + turned,
            asin(np.clip((climb + steeper) / (speed + faster), -1.0, 1.0)),
        )
        return np.stack(columns, axis=1)


if __name__ == "__main__":
    scenario = fleet.load_scenario(
        "head_on", {"duration_s": 90, "uav.2.performance.vehicle": "multicopter"}
    )
    run = fleet.run(scenario)
    least = fleet.measure(run).totals.least_separation
    print(f"least separation {least:.3f}, {fleet.check(run).overall}")
