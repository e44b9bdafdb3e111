"""The UAV of examples/foreign, written from docs/protocol alone, takes part like one of our own."""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

import fleet
from fleet.analysis.recorded_run import RecordedRun
from fleet.protocol.messages import Ack, DeliveryReport, Message, Truth
from tests.conftest import Cli
from tests.relay.programs import FOREIGN, example
from tools import fault_vectors

FAULTS = {
    "latency": "300ms",
    "jitter": "200ms",
    "loss": "25%",
    "burst": "3",
    "duplicate": "10%",
    "reorder": "10%",
    "replay": "5%",
    "corrupt": "2%",
    "rate": "200kbit",
    "range": "5km",
    "partition": "1/2@20s+3s",
}


def flown(cli: Cli, path: Path, *options: str) -> RecordedRun:
    """`head_on` with the foreign UAV as UAV 2."""
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    out = ("--connect", endpoint, "--external", "--json", "--out", str(path))
    run = cli.start("run", "head_on", "--set", "uav.2.equipment=no_compute", *out, *options)
    cli.start("uav", "1", "--connect", endpoint)
    cli.start("coordinator", "--connect", endpoint)
    uav = cli.command(sys.executable, str(FOREIGN / "direct.py"), endpoint, "2")
    _, error = uav.communicate(timeout=60)
    assert uav.returncode == 0, error
    _, error = run.communicate(timeout=60)
    assert run.returncode == 0, error
    return fleet.open_log(path)


def of(run: RecordedRun, cls: type[Message]) -> list[Any]:
    """What UAV 2 sent of a class."""
    return [m for m in run.messages() if isinstance(m, cls) and m.id == 2]


def fates(run: RecordedRun) -> dict[tuple[str, int, int, int], list[tuple[str, int]]]:
    """Of each message on the way to UAV 2, what became of it, and when."""
    out: dict[tuple[str, int, int, int], list[tuple[str, int]]] = {}
    for report in of(run, DeliveryReport):
        named = zip(report.kinds, report.src, report.seqs, report.sent_ns, strict=True)
        found = zip(report.fates, report.delivered_ns, strict=True)
        for name, fate in zip(named, found, strict=True):
            out.setdefault(name, []).append(fate)
    return out


def test_the_vectors_are_those_of_the_code() -> None:
    told = fault_vectors.PATH.read_text(encoding="utf-8")
    assert told == fault_vectors.text(), "stale: python -m tools.fault_vectors"


def test_the_vectors_have_every_kind_about_links_and_every_fate() -> None:
    kinds = {json.loads(plan)[0]["kind"] for plan in fault_vectors.PLANS.values()}
    assert kinds == {*example("link_faults").Links([], 0, 1).able()}
    for name, vector in fault_vectors.vectors()["fates"].items():
        assert len(set(map(str, vector["of"]))) > 1, name


def test_the_example_draws_as_the_vectors_say() -> None:
    vectors, faults = json.loads(fault_vectors.text()), example("link_faults")
    for draw in vectors["draws"]:
        named = draw["seed"], draw["place"], draw["purpose"]
        assert faults.uniform(*named, *draw["labels"]) == draw["uniform"]
    for name, vector in vectors["fates"].items():
        links = faults.Links(vector["plan"], vectors["seed"], vectors["tick_ns"])
        judged = [links.fate(faults.OnLink(**message)) for message in vectors["messages"]]
        assert judged == vector["of"], name


def test_the_example_needs_nothing_but_zenoh_and_msgpack() -> None:
    own = {path.stem for path in FOREIGN.glob("*.py")}
    for path in FOREIGN.glob("*.py"):
        tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        names = [a.name for n in tree if isinstance(n, ast.Import) for a in n.names]
        tree = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        names += [n.module or "" for n in tree if isinstance(n, ast.ImportFrom)]
        roots = {name.split(".")[0] for name in names} - sys.stdlib_module_names
        assert roots <= own | {"zenoh", "msgpack"}
    for name in ("uav.py", "uav.js"):
        assert len((FOREIGN / name).read_text(encoding="utf-8").splitlines()) <= 250
    needed = re.findall(r"require\((.*?)\)", (FOREIGN / "uav.js").read_text(encoding="utf-8"))
    assert all(name.startswith('"node:') for name in needed)


def test_it_fares_in_lockstep_under_faults_as_one_of_our_own(cli: Cli, tmp_path: Path) -> None:
    options = [word for name, value in FAULTS.items() for word in (f"--{name}", value)]
    run = flown(cli, tmp_path / "foreign.mcap", "--duration", "45", "--seed", "3", *options)
    checked = fleet.check(run)
    assert checked.overall == "valid"
    settings = {"uav.2.equipment": "no_compute", "duration_s": 45, "seed": 3}
    ours = fleet.run(fleet.load_scenario("head_on", settings, FAULTS))
    assert run.scenario == ours.scenario
    mine, theirs = fates(ours), fates(run)
    common = mine.keys() & theirs.keys()
    assert len(common) > 0.9 * len(mine)
    seen = {fate for name in common for fate, _ in theirs[name]}
    assert seen == {"received", "burst", "corrupt", "partition"}
    assert {n for n in common if mine[n] != theirs[n]} == set()
    manoeuvre = next(n for n, truth in enumerate(of(ours, Truth)) if truth.mode == "turn")
    assert manoeuvre > 300
    for one, other in zip(of(ours, Truth)[:manoeuvre], of(run, Truth)[:manoeuvre], strict=True):
        assert one.position_ned_m == pytest.approx(other.position_ned_m, abs=1e-9)
        assert one.command_number == other.command_number == 0
    answers = [[(a.accepted, a.reason) for a in of(each, Ack)] for each in (ours, run)]
    assert answers[0] == answers[1] != []


def test_it_flies_by_the_wall_clock_under_faults(cli: Cli, tmp_path: Path) -> None:
    options = "--clock", "realtime", "--duration", "2", "--latency", "150ms", "--loss", "30%"
    run = flown(cli, tmp_path / "foreign.mcap", *options)
    checked = fleet.check(run)
    assert checked.broken == ()
    assert checked.of("fault plan applied").verdict == "valid"
    assert len(of(run, Truth)) == 21


@pytest.mark.parametrize("fault", [{"clock-offset": "2:1s"}, {"gps-noise": "2:10m"}])
def test_it_says_which_faults_it_cannot_apply(fault: dict[str, str]) -> None:
    plan = msgspec.to_builtins(fleet.load_scenario("head_on", None, fault).fault)
    (kind,) = example("link_faults").Links(plan, 0, 1).unable()
    assert kind == plan[0]["kind"]
