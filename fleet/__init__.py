"""A fleet of UAV processes over zenoh, for the study of cooperative collision avoidance.

Everything here is loaded when it is first used, so that `import fleet` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from fleet.version import __version__

if TYPE_CHECKING:
    from fleet.agents.advisory import Advisory, Aircraft, Candidate, Resolver, Situation
    from fleet.analysis.invariants import Verdict, Verdicts, check
    from fleet.analysis.metrics import NMAC, RunMetrics, Tolerance, Volume, measure
    from fleet.analysis.recorded_run import RecordedRun, open_log
    from fleet.config.loading import load_scenario, packaged
    from fleet.config.scenario import Scenario, Uav
    from fleet.errors import (
        ArgumentError,
        BusError,
        FleetError,
        FleetStoppedError,
        LogError,
        LogWriteError,
        MissingExtraError,
        NoRoomError,
        ScenarioError,
        StudyError,
    )
    from fleet.imports.importing import import_traffic
    from fleet.imports.scenario_making import ImportedTraffic
    from fleet.log.columns import Columns
    from fleet.log.store import Log, LogWarning
    from fleet.playback.player import ReplayReport
    from fleet.playback.replay import LogReplay
    from fleet.repetition.compare import Comparison
    from fleet.simulation.flying import RunWarning, repeat, run
    from fleet.study.loading import load_study
    from fleet.study.results import ResultsFolder, open_results
    from fleet.study.running import run_study
    from fleet.study.study_file import Study
    from fleet.study.summary import summaries

__all__ = (
    "NMAC",
    "Advisory",
    "Aircraft",
    "ArgumentError",
    "BusError",
    "Candidate",
    "Columns",
    "Comparison",
    "FleetError",
    "FleetStoppedError",
    "ImportedTraffic",
    "Log",
    "LogError",
    "LogReplay",
    "LogWarning",
    "LogWriteError",
    "MissingExtraError",
    "NoRoomError",
    "RecordedRun",
    "ReplayReport",
    "Resolver",
    "ResultsFolder",
    "RunMetrics",
    "RunWarning",
    "Scenario",
    "ScenarioError",
    "Situation",
    "Study",
    "StudyError",
    "Tolerance",
    "Uav",
    "Verdict",
    "Verdicts",
    "Volume",
    "__version__",
    "check",
    "import_traffic",
    "load_scenario",
    "load_study",
    "measure",
    "open_log",
    "open_results",
    "packaged",
    "repeat",
    "run",
    "run_study",
    "summaries",
)

_MODULES = {
    "fleet.analysis.invariants": ("Verdict", "Verdicts", "check"),
    "fleet.analysis.metrics": ("NMAC", "RunMetrics", "Tolerance", "Volume", "measure"),
    "fleet.analysis.recorded_run": ("RecordedRun", "open_log"),
    "fleet.agents.advisory": ("Advisory", "Aircraft", "Candidate", "Resolver", "Situation"),
    "fleet.config.loading": ("load_scenario", "packaged"),
    "fleet.config.scenario": ("Scenario", "Uav"),
    "fleet.errors": (
        "ArgumentError",
        "BusError",
        "FleetError",
        "FleetStoppedError",
        "LogError",
        "LogWriteError",
        "MissingExtraError",
        "NoRoomError",
        "ScenarioError",
        "StudyError",
    ),
    "fleet.imports.importing": ("import_traffic",),
    "fleet.imports.scenario_making": ("ImportedTraffic",),
    "fleet.log.columns": ("Columns",),
    "fleet.log.store": ("Log", "LogWarning"),
    "fleet.playback.player": ("ReplayReport",),
    "fleet.playback.replay": ("LogReplay",),
    "fleet.repetition.compare": ("Comparison",),
    "fleet.simulation.flying": ("RunWarning", "repeat", "run"),
    "fleet.study.loading": ("load_study",),
    "fleet.study.results": ("ResultsFolder", "open_results"),
    "fleet.study.running": ("run_study",),
    "fleet.study.study_file": ("Study",),
    "fleet.study.summary": ("summaries",),
}
_WHERE = {name: module for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:  # or type checkers would take every name for one that there is

    def __getattr__(name: str) -> Any:
        if name not in _WHERE:
            raise AttributeError(f"module 'fleet' has no attribute '{name}'")
        found = getattr(import_module(_WHERE[name]), name)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
