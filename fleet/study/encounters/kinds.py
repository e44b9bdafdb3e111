"""All kinds of encounters: each class is a module of this package and a member of the union."""

from __future__ import annotations

from fleet.study.encounters.as_planned import AsPlanned
from fleet.study.encounters.converging import Converging
from fleet.study.encounters.overtaking import Overtaking
from fleet.study.encounters.pairs import Pairs
from fleet.study.encounters.scenario_files import ScenarioFiles
from fleet.study.encounters.traffic import RandomTraffic

AnyEncounters = AsPlanned | Pairs | Overtaking | Converging | RandomTraffic | ScenarioFiles
