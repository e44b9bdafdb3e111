"""Encounters that are scenarios of their own, as `fleet import` makes them."""

from __future__ import annotations

import random
from typing import Annotated

from msgspec import Meta

from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.study.encounters.encounter_kind import DrawnEncounter, EncounterKind


class ScenarioFiles(EncounterKind, frozen=True, tag="files"):
    """kind = "files": run k flies the UAVs of the k-th of these scenarios, and begins again.

    They are packaged names or paths, from the working directory. Nothing else is taken of them
    than who flies, and for how long.
    """

    paths: Annotated[tuple[str, ...], Meta(min_length=1, max_length=100_000)]

    def drawn(self, dice: random.Random, number: int, scenario: Scenario) -> DrawnEncounter:  # noqa: ARG002
        """The UAVs of a file."""
        found = load_scenario(self.paths[number % len(self.paths)])
        return DrawnEncounter(uavs_of(found), None, found.duration_s)
