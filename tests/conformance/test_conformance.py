"""`fleet conformance`: the example keeps all rules, and each broken UAV is named by its rule."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from fleet.agents.obedience import REFUSAL_REASONS
from fleet.conformance import script
from fleet.conformance.evidence import Evidence
from fleet.conformance.rule import Outcome, ProtocolRule, RuleFinding
from fleet.conformance.rules import RULES
from fleet.conformance.scene import FOREIGN, LOCKSTEP_S, played_scenario
from fleet.conformance.session import exit_code, found, played
from fleet.faults.links import LinkRule
from fleet.faults.registry import kinds
from fleet.model.words import ClockMode
from fleet.protocol import codec
from fleet.protocol.messages import Done
from fleet.protocol.sample import Sample
from tests.conformance.broken_uavs import LOCKSTEP, MUTATIONS, REALTIME, SEVERAL, STALLING, Mutation
from tests.conftest import Cli

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "foreign"
ALONE = [n for n, m in MUTATIONS.items() if m.clock is LOCKSTEP and n not in SEVERAL]
PROTOCOL = ROOT / "docs" / "protocol"


def tried(program: Path, clock: ClockMode, patience_s: float = 5.0) -> list[RuleFinding]:
    """What a UAV, which is gone afterwards, makes of a clock."""
    processes: list[subprocess.Popen[bytes]] = []

    def start(endpoint: str) -> None:
        command = [sys.executable, str(program), endpoint, "2"]
        quiet = subprocess.DEVNULL
        processes.append(subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet))

    socket = program.parent / f"{clock}.sock"
    endpoint = f"unixsock-stream/{socket}"
    try:
        return found(played(endpoint, clock, wait_s=20.0, patience_s=patience_s, listening=start))
    finally:
        for process in processes:
            process.kill()
            process.wait()


def mutant(folder: Path, *mutations: Mutation) -> Path:
    """The example with some mutations."""
    for path in EXAMPLE.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        for mutation in mutations:
            if path.stem == mutation.file:
                assert text.count(mutation.old) == 1, mutation.old
                text = text.replace(mutation.old, mutation.new)
        (folder / path.name).write_text(text, encoding="utf-8")
    return folder / "direct.py"


def broken(findings: list[RuleFinding]) -> dict[str, str]:
    return {f.name: f.seen for f in findings if f.outcome is Outcome.BROKEN}


@pytest.mark.parametrize("name", ALONE)
def test_a_broken_uav_is_named_in_lockstep(name: str, tmp_path: Path) -> None:
    mutation = MUTATIONS[name]
    findings = tried(
        mutant(tmp_path, mutation), LOCKSTEP, patience_s=0.5 if name in STALLING else 20.0
    )
    assert {mutation.breaks, *mutation.also} <= broken(findings).keys()
    assert exit_code(findings) == 1


def test_each_rule_is_named_that_a_uav_breaks(tmp_path: Path) -> None:
    findings = tried(mutant(tmp_path, *(MUTATIONS[name] for name in SEVERAL)), LOCKSTEP)
    assert {MUTATIONS[name].breaks for name in SEVERAL} <= broken(findings).keys()


def test_broken_uavs_are_named_in_realtime(tmp_path: Path) -> None:
    """All at once: they wait for the wall clock most of the time."""
    names = [n for n, m in MUTATIONS.items() if m.clock is REALTIME]
    programs = []
    for number, name in enumerate(names):
        (tmp_path / str(number)).mkdir()
        programs.append(mutant(tmp_path / str(number), MUTATIONS[name]))
    with ThreadPoolExecutor() as pool:
        each = [*pool.map(lambda program: tried(program, REALTIME), programs)]
    for name, findings in zip(names, each, strict=True):
        assert MUTATIONS[name].breaks in broken(findings), name


def test_the_example_keeps_every_rule_on_both_clocks(cli: Cli) -> None:
    start = f"{sys.executable} {EXAMPLE / 'direct.py'} {{endpoint}} {{number}}"
    done = cli.run("conformance", "tcp/127.0.0.1:0", "--start", start, "--json")
    told = json.loads(done.stdout)
    assert [r for r in told["rules"] if r["outcome"] != "kept"] == []
    assert done.returncode == told["exit_code"] == 0
    assert {(r["name"], r["clock"]) for r in told["rules"]} == {
        (rule.name, clock) for rule in RULES for clock in rule.clocks
    }


def test_a_uav_of_our_own_keeps_every_rule(tmp_path: Path) -> None:
    program = tmp_path / "own.py"
    program.write_text(
        "import sys\nfrom fleet.cli import main\n"
        "sys.argv = ['fleet', 'uav', sys.argv[2], '--connect', sys.argv[1]]\nmain()\n"
    )
    findings = tried(program, LOCKSTEP)
    assert broken(findings) == {}
    assert exit_code(findings) == 0


def test_who_does_not_join_is_told_in_a_line(cli: Cli) -> None:
    done = cli.run("conformance", "tcp/127.0.0.1:0", "--wait", "0.2", "--clock", "lockstep")
    assert done.returncode == 2
    assert "no UAV 2 joined for the lockstep clock within 0.2 s" in done.stderr
    odd = cli.run("conformance", "tcp/127.0.0.1:0", "--start", "/no/such/program")
    assert odd.returncode == 2
    assert "--start '/no/such/program' cannot be started" in odd.stderr
    assert "Traceback" not in done.stderr + odd.stderr
    unknown = cli.run("conformance", "tcp/127.0.0.1:0", "--start", "python {foo}")
    assert unknown.returncode == 2
    assert "only {endpoint} and {number} are filled in" in unknown.stderr


def test_who_ends_before_it_has_joined_is_not_waited_for(cli: Cli) -> None:
    """It would take ten minutes; `cli` gives up after less."""
    done = cli.run("conformance", "tcp/127.0.0.1:0", "--wait", "600", "--start", "false")
    assert done.returncode == 2
    assert "ended with exit code 1 before it had joined for the lockstep clock" in done.stderr


def test_what_was_not_tried_is_not_called_kept() -> None:
    evidence = Evidence(played_scenario(LOCKSTEP_S), FOREIGN, LOCKSTEP)
    assert {f.outcome for f in found(evidence)} == {Outcome.NOT_TRIED}
    ready = codec.encode(Done(FOREIGN, 0, 0, -1, {}, {}))
    evidence.hear(-1, Sample("2/done", ready))
    evidence.stalled = "it was not done with tick 0"
    outcomes = {f.name: f.outcome for f in found(evidence)}
    assert outcomes["takes part to the end"] is Outcome.BROKEN
    assert outcomes["is ready before anything else, and has sent nothing"] is Outcome.KEPT
    for words in ("refuses", "applies", "flies", "obeys", "answers", "reports", "mandate"):
        for name in [n for n in outcomes if words in n]:
            assert outcomes[name] is Outcome.NOT_TRIED, name


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_every_rule_leads_to_its_page(rule: ProtocolRule) -> None:
    page, _, anchor = rule.page.partition("#")
    text = (PROTOCOL / page).read_text(encoding="utf-8")
    headings = [line.lstrip("# ") for line in text.splitlines() if line.startswith("#")]
    assert anchor in {heading.lower().replace(" ", "-").replace(",", "") for heading in headings}


def test_the_documents_tell_how_many_broken_uavs_are_named() -> None:
    assert f"each of {len(MUTATIONS)} UAVs" in (PROTOCOL / "foreign.md").read_text(encoding="utf-8")


def test_every_kind_about_links_and_every_refusal_is_played() -> None:
    ours = [kind for kind in kinds().values() if kind.__module__.startswith("fleet.")]
    links = {kind.__struct_config__.tag for kind in ours if issubclass(kind, LinkRule)}
    assert {kind for kind, _ in script.PLAN_KEYS} == links
    refused = {cue.reason for cue in script.LOCKSTEP_COMMANDS}
    assert refused == {"", *REFUSAL_REASONS} - {"wrong_target"}
