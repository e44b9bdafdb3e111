"""How far ahead, how finely and with what separation it is looked for conflicts."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.model.conflict.risk import Required
from fleet.model.conflict.zones import ALL_ALIKE, ZoneRatios
from fleet.model.types import Array, Pair
from fleet.model.vehicle.fleet_models import FleetModels


@dataclass(frozen=True, slots=True)
class Outlook:
    """The models by which trajectories are predicted, at which times, and what must lie between.

    `required` is what two UAVs with the least zones require.
    """

    models: FleetModels
    times_s: Array
    required: Required
    zones: ZoneRatios = ALL_ALIKE

    def required_of(self, pair: Pair) -> Required:
        """What must lie between two UAVs."""
        return self.zones.of_pair(pair, self.required)

    @property
    def horizon_s(self) -> float:
        """T_s."""
        return float(self.times_s[-1])

    @property
    def step_s(self) -> float:
        """Between two samples."""
        return float(self.times_s[1])
