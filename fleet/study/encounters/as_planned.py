"""Encounters as the scenario has them, scattered if that is wanted."""

from __future__ import annotations

import math
import random

import msgspec

from fleet.config.scenario import NotNegative, Scenario, Uav
from fleet.config.traffic import uavs_of
from fleet.model.elementary import sincos
from fleet.model.units import wrap_angle
from fleet.study.encounters.encounter_kind import DrawnEncounter, EncounterKind, uniform


class AsPlanned(EncounterKind, frozen=True, tag="as_planned"):
    """kind = "as_planned": the UAVs of the scenario, each started a little elsewhere and late.

    Places are scattered across and along the course and in altitude, uniformly within plus and
    minus these; waypoints stay. Without any scatter runs differ in their fault draws alone.
    """

    across_m: NotNegative = 0.0
    along_m: NotNegative = 0.0
    altitude_m: NotNegative = 0.0
    heading_deg: NotNegative = 0.0

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:  # noqa: ARG002
        """The scenario's UAVs, scattered."""
        if not any((self.across_m, self.along_m, self.altitude_m, self.heading_deg)):
            return DrawnEncounter()
        return DrawnEncounter(tuple(self._scattered(dice, uav) for uav in uavs_of(scenario)))

    def _scattered(self, dice: random.Random, uav: Uav) -> Uav:
        across_m, along_m, up_m, turn_deg = (
            uniform(dice, (-most, most))
            for most in (self.across_m, self.along_m, self.altitude_m, self.heading_deg)
        )
        sine, cosine = sincos(wrap_angle(math.radians(uav.heading_deg)))
        north, east, down = uav.position_ned_m
        place = (
            north + along_m * cosine - across_m * sine,
            east + along_m * sine + across_m * cosine,
            down - up_m,
        )
        heading_deg = math.remainder(uav.heading_deg + turn_deg, 360.0)
        return msgspec.structs.replace(uav, position_ned_m=place, heading_deg=heading_deg)
