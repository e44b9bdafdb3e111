"""Rogues that are processes: participants that break the rules, replays, data that name code.

The second table of `python -m tests.rogue`. Each entry tries it for real on one of the clocks and
tells what became of it; a rogue that nobody noticed is an AssertionError.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from fleet.analysis.recorded_run import RecordedRun
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.node.join_info import plan_bytes
from fleet.protocol.messages import DeliveryReport
from fleet.protocol.topics import PLAN, key
from fleet.transport.zenoh_session import open_client
from tests.conftest import Cli
from tests.rogue import listed_run, until
from tests.support.rewriting import naming_code

AS_UAV = "; from fleet.cli import main; main()"
ALL_HEARD = (
    "import fleet.node.participant as p; from fleet.faults.channel import Channel;"
    "p.channel_of = lambda s: Channel((), s.seed, s.tick_ns)"
)
"""A UAV on which no fault of the links acts."""
NOWHERE = "from fleet.node.runner import NodeRunner; NodeRunner.place = property(lambda _: None)"
"""A UAV that does not say where its radio is."""
EVIL = """
from pathlib import Path
Path(__file__).with_name("imported").touch()
from fleet.agents.resolvers import NoResolver
class Boom(NoResolver):
    pass
"""


class Joined:
    """A run of `head_on` whose UAV 1 is a rogue, and how it and its check ended."""

    def __init__(self, cli: Cli, clock: str, rogue: str, *options: str) -> None:
        endpoint = router(cli)
        words = ("run", "head_on", "--duration", "4", "--clock", clock, *options, "--json")
        runtime = {"XDG_RUNTIME_DIR": str(cli.folder)}
        where = ("--connect", endpoint)
        run = cli.start(*words, *where, "--external", "--force", "--out", "run.mcap", **runtime)
        name, _ = until(lambda: listed_run(cli.folder), run)
        joins = (*where, "--run", name)
        cli.start("coordinator", *joins)
        cli.start("uav", "2", *joins)
        cli.command(sys.executable, "-c", rogue + AS_UAV, "uav", "1", *joins)
        out, self.error = run.communicate(timeout=100)
        self.code = run.returncode
        self.result: dict[str, Any] = json.loads(out)
        self.recorded = RecordedRun.of_log(cli.folder / "run.mcap")
        checked = cli.run("check", "run.mcap", "--json")
        self.verdict = json.loads(checked.stdout)

    @property
    def violated(self) -> list[str]:
        """The invariants that are violated."""
        return [
            f["name"] for f in self.verdict["logs"][0]["invariants"] if f["verdict"] == "invalid"
        ]

    def heard_of(self, uav: int) -> int:
        """How many messages of a UAV were delivered to anybody."""
        reports = [m for m in self.recorded.messages() if isinstance(m, DeliveryReport)]
        rows = [row for r in reports for row in zip(r.src, r.delivered_ns, strict=True)]
        return sum(src == uav and delivered_ns > 0 for src, delivered_ns in rows)


def router(cli: Cli) -> str:
    """Start a router; where it listens."""
    process = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert process.stderr is not None
    return process.stderr.readline().split()[-1]


def honest(cli: Cli, clock: str) -> str:
    """The same without a rogue, or the rest would show nothing."""
    joined = Joined(cli, clock, "pass", "--loss", "50%", "--seed", "1")
    assert (joined.code, joined.violated) == (0, []), joined.error
    return "complete, nothing is violated"


def ignores_the_plan(cli: Cli, clock: str) -> str:
    """It hears what the plan takes from it."""
    joined = Joined(cli, clock, ALL_HEARD, "--loss", "50%", "--seed", "1")
    assert joined.violated == ["fault plan applied"], joined.error
    return "check invalid: fault plan applied"


def hears_too_early(cli: Cli, clock: str) -> str:
    """It hears what the plan brings later."""
    joined = Joined(cli, clock, ALL_HEARD, "--latency", "500ms")
    assert joined.violated == ["fault plan applied"], joined.error
    return "check invalid: fault plan applied"


def says_no_place(cli: Cli, clock: str) -> str:
    """What it sends would pass a fault of range unhindered."""
    joined = Joined(cli, clock, NOWHERE, "--range", "50km")
    assert joined.code == 0, joined.error
    assert joined.heard_of(1) == 0 < joined.heard_of(2)
    if clock == "realtime":
        return "heard by nobody: lost by `range`"
    assert joined.violated == ["fault plan applied"], joined.error
    return "heard by nobody; check invalid: fault plan applied"


def replays_into_a_run(cli: Cli, clock: str) -> str:
    """A log under the name of a run that is on: it stays out, and forced in it is found."""
    made = cli.run("run", "head_on", "--duration", "2", "--bus", "memory", "--out", "old.mcap")
    assert made.returncode == 0, made.stderr
    paced = ("--speed", "1") if clock == "lockstep" else ()
    words = ("run", "head_on", "--duration", "6", "--clock", clock, *paced, "--json", "--force")
    run = cli.start(*words, "--out", "run.mcap", XDG_RUNTIME_DIR=str(cli.folder))
    name, endpoint = until(lambda: listed_run(cli.folder), run)
    replay = ("replay", "old.mcap", "--run", name, "--connect", endpoint, "-r", "1000")
    refused = cli.run(*replay)
    assert refused.returncode == 2
    assert f"run {name} is on at {endpoint}" in refused.stderr
    cli.run(*replay, "--force-live")
    out, error = run.communicate(timeout=60)
    result = json.loads(out)
    assert (run.returncode, result["status"]) == (1, "invalid"), error
    return f"refused; forced: run invalid, {result['rejected'][0]['topic']}"


def log_names_code(cli: Cli, _clock: str) -> str:
    """`fleet repeat` of a log whose metadata name a module in the current folder."""
    (cli.folder / "evil.py").write_text(EVIL)
    naming_code(cli.folder, evil())
    refused = cli.run("repeat", "evil.mcap")
    return _not_imported(cli, refused)


def simulation_names_code(cli: Cli, clock: str) -> str:
    """A client that answers for the plan with a module in the current folder."""
    (cli.folder / "evil.py").write_text(EVIL)
    endpoint = router(cli)
    session = open_client(endpoint, 10.0)
    try:
        plan, own = plan_bytes(clock, evil()), key("rogue", PLAN)
        answer = session.declare_queryable(own, lambda query: query.reply(own, plan))
        refused = cli.run("uav", "1", "--connect", endpoint, "--run", "rogue")
        answer.undeclare()
    finally:
        session.close()
    return _not_imported(cli, refused)


def evil() -> Scenario:
    """A scenario that names code in the current folder."""
    scenario = read_scenario("head_on", ["duration_s=1"]).scenario
    return msgspec.structs.replace(scenario, resolver="evil:Boom")


def _not_imported(cli: Cli, refused: subprocess.CompletedProcess[str]) -> str:
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1), refused.stderr
    assert "evil" in refused.stderr
    assert "--trust" in refused.stderr
    assert not (cli.folder / "imported").exists()
    return "refused: not imported without --trust"


Rogue = Callable[[Cli, str], str]
ROGUES: dict[str, Rogue] = {
    "(nobody is a rogue)": honest,
    "a UAV that hears what the fault plan takes from it": ignores_the_plan,
    "a UAV that hears at once what the fault plan delays": hears_too_early,
    "a UAV that does not say where its radio is, under a fault of range": says_no_place,
    "a replay under the name of a run that is on": replays_into_a_run,
    "a log that names code, repeated": log_names_code,
    "a simulation that names code, joined": simulation_names_code,
}


def tried(rogue: Rogue, clock: str, folder: Path) -> str:
    """What became of it; begins with SILENT if nobody noticed."""
    cli = Cli(folder)
    try:
        return rogue(cli, clock)
    except AssertionError as error:
        return f"SILENT: {error}"
    finally:
        cli.end()
