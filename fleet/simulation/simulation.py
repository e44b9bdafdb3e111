"""The simulation: embeds the router, starts the fleet, owns the clock, records, and sums up."""

from __future__ import annotations

import gc
import json
import os
import platform
import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path

import msgspec

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.errors import FleetStoppedError, LogWriteError
from fleet.faults.plan import plan_json
from fleet.faults.rules import Rule
from fleet.log.recorder import LogRecorder
from fleet.model.words import BusKind, ClockMode, OnLogError
from fleet.node.join_info import JoinInfo
from fleet.protocol.topics import EVERYTHING, SIMULATION, issuer_name
from fleet.security.links import router_settings
from fleet.security.loading import checked_identity
from fleet.simulation.active_runs import ActiveRun, advertised
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.interrupts import Interrupts
from fleet.simulation.lockstep import conduct_lockstep
from fleet.simulation.os_limits import check_room
from fleet.simulation.outages import outages_json
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.realtime import conduct_realtime
from fleet.simulation.run_context import ZenohRunContext
from fleet.simulation.run_log import DispensableLog, LogEnd, log_end
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.shortages import Shortages
from fleet.simulation.watchdog import Watchdog
from fleet.transport.zenoh_bus import Bus, open_client_bus, open_router_bus
from fleet.transport.zenoh_session import LEASE_S, check_zenoh_config
from fleet.version import __version__

LOOPBACK_ENDPOINT = "tcp/127.0.0.1:0"


@dataclass(frozen=True)
class RunOptions:
    """How to run a scenario.

    `stall_s` is how long a tick may take before the run is given up, `join_timeout_s` for how long
    nobody may join one whose processes others start (`external`), `secure` a folder with the
    certificates of all processes (without one the bus is open), `zenoh_config` a file of zenoh's
    own configuration for them all. `on_log_error` says whether the run goes on when its log cannot
    be written.
    """

    scenario: Scenario
    scenario_text: str = ""
    overrides: tuple[str, ...] = ()
    clock: str = ClockMode.LOCKSTEP
    bus: str = BusKind.ZENOH
    speed: float = 0.0
    out: Path | None = None
    force: bool = False
    connect: str = ""
    external: bool = False
    wait_s: float = 10.0
    stall_s: float = 60.0
    secure: str = ""
    lease_s: float = LEASE_S
    join_timeout_s: float = 60.0
    zenoh_config: str = ""
    on_log_error: str = OnLogError.STOP
    run: str = field(default_factory=lambda: secrets.token_hex(4))

    def logged_to(self, out: Path) -> RunOptions:
        """The same, with the log there."""
        return replace(self, out=out)


@dataclass
class RunOutcome:
    """What a run has come to so far; status is running, complete, interrupted or invalid.

    `log_end` is where and why the log ends before its run.
    """

    options: RunOptions
    run_recorder: RunRecorder
    status: str = "running"
    why: str = ""
    ticks: int = 0
    sim_s: float = 0.0
    wall_s: float = 0.0
    start_s: float = 0.0
    log_end: LogEnd | None = None
    pids: dict[str, int] = field(default_factory=dict)
    registry: ProcessRegistry | None = None
    watchdog: Watchdog | None = None
    shortages: Shortages = field(default_factory=Shortages)

    @property
    def log(self) -> Path | None:
        """The log, whole or not; None if there is none."""
        gone = self.log_end is not None and self.log_end.tick is None
        return None if gone else self.options.out

    @property
    def plan(self) -> tuple[Rule, ...]:
        """The fault plan with all changes so far; run from the start it repeats them."""
        return self.registry.plan if self.registry else self.options.scenario.fault


RunLog = LogRecorder | DispensableLog
ProgressCallback = Callable[[RunOutcome], None]


def run_fleet(options: RunOptions, progress: ProgressCallback) -> RunOutcome:
    """Run a scenario; `progress` is called after every tick.

    A run that was interrupted or became invalid returns too, and says so in `status` and `why`; so
    does one whose log could not be written to its end.

    Raises:
        LogError: the log cannot be created.
        BusError: the endpoint is malformed, taken or not answered.
        SecurityError: a certificate is missing or no good.
        NoRoomError: the operating system's limits are too low for the processes.

    """
    if options.bus == BusKind.ZENOH:
        check_room(len(participants(options.scenario)))
    gc.freeze()  # what is loaded by now lives as long as the run: not to be scanned in every tick
    begun_s = time.perf_counter()
    interrupts = Interrupts()
    interrupts.install()
    with ExitStack() as stack:
        stack.callback(interrupts.restore)
        stack.callback(gc.unfreeze)  # or what one run leaves would never be freed in the next
        # The bus first: a run that cannot begin must not touch an older log.
        bus, endpoint = _open_bus(options, stack)
        recorder, tick_ns = None, options.scenario.tick_ns
        if options.out is not None:
            recorder = LogRecorder(options.out, overwrite=options.force, uninterrupted=interrupts)
        log: RunLog | None = recorder
        if recorder is not None and options.on_log_error == OnLogError.CONTINUE:
            log = DispensableLog(recorder, tick_ns)
        outcome = RunOutcome(options, RunRecorder(options.scenario, log))
        try:
            with log or nullcontext():
                if log is not None:
                    log.metadata("run", run_metadata(options))
                _fly(outcome, progress, bus, endpoint, interrupts, begun_s)
                _close(outcome, log)
        except LogWriteError as error:
            assert recorder is not None
            outcome.status, outcome.why = "invalid", str(error)
            outcome.log_end = log_end(recorder, error, tick_ns)
        if isinstance(log, DispensableLog):
            outcome.log_end = log.end
        return outcome


def _fly(
    outcome: RunOutcome,
    progress: ProgressCallback,
    bus: Bus | None,
    endpoint: str,
    interrupts: Interrupts,
    begun_s: float,
) -> None:
    """Run to the end, whatever that is."""
    try:
        with ExitStack() as fleet:
            for now_ns in _ticks(outcome.options, outcome, fleet, bus, endpoint, interrupts):
                if outcome.ticks == 0:
                    outcome.start_s = time.perf_counter() - begun_s
                    begun_s = time.perf_counter()
                outcome.ticks += 1
                outcome.sim_s = now_ns / 1e9
                outcome.wall_s = time.perf_counter() - begun_s
                progress(outcome)
        outcome.status = "complete"
    except KeyboardInterrupt:
        outcome.status, outcome.why = "interrupted", interrupts.why
    except FleetStoppedError as stopped:
        outcome.status, outcome.why = "invalid", str(stopped)


def _close(outcome: RunOutcome, recorder: RunLog | None) -> None:
    """Work up what is left, and put the result into the log."""
    outcome.run_recorder.finish()
    outcome.run_recorder.tell_refused(round(1e9 * outcome.sim_s))
    if recorder is not None and outcome.watchdog and outcome.watchdog.stall:
        recorder.metadata("stall", outcome.watchdog.stall.record())
    if recorder is not None:
        recorder.metadata("result", result_metadata(outcome))


def _open_bus(options: RunOptions, stack: ExitStack) -> tuple[Bus | None, str]:
    """The simulation's bus, closed with the stack, and the endpoint where others find it."""
    if options.bus == BusKind.MEMORY:
        return None, ""
    started = [] if options.external else participants(options.scenario)
    names = (SIMULATION, *map(issuer_name, started))
    identity = checked_identity(options.secure, time.time(), *names)
    session_options = _join_info(options, options.connect).session_options(identity)
    if options.connect:
        endpoint, wait_s = options.connect, options.wait_s
        bus = open_client_bus(options.run, SIMULATION, endpoint, wait_s, session_options)
    else:
        check_zenoh_config(session_options)
        uavs = [uav.id for uav in uavs_of(options.scenario)]
        secured = router_settings(identity, uavs, options.run) if identity else None
        bus, endpoint = open_router_bus(
            options.run, SIMULATION, LOOPBACK_ENDPOINT, secured, options.zenoh_config
        )
    stack.callback(bus.close)
    return bus, endpoint


def _ticks(
    options: RunOptions,
    outcome: RunOutcome,
    fleet: ExitStack,
    bus: Bus | None,
    endpoint: str,
    interrupts: Interrupts,
) -> Iterator[int]:
    """The ticks of a run on the chosen bus and clock; the fleet ends with the stack."""
    if bus is None:
        yield from run_in_memory(options.scenario, outcome.run_recorder)
        return
    (bus.listen if options.clock == ClockMode.LOCKSTEP else bus.stamp)(EVERYTHING)
    join_info = _join_info(options, endpoint)
    external = options.external
    run = ZenohRunContext(
        bus,
        join_info,
        outcome.run_recorder,
        options.stall_s,
        uninterrupted=interrupts,
        external=external,
    )
    run.pace.speed = options.speed
    outcome.registry, outcome.watchdog = run.registry, run.watchdog
    outcome.shortages = run.shortages
    fleet.callback(run.watchdog.end)
    if not external:
        fleet.callback(run.stop)
    fleet.push(lambda _, why, __: run.dismiss(why) if why else None)
    if external:
        run.invite(options.join_timeout_s)
    else:
        run.start()
        outcome.pids = run.supervisor.pids()
    listing = ActiveRun(
        options.run, endpoint, options.scenario.name, options.secure, options.zenoh_config
    )
    fleet.enter_context(advertised(listing))
    lockstep = options.clock == ClockMode.LOCKSTEP
    for now_ns in conduct_lockstep(run, run.pace) if lockstep else conduct_realtime(bus, run):
        if now_ns >= options.scenario.ticks * options.scenario.tick_ns:
            run.ask_for_shortages()
        yield now_ns


def _join_info(options: RunOptions, endpoint: str) -> JoinInfo:
    """What participants must know; in lockstep a link is not lost before the run is given up."""
    lease_s = options.lease_s
    if options.clock == ClockMode.LOCKSTEP:
        lease_s = max(lease_s, options.stall_s)
    return JoinInfo(
        endpoint,
        options.run,
        options.clock,
        options.scenario,
        secure=options.secure,
        lease_s=lease_s,
        zenoh_config=options.zenoh_config,
    )


def run_metadata(options: RunOptions) -> dict[str, str]:
    """What identifies and repeats a run: the log's metadata record `run`."""
    scenario = options.scenario
    packages = ("eclipse-zenoh", "numpy", "msgspec", "mcap")
    return {
        "run": options.run,
        "scenario": scenario.name,
        "scenario_toml": options.scenario_text,
        "overrides": json.dumps(options.overrides),
        "effective_scenario": msgspec.json.encode(scenario).decode(),
        "seed": str(scenario.seed),
        "clock": options.clock,
        "bus": options.bus,
        "external": json.dumps(options.external),
        "tick_ns": str(scenario.tick_ns),
        "uavs": json.dumps([u.id for u in uavs_of(scenario)]),
        "fleet_version": __version__,
        "versions": json.dumps({p: version(p) for p in packages}),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "started_unix_ns": str(time.time_ns()),
    }


def result_metadata(outcome: RunOutcome) -> dict[str, str]:
    """How a run ended: the log's metadata record `result`."""
    run_recorder = outcome.run_recorder
    clocks = run_recorder.tally.clocks.account()
    return {
        "status": outcome.status,
        "why": outcome.why,
        "digest": run_recorder.digest,
        "ticks": str(outcome.ticks),
        "sim_s": f"{outcome.sim_s:.9g}",
        "wall_s": f"{outcome.wall_s:.6g}",
        "least_separation": str(run_recorder.separation.least()),
        "pairs_lost": str(run_recorder.separation.pairs_lost()),
        **{k: _text(v) for k, v in run_recorder.arrivals.arrivals().totals().items()},
        "elections": str(len(run_recorder.tally.terms)),
        "degraded": json.dumps(run_recorder.tally.accuracy()["degraded"] or clocks.degraded),
        "clocks": json.dumps(clocks.record() if clocks.offsets else {}),
        "outages": json.dumps(outages_json(run_recorder.outages)),
        "lacked_room": json.dumps(outcome.shortages.counts()),
        "fault_plan": plan_json(outcome.plan),
    }


def _text(value: object) -> str:
    """A value as it stands in metadata: text as it is, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)
