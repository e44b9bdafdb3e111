"""Random traffic in a box, as the scenario `crossing` generates it."""

from __future__ import annotations

import random
from typing import Annotated

from msgspec import Meta

from fleet.config.scenario import LEAST_POSITIVE, Crossing, Positive, Scenario
from fleet.study.encounters.encounter_kind import DrawnEncounter, EncounterKind, FlightTime


class RandomTraffic(EncounterKind, frozen=True, tag="traffic"):
    """kind = "traffic": `count` UAVs of random place, altitude and heading, each run others.

    The seed of the run places them, so that it is the same traffic in every cell unless zones
    differ.
    """

    count: Annotated[int, Meta(ge=1, le=1000)] = 30
    density_per_km2: Annotated[float, Meta(ge=LEAST_POSITIVE, le=100.0)] = 0.25
    min_altitude_m: Positive = 200.0
    max_altitude_m: Positive = 400.0
    speed_mps: Annotated[float, Meta(gt=1.0, le=500.0)] = 25.0
    duration_s: FlightTime = 300.0

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:  # noqa: ARG002
        """Whom the scenario's generator places."""
        table = Crossing(
            self.count,
            self.density_per_km2,
            self.min_altitude_m,
            self.max_altitude_m,
            self.speed_mps,
        )
        return DrawnEncounter((), table, self.duration_s)
