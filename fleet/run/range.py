"""The range: embeds the router, starts the fleet, owns the clock, records, and sums up."""

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

from fleet import __version__
from fleet.comms.keys import EVERYTHING
from fleet.comms.participant import Membership
from fleet.comms.zenoh_bus import Bus, open_client_bus, open_router_bus
from fleet.log.recorder import LogWriteError, Recorder
from fleet.model.faults.plan import FaultRule, plan_json
from fleet.model.generate import participants, uavs_of
from fleet.model.scenario import Scenario
from fleet.run.cast import Cast
from fleet.run.clocks import conduct_lockstep, conduct_realtime
from fleet.run.ear import FleetStoppedError
from fleet.run.guard import Guard
from fleet.run.interrupts import Interrupts
from fleet.run.ledger import Ledger
from fleet.run.memory import run_in_memory
from fleet.run.registry import listed
from fleet.run.room import check_room
from fleet.run.stage import ZenohStage

LOOPBACK = "tcp/127.0.0.1:0"


@dataclass(frozen=True)
class Options:
    """How to run a scenario. `stall_s` is how long a tick may take before the run is given up."""

    scenario: Scenario
    scenario_text: str = ""
    overrides: tuple[str, ...] = ()
    clock: str = "lockstep"
    bus: str = "zenoh"
    speed: float = 0.0
    out: Path | None = None
    force: bool = False
    connect: str = ""
    external: bool = False
    wait_s: float = 10.0
    stall_s: float = 60.0
    run: str = field(default_factory=lambda: secrets.token_hex(4))

    def logged_to(self, out: Path) -> Options:
        """The same, with the log there."""
        return replace(self, out=out)


@dataclass
class Outcome:
    """What a run has come to so far; status is running, complete, interrupted or invalid.

    `logged` is false once the log has failed: it is not whole, or not there.
    """

    options: Options
    ledger: Ledger
    status: str = "running"
    why: str = ""
    ticks: int = 0
    sim_s: float = 0.0
    wall_s: float = 0.0
    start_s: float = 0.0
    logged: bool = True
    pids: dict[str, int] = field(default_factory=dict)
    cast: Cast | None = None
    guard: Guard | None = None

    @property
    def plan(self) -> tuple[FaultRule, ...]:
        """The fault plan with all changes so far; run from the start it repeats them."""
        return self.cast.plan if self.cast else self.options.scenario.fault


Progress = Callable[[Outcome], None]


def run_fleet(options: Options, progress: Progress) -> Outcome:
    """Run a scenario; `progress` is called after every tick.

    A run that was interrupted or became invalid returns too, and says so in `status` and `why`; so
    does one whose log could not be written to its end.

    Raises:
        LogError: the log cannot be created.
        BusError: the endpoint is malformed, taken or not answered.
        NoRoomError: the operating system's limits are too low for the processes.

    """
    if options.bus == "zenoh":
        check_room(len(participants(options.scenario)))
    gc.freeze()  # what is loaded by now lives as long as the run: not to be scanned in every tick
    begun_s = time.perf_counter()
    interrupts = Interrupts()
    interrupts.install()
    with ExitStack() as stack:
        stack.callback(interrupts.restore)
        # The bus first: a run that cannot begin must not touch an older log.
        bus, endpoint = _open_bus(options, stack)
        recorder = None
        if options.out is not None:
            recorder = Recorder(options.out, overwrite=options.force, whole=interrupts)
        outcome = Outcome(options, Ledger(options.scenario, recorder))
        try:
            with recorder or nullcontext():
                if recorder is not None:
                    recorder.metadata("run", run_metadata(options))
                _fly(outcome, progress, bus, endpoint, interrupts, begun_s)
                _close(outcome, recorder)
        except LogWriteError as error:
            outcome.status, outcome.why, outcome.logged = "invalid", str(error), False
        return outcome


def _fly(
    outcome: Outcome,
    progress: Progress,
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


def _close(outcome: Outcome, recorder: Recorder | None) -> None:
    """Work up what is left, and put the result into the log."""
    outcome.ledger.finish()
    outcome.ledger.tell_refused(round(1e9 * outcome.sim_s))
    if recorder is not None and outcome.guard and outcome.guard.stall:
        recorder.metadata("stall", outcome.guard.stall.record())
    if recorder is not None:
        recorder.metadata("result", result_metadata(outcome))


def _open_bus(options: Options, stack: ExitStack) -> tuple[Bus | None, str]:
    """The range's bus, closed with the stack, and the endpoint where others find it."""
    if options.bus == "memory":
        return None, ""
    if options.connect:
        endpoint = options.connect
        bus = open_client_bus(options.run, "range", endpoint, options.wait_s)
    else:
        bus, endpoint = open_router_bus(options.run, "range", LOOPBACK)
    stack.callback(bus.close)
    return bus, endpoint


def _ticks(
    options: Options,
    outcome: Outcome,
    fleet: ExitStack,
    bus: Bus | None,
    endpoint: str,
    interrupts: Interrupts,
) -> Iterator[int]:
    """The ticks of a run on the chosen bus and clock; the fleet ends with the stack."""
    if bus is None:
        yield from run_in_memory(options.scenario, outcome.ledger)
        return
    (bus.listen if options.clock == "lockstep" else bus.stamp)(EVERYTHING)
    membership = Membership(endpoint, options.run, options.clock, options.scenario)
    external = options.external
    stage = ZenohStage(
        bus, membership, outcome.ledger, options.stall_s, whole=interrupts, external=external
    )
    outcome.cast, outcome.guard = stage.cast, stage.guard
    fleet.callback(stage.guard.end)
    if not external:
        fleet.callback(stage.stop)
    fleet.push(lambda kind, *_: bus.retire() if kind else None)  # cut short: everybody out at once
    if external:
        stage.invite()
    else:
        stage.start()
        outcome.pids = stage.crew.pids()
    fleet.enter_context(listed(options.run, endpoint, options.scenario.name))
    if options.clock == "lockstep":
        yield from conduct_lockstep(bus, stage, options.speed)
    else:
        yield from conduct_realtime(bus, stage)


def run_metadata(options: Options) -> dict[str, str]:
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
        "tick_ns": str(scenario.tick_ns),
        "uavs": json.dumps([u.id for u in uavs_of(scenario)]),
        "fleet_version": __version__,
        "versions": json.dumps({p: version(p) for p in packages}),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "started_unix_ns": str(time.time_ns()),
    }


def result_metadata(outcome: Outcome) -> dict[str, str]:
    """How a run ended: the log's metadata record `result`."""
    ledger = outcome.ledger
    return {
        "status": outcome.status,
        "why": outcome.why,
        "digest": ledger.digest,
        "ticks": str(outcome.ticks),
        "sim_s": f"{outcome.sim_s:.9g}",
        "wall_s": f"{outcome.wall_s:.6g}",
        "least_separation": str(ledger.separation.least()),
        "pairs_lost": str(ledger.separation.pairs_lost()),
        **{k: _text(v) for k, v in ledger.arrivals.arrivals().totals().items()},
        "elections": str(len(ledger.tally.terms)),
        "degraded": json.dumps(ledger.tally.accuracy()["degraded"]),
        "fault_plan": plan_json(outcome.plan),
    }


def _text(value: object) -> str:
    """A value as it stands in metadata: text as it is, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)
