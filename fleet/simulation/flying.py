"""`fleet.run`: a scenario flown from a program, and `fleet.repeat`: one of a log flown again."""

from __future__ import annotations

import multiprocessing as mp
import shutil
import tempfile
import warnings
import weakref
from collections.abc import Callable, Mapping
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import msgspec

from fleet.agents.advisory import Resolver
from fleet.agents.resolvers import code_behind, load_resolver, module_in_import
from fleet.analysis.recorded_run import RecordedRun, run_from
from fleet.arguments import path_of, require, require_callable
from fleet.config.checks import leaderless
from fleet.config.idle_rules import idle_rules
from fleet.config.loading import checked, load_scenario
from fleet.config.scenario import Scenario
from fleet.errors import (
    ArgumentError,
    FleetError,
    FleetStoppedError,
    LogError,
    LogWriteError,
    ScenarioError,
)
from fleet.repetition.compare import Comparison, compare_runs
from fleet.repetition.logged_ticks import scenario_flown, ticks_of
from fleet.simulation.simulation import RunOptions, run_fleet

BusChoice = Literal["memory", "zenoh"]
ClockChoice = Literal["lockstep", "realtime"]
_IN_SCRIPT = "in the script that is run, which the processes of the UAVs do not import"


class RunWarning(UserWarning):
    """A scenario can be flown, but something in it does nothing; the message says what."""


def run(  # noqa: PLR0913 (a name has to be given with each but the first)
    scenario: Scenario | str | PathLike[str] | Mapping[str, Any],
    *,
    bus: BusChoice = "memory",
    clock: ClockChoice = "lockstep",
    resolver: Callable[[Scenario], Resolver] | str | None = None,
    out: str | PathLike[str] | None = None,
    overwrite: bool = False,
    speed: float = 0.0,
    connect: str = "",
    stall_s: float = 60.0,
    progress: Callable[[float], None] | None = None,
) -> RecordedRun:
    """Fly a scenario to its end; what comes back is on record, and can be measured and checked.

    `bus="memory"` flies everybody in this process, as fast as it can; `"zenoh"` starts a process
    for each UAV and one for the coordinator. Both give the same digest. `clock="realtime"` (zenoh
    only) goes by wall clocks, and `speed` paces lockstep to so many times real time.

    `resolver` is a class of yours, or the name of one, in place of the one that the scenario names;
    for zenoh it must be in a module, which other processes can import. `out` is the MCAP log, kept
    where it is named; without it there is one until the run is forgotten. `connect` is the endpoint
    of a zenoh router to use, `stall_s` how long to wait for anything to happen, `progress` is
    called with the simulated time in s after every tick.

    Nothing needs `if __name__ == "__main__":` unless the script itself is what `module:Class`
    names: started processes do not import the script that starts them.

    Raises:
        ScenarioError: the scenario, or its resolver, cannot be used.
        LogError: the log cannot be created; LogWriteError: it cannot be written to its end.
        BusError: the router is not there. NoRoomError: too many processes for this system.
        FleetStoppedError: the run became invalid, as when a process died that was not to.
        ArgumentError: arguments that exclude each other, or are nothing of the kind.
        KeyboardInterrupt: the run was interrupted; what is in the log is whole up to then.

    """
    _check_where(bus)
    require(speed, Real, "speed", "a number")
    require(stall_s, Real, "stall_s", "a number")
    require(connect, str, "connect", "an endpoint as tcp/HOST:PORT")
    require_callable(progress, "progress", "a function")
    if not isinstance(resolver, str):
        require_callable(resolver, "resolver", "a class or a name")
    log = None if out is None else path_of(out, "out", "the path of a log")
    _check_choices(bus, clock, speed, connect)
    flown = checked(scenario) if isinstance(scenario, Scenario) else load_scenario(scenario)
    if resolver is not None:
        flown = msgspec.structs.replace(flown, resolver=_name_of(resolver, bus))
    try:
        load_resolver(flown)
    except ValueError as error:
        raise ScenarioError(f"{flown.name}: {error}") from error
    _check_importable(flown, bus)
    for why in (leaderless(flown), *idle_rules(flown, realtime=clock == "realtime")):
        if why:
            warnings.warn(why, RunWarning, stacklevel=2)
    options = RunOptions(
        flown,
        clock=clock,
        bus=bus,
        speed=speed,
        force=overwrite,
        connect=connect,
        stall_s=stall_s,
    )
    if log is not None:
        if log.is_file() and not overwrite:
            raise LogError(f"{log} exists already: pass overwrite=True, or another out")
        return _flown(options.logged_to(log), progress)
    folder = tempfile.mkdtemp(prefix="fleet-run-")
    try:
        found = _flown(options.logged_to(Path(folder) / f"{flown.name}.mcap"), progress)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(found.records, shutil.rmtree, folder, ignore_errors=True)
    return found


def repeat(
    source: RecordedRun | str | PathLike[str], *, bus: BusChoice = "memory", trust: bool = False
) -> Comparison:
    """Fly a run, or that of a log, again and compare the two, tick by tick.

    `trust` imports and runs the resolver that the log names, if it is not a built-in one.

    Raises:
        LogError: it is of a realtime run, which nothing repeats bit by bit, or has no whole tick.
        ScenarioError: its resolver cannot be used, or is not trusted. Else as `run`.
        ArgumentError: it is neither a run nor a path.

    """
    original = run_from(source, "repeat")
    check_repeatable(original)
    scenario = scenario_flown(original)
    code = code_behind(scenario.resolver)
    if code and not trust:
        raise ScenarioError(
            f"{original.path}: its run names a resolver that would be imported, "
            f"'{scenario.resolver}' ({code}): pass trust=True to run it"
        )
    return compare_runs(original, ticks_of(run(scenario, bus=bus).records))


def check_repeatable(original: RecordedRun) -> None:
    """Raises LogError if a run cannot be flown again and compared."""
    if original.realtime:
        raise LogError(
            f"{original.path} is of a realtime run, which nothing repeats bit by bit; as a what-if "
            "it can be flown in lockstep: give --set or a fault"
        )
    if not original.ticks:
        raise LogError(f"{original.path} holds no whole tick: there is nothing to compare")


def _flown(options: RunOptions, progress: Callable[[float], None] | None) -> RecordedRun:
    outcome = run_fleet(options, lambda o: progress(o.sim_s) if progress else None)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt(outcome.why)
    if outcome.log_end is not None:
        raise LogWriteError(outcome.why)
    if outcome.status != "complete":
        raise FleetStoppedError(f"run INVALID at {outcome.sim_s:g} s: {outcome.why}")
    assert options.out is not None
    return RecordedRun.of_log(options.out)


def _check_where(bus: BusChoice) -> None:
    """Raises FleetError where no fleet can be flown from, with the remedy."""
    module = module_in_import()
    if module:
        raise FleetError(
            f"module '{module}' flies a fleet while it is imported for its resolver: put that "
            'below `if __name__ == "__main__":`'
        )
    if bus == "zenoh" and mp.current_process().daemon:
        raise FleetError(
            "this process must not start others, as those of multiprocessing.Pool must not: use "
            'bus="memory", or concurrent.futures'
        )


def _check_importable(scenario: Scenario, bus: BusChoice) -> None:
    """Raises ScenarioError for own kinds and models that the processes of UAVs cannot import."""
    performances = (scenario.performance, *(u.performance for u in scenario.uav if u.performance))
    for own in (*scenario.fault, *performances) if bus == "zenoh" else ():
        if type(own).__module__ == "__main__":
            raise ScenarioError(
                f"{type(own).__name__} is {_IN_SCRIPT}: put it into a module of its own, or use "
                'bus="memory"'
            )


def _check_choices(bus: BusChoice, clock: ClockChoice, speed: float, connect: str) -> None:
    if bus not in ("memory", "zenoh") or clock not in ("lockstep", "realtime"):
        raise ArgumentError(
            f"bus={bus!r}, clock={clock!r}: there are memory, zenoh; lockstep, realtime"
        )
    if bus == "memory" and (clock == "realtime" or speed or connect):
        raise ArgumentError('bus="memory" goes as fast as it can: no realtime, speed or connect')
    if clock == "realtime" and speed:
        raise ArgumentError('clock="realtime" has speed 1')


def _name_of(resolver: Callable[[Scenario], Resolver] | str, bus: BusChoice) -> str:
    """The name under which a class is found again; raises ScenarioError if it cannot be."""
    if isinstance(resolver, str):
        return resolver
    module, name = resolver.__module__, getattr(resolver, "__qualname__", "")
    if not name.isidentifier():
        raise ScenarioError(f"resolver {resolver!r}: a class at the top of a module is needed")
    if module == "__main__" and bus == "zenoh":
        raise ScenarioError(
            f'resolver {name} is {_IN_SCRIPT}: put it into a module of its own, or use bus="memory"'
        )
    return f"{module}:{name}"
