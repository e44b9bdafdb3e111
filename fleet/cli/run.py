"""`fleet run` and `fleet scenarios`."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from fleet.agents.resolvers import load_resolver
from fleet.analysis.words import separation_text
from fleet.cli.environment import CONNECT_VARIABLE, SECURE_VARIABLE, ZENOH_CONFIG_VARIABLE
from fleet.cli.faults import Given, fault_tables, with_fault_options
from fleet.cli.live import FoxgloveControl, shown_beside
from fleet.cli.result import fault_lines, result_tables, warning_lines
from fleet.cli.screen import Screen
from fleet.cli.secure import Secure
from fleet.cli.zenoh_config import ZenohConfig
from fleet.config.loading import packaged, read_scenario, with_faults
from fleet.config.scenario import Scenario
from fleet.errors import ScenarioError
from fleet.faults.lifecycle import ProcessRule
from fleet.faults.registry import kinds_of
from fleet.log.new_files import keep
from fleet.model.words import BusKind, ClockMode, OnLogError
from fleet.printing import printable
from fleet.simulation.result import result_json
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet
from fleet.transport.zenoh_session import LEASE_S

REFRESH_S = 0.1


def register(app: typer.Typer) -> None:
    """Add the commands of this module."""
    app.command("run")(run_scenario)
    app.command("scenarios")(scenarios)


@with_fault_options
def run_scenario(
    scenario: Annotated[
        str, typer.Argument(help="A packaged scenario (see 'fleet scenarios') or a TOML file.")
    ],
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of everything random; repeats a run exactly.")
    ] = None,
    clock: Annotated[
        ClockMode,
        typer.Option(help="lockstep: simulated time, exactly repeatable. realtime: wall clocks."),
    ] = ClockMode.LOCKSTEP,
    speed: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Pace lockstep to this many times real time; 0 (default): as fast as it goes.",
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Simulated seconds, instead of the scenario's.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The MCAP log; default SCENARIO-TIME-ID.mcap here.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing log.")] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change any scenario field, as in resolution.horizon_s=30 or uav.2.speed_mps=20. "
            "Can be given many times.",
        ),
    ] = None,
    connect: Annotated[
        str,
        typer.Option(
            metavar="ENDPOINT",
            help="Use the zenoh router at this endpoint (tcp/HOST:PORT) instead of an own one.",
        ),
    ] = "",
    external: Annotated[
        bool,
        typer.Option(
            "--external",
            help="Start no processes; wait for 'fleet uav' and 'fleet coordinator' to join.",
        ),
    ] = False,
    join_timeout: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            max=86_400.0,
            help="With --external: give up when nobody has joined for so many seconds (60).",
        ),
    ] = None,
    wait: Annotated[
        float,
        typer.Option(min=0.1, max=3600.0, help="Seconds to wait for the router of --connect."),
    ] = 10.0,
    on_log_error: Annotated[
        OnLogError,
        typer.Option(
            help="What to do when the log cannot be written, as on a full disk: stop the run, or "
            "continue without."
        ),
    ] = OnLogError.STOP,
    bus: Annotated[
        BusKind,
        typer.Option(help="zenoh: one process per UAV. memory: all in one, with the same digest."),
    ] = BusKind.ZENOH,
    stall: Annotated[
        float,
        typer.Option(
            min=1.0, max=86_400.0, help="Give up when nothing happens for so many seconds."
        ),
    ] = 60.0,
    secure: Secure = "",
    zenoh_config: ZenohConfig = "",
    lease: Annotated[
        float,
        typer.Option(
            min=0.5,
            max=86_400.0,
            help="A link to the router may be silent for so many seconds before it counts as lost.",
        ),
    ] = LEASE_S,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Show it on a page in the browser, at real time unless --speed."
        ),
    ] = False,
    foxglove: Annotated[
        bool, typer.Option("--foxglove", help="The same for Foxglove or Lichtblick, at port 8765.")
    ] = False,
    foxglove_control: FoxgloveControl = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object, nothing else.")
    ] = False,
    *,
    faults: Given,
) -> int:
    """Fly a scenario: a process per UAV, a coordinator, and this one, which records an MCAP log.

    \b
    Examples:
      fleet run four_way
      fleet run head_on --set resolution.horizon_s=20 --out head_on.mcap
      fleet run crossing --seed 7 --set resolver=none --json
      fleet run four_way --latency 500ms --loss 30% --seed 1
    """  # noqa: D301 (the \b keeps the lines apart)
    overrides = list(settings or [])
    if seed is not None:
        overrides.append(f"seed={seed}")
    if duration is not None:
        overrides.append(f"duration_s={duration}")
    loaded = read_scenario(scenario, overrides)
    tables = fault_tables(faults, loaded.scenario.surveillance.broadcast_s)
    flown = with_faults(loaded.scenario, tables, scenario)
    if external:
        connect = connect or os.environ.get(CONNECT_VARIABLE, "")
        secure = secure or os.environ.get(SECURE_VARIABLE, "")
        zenoh_config = zenoh_config or os.environ.get(ZENOH_CONFIG_VARIABLE, "")
    _check_options(clock, bus, speed, connect, external, secure or zenoh_config)
    foxglove = foxglove or foxglove_control
    if live or foxglove:
        speed = _watched_speed(bus, clock, speed)
    keep(Path(scenario), out)
    _check_external(flown, external=external, join_timeout_s=join_timeout)
    try:
        load_resolver(flown)
    except ValueError as error:
        raise ScenarioError(f"{scenario}: {error}") from error
    stamp = time.strftime("%Y%m%d-%H%M%S")
    options = RunOptions(
        flown,
        loaded.text,
        loaded.overrides,
        clock.value,
        bus.value,
        speed or 0.0,
        out,
        force,
        connect,
        external,
        wait,
        stall,
        secure,
        lease,
        60.0 if join_timeout is None else join_timeout,
        zenoh_config,
        on_log_error.value,
    )
    if out is None:
        options = options.logged_to(Path(f"{flown.name}-{stamp}-{options.run}.mcap"))
    realtime = clock is ClockMode.REALTIME
    for line in [*fault_lines(flown.fault), *warning_lines(flown, tables, realtime=realtime)]:
        print(line, file=sys.stderr)
    _tell_of_faults(options)
    with shown_beside(
        options.run, secure, live=live, foxglove=foxglove, foxglove_control=foxglove_control
    ):
        outcome = _with_progress(options)
    result = result_json(outcome)
    if as_json:
        print(json.dumps(result))
    else:
        Screen().print(*result_tables(result), sep="\n")
    _tell_of_end(outcome)
    return {"complete": 0, "interrupted": 130}.get(outcome.status, 1)


def _watched_speed(bus: BusKind, clock: ClockMode, speed: float | None) -> float | None:
    """Real time, unless another speed was given: or a run would be over before it is seen."""
    if bus is BusKind.MEMORY:
        raise typer.BadParameter("--bus memory cannot be watched: drop --live, --foxglove")
    return 1.0 if speed is None and clock is ClockMode.LOCKSTEP else speed


def _tell_of_end(outcome: RunOutcome) -> None:
    """Say of a run that was not completed why, and where its log is."""
    if outcome.status != "complete":
        verdict = "INVALID" if outcome.status == "invalid" else "INTERRUPTED"
        log = f"; the log up to then is {outcome.log}" if outcome.log else ""
        print(
            f"fleet: run {verdict} at {outcome.sim_s:g} s: {printable(outcome.why)}{log}",
            file=sys.stderr,
        )


def _tell_of_faults(options: RunOptions) -> None:
    """How the faults of the run can be changed while it is on."""
    if options.speed or options.clock == ClockMode.REALTIME:
        print(f"run {options.run}: 'fleet fault {options.run} ...' changes it", file=sys.stderr)


def _check_options(
    clock: ClockMode, bus: BusKind, speed: float | None, connect: str, external: bool, links: str
) -> None:
    """Combinations that make no sense."""
    if bus is BusKind.MEMORY:
        if clock is ClockMode.REALTIME:
            raise typer.BadParameter("--bus memory has no wall clock: use --clock lockstep")
        if connect or external:
            raise typer.BadParameter("--bus memory needs no router: drop --connect and --external")
        if links:
            raise typer.BadParameter("--bus memory has no links: drop --secure, --zenoh-config")
        if speed:
            raise typer.BadParameter("--bus memory runs as fast as it can: drop --speed")
    if clock is ClockMode.REALTIME and speed is not None:
        raise typer.BadParameter("--clock realtime has speed 1: drop --speed")
    if external and not connect:
        raise typer.BadParameter(
            f"--external needs --connect ENDPOINT (or {CONNECT_VARIABLE}), so that others know "
            "where to join"
        )


def _check_external(flown: Scenario, *, external: bool, join_timeout_s: float | None) -> None:
    """What goes only with processes of others, or only without."""
    if external and any(isinstance(rule, ProcessRule) for rule in flown.fault):
        raise typer.BadParameter(
            f"faults of processes ({', '.join(kinds_of(ProcessRule))}) are for those that this "
            "simulation starts: drop --external"
        )
    if join_timeout_s is not None and not external:
        raise typer.BadParameter("--join-timeout is for --external: nobody else joins")


def _with_progress(options: RunOptions) -> RunOutcome:
    """Run with a live progress bar on standard error, if that is a terminal."""
    console = Screen(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[status]}"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as progress:
        task = progress.add_task(options.scenario.name, total=options.scenario.ticks, status="")
        return run_fleet(options, _Display(progress, task))


class _Display:
    """Updates the progress bar now and then, not at every tick."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress = progress
        self._task = task
        self._next_s = 0.0

    def __call__(self, outcome: RunOutcome) -> None:
        now_s = time.monotonic()
        if self._progress.disable or now_s < self._next_s:
            return
        self._next_s = now_s + REFRESH_S
        least = outcome.run_recorder.separation.least()
        computing = outcome.run_recorder.tally.computing_now(round(outcome.sim_s * 1e9))
        speed = outcome.sim_s / outcome.wall_s if outcome.wall_s > 0 else 0.0
        status = (
            f"{outcome.sim_s:6.1f}/{outcome.options.scenario.duration_s:g} s  {speed:5.1f}x  "
            f"least separation {separation_text(least)}  computing: "
            + (", ".join(f"UAV {c}" for c in computing) or "nobody")
        )
        self._progress.update(self._task, completed=outcome.ticks, status=status)


def scenarios() -> int:
    """List the packaged scenarios."""
    width = max(len(name) for name in packaged())
    for name in packaged():
        print(f"{name:<{width}}  {read_scenario(name).scenario.description}")
    return 0
