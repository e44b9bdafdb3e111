"""The documents name everything that is in the code, and their examples run."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import inspect

import fleet
from fleet.agents.advisory import Advisory, Aircraft, Candidate, Situation
from fleet.agents.obedience import FINAL, REFUSAL_REASONS
from fleet.config import scenario as model
from fleet.config.loading import convert, packaged
from fleet.config.scenario import Scenario
from fleet.log.reader import summarise
from fleet.model.vehicle.models.point_mass import PointMassPerformance
from fleet.model.vehicle.registry import models
from fleet.model.words import ArrivalFate
from fleet.protocol.advisories import LoggedAdvisory, LoggedCandidate
from fleet.protocol.cells import names_in
from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.messages import Command, Decision, Message, Truth
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.simulation import (
    RunOptions,
    RunOutcome,
    result_metadata,
    run_fleet,
    run_metadata,
)
from tests.conftest import Cli, kept_run
from tools.picture.plots import picture
from tools.picture.run import pictured_run

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    p: p.read_text(encoding="utf-8") for p in sorted(ROOT.glob("*.md")) + sorted(DOCS.rglob("*.md"))
}
PROTOCOL = "\n".join(PAGES[p] for p in sorted((DOCS / "protocol").glob("*.md")))
RESOLVER = (DOCS / "extending" / "resolver.md").read_text(encoding="utf-8")
SCENARIOS = (DOCS / "scenarios.md").read_text(encoding="utf-8")
CLASSES: list[type[msgspec.Struct]] = [*LOGGED_CLASSES, LoggedAdvisory, LoggedCandidate]
SHARED = ["id", "seq", "t_ns"]
TABLES: list[tuple[str, type[msgspec.Struct]]] = [
    ("Top level", Scenario),
    ("`[zone]`", model.Zone),
    ("`[performance]`", PointMassPerformance),
    ("`[guidance]`", model.Guidance),
    ("`[surveillance]`", model.Surveillance),
    ("`[coordination]`", model.Coordination),
    ("`[commands]`", model.Commands),
    ("`[resolution]`", model.Resolution),
    ("`[origin]`", model.Origin),
    ("`[[uav]]`", model.Uav),
    ("converge", model.Converge),
    ("crossing", model.Crossing),
    *(
        (f'`vehicle = "{name}"`', cls)
        for name, cls in models().items()
        if cls is not PointMassPerformance and cls.__module__.startswith("fleet.")
    ),
]


def section(text: str, heading: str) -> str:
    """What stands under a heading, up to the next one."""
    found = re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#|\Z)", text, re.DOTALL | re.MULTILINE)
    assert found, f"no heading '{heading}'"
    return found[1]


def rows(text: str) -> dict[str, list[str]]:
    """Rows of the tables whose first cell is a name in code type: the other cells by name."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| `"):
            name = cells[0].strip("`")
            assert name not in found, f"{name} is there twice"
            found[name] = cells[1:]
    return found


def block(text: str, language: str, containing: str) -> str:
    """The code block that contains a text."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    (found,) = [b for b in blocks if containing in b]
    return str(found)


def shape(kind: inspect.Type) -> str:
    """The type of a field, as the documents write it."""
    match kind:
        case inspect.FloatType():
            return "float"
        case inspect.IntType():
            return "int"
        case inspect.BoolType():
            return "bool"
        case inspect.StrType() | inspect.LiteralType():
            return "text"
        case inspect.StructType():
            return kind.cls.__name__
        case inspect.TupleType():
            return f"{len(kind.item_types)} x {shape(kind.item_types[0])}"
        case inspect.VarTupleType():
            return f"list of {shape(kind.item_type)}"
        case inspect.UnionType():
            (given,) = (k for k in kind.types if not isinstance(k, inspect.NoneType))
            return shape(given)
        case inspect.DictType():
            return f"map of {shape(kind.key_type)} to {shape(kind.value_type)}"
    raise TypeError(kind)


def interval(kind: inspect.Type) -> str:
    """The range of a number (or of the numbers in an array), as the documents write it."""
    match kind:
        case inspect.TupleType():
            return interval(kind.item_types[0])
        case inspect.VarTupleType():
            return interval(kind.item_type)
        case inspect.FloatType() | inspect.IntType():
            low = f"[{_bound(kind.ge)}" if kind.ge is not None else f"({_bound(kind.gt)}"
            high = f"{_bound(kind.le)}]" if kind.le is not None else f"{_bound(kind.lt)})"
            return f"{low}, {high}"
        case inspect.UnionType():
            return interval(kind.types[0])
    return "-"


def _bound(value: float | None) -> str:
    return str(int(value)) if value is not None and value == int(value) else str(value)


def fields(cls: type[msgspec.Struct]) -> tuple[inspect.Field, ...]:
    info = inspect.type_info(cls)
    assert isinstance(info, inspect.StructType)
    return info.fields


# docs/protocol


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_every_message_class_has_a_table_with_all_its_fields(cls: type[msgspec.Struct]) -> None:
    own = [f for f in fields(cls) if not (issubclass(cls, Message) and f.name in SHARED)]
    told = rows(section(PROTOCOL, cls.__name__))
    assert list(told) == [f.name for f in own]
    assert {name: cells[0] for name, cells in told.items()} == {f.name: shape(f.type) for f in own}
    if cls.__struct_config__.omit_defaults:
        optional = [name for name, cells in told.items() if "; optional: " in cells[2]]
        assert optional == [f.name for f in own if not f.required]


def test_the_fields_that_all_messages_share_are_told_once() -> None:
    told = rows(section(PROTOCOL, "Encoding"))
    assert {name: cells[0] for name, cells in told.items()} == {
        f.name: shape(f.type) for f in fields(Message)
    }
    assert list(told) == SHARED


def test_every_fate_of_what_arrives_is_told() -> None:
    (told,) = [
        line for line in section(PROTOCOL, "DeliveryReport").splitlines() if "`fates`" in line
    ]
    assert re.findall("`(\\w+)`[:;]", told)[: len(ArrivalFate)] == [*ArrivalFate]


def test_issuers_and_hearers_of_topics_are_called_as_in_the_glossary() -> None:
    told = [line.strip("| ").split(" | ") for line in section(PROTOCOL, "Key space").splitlines()]
    names = " ".join(cell for row in told if len(row) == 5 for cell in row[2:4])
    assert "computing UAV" in names
    assert set(re.findall("[a-z]+", names)) & {"range", "station", "fleet", "process"} == set()


def test_every_class_has_a_topic() -> None:
    told = section(PROTOCOL, "Key space")
    for name in [cls.__name__ for cls in LOGGED_CLASSES]:
        assert f"[{name}](#{name.lower()})" in told


def test_every_refusal_reason_is_told_and_whether_it_is_final() -> None:
    told = rows(section(PROTOCOL, "Refusals"))
    assert told.keys() == REFUSAL_REASONS.keys()
    for reason, (meaning, repeat) in told.items():
        assert meaning.replace("`", "").startswith(REFUSAL_REASONS[reason])
        assert repeat.startswith("no" if reason in FINAL else "yes")


def test_every_metadata_field_is_told() -> None:
    options = RunOptions(three())
    outcome = RunOutcome(options, RunRecorder(options.scenario, None))
    assert rows(section(PROTOCOL, "Metadata `run`")).keys() == run_metadata(options).keys()
    assert rows(section(PROTOCOL, "Metadata `result`")).keys() == result_metadata(outcome).keys()


def anchors(text: str) -> set[str]:
    """What links can name on a page."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_within_the_documents_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
        if target.startswith(("http://", "https://")):
            continue
        path, _, anchor = target.partition("#")
        there = (page.parent / path).resolve() if path else page
        assert there.exists(), target
        if anchor:
            assert anchor in anchors(PAGES[there]), target


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of the worked example."""
    path = tmp_path_factory.mktemp("log") / "three.mcap"
    outcome = run_fleet(RunOptions(three(), bus="memory", out=path), lambda _: None)
    assert outcome.status == "complete"
    return path


def python(code: str, *arguments: str, folder: Path) -> str:
    """What a program prints."""
    script = folder / "example.py"
    script.write_text(code, encoding="utf-8")
    command = [sys.executable, str(script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    return done.stdout


def test_the_digest_can_be_recomputed_from_the_log_alone(log: Path, tmp_path: Path) -> None:
    code = block(PROTOCOL, "python", "as recorded")
    digest = summarise(log).metadata["result"]["digest"]
    assert len(digest) == 32
    assert python(code, str(log), folder=tmp_path) == f"{digest} as recorded\n"


@pytest.mark.parametrize("part", [0.999, 0.9, 0.4])
def test_a_log_without_its_end_can_be_read(log: Path, tmp_path: Path, part: float) -> None:
    code = block(PROTOCOL, "python", "NonSeekingReader")
    whole = python(code, str(log), folder=tmp_path).splitlines()
    assert len(whole) == summarise(log).messages.total()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: int(part * log.stat().st_size)])
    *left, last = python(code, str(cut), folder=tmp_path).splitlines()
    assert last == "the end is missing"
    assert whole[: len(left)] == left
    assert len(left) > 0


def test_the_uav_of_the_example_takes_part(cli: Cli, tmp_path: Path) -> None:
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    path = tmp_path / "intruder.mcap"
    shown = ["--connect", endpoint, "--external", "--set", "uav.2.equipment=deaf"]
    run = cli.start("run", "head_on", "--duration", "60", *shown, "--json", "--out", str(path))
    cli.start("uav", "1", "--connect", endpoint)
    cli.start("coordinator", "--connect", endpoint)
    python(block(PROTOCOL, "python", "msgpack.packb"), endpoint, "2", folder=tmp_path)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    told = json.loads(out)
    assert told["messages"]["truth"] == 2 * 601
    assert told["elections"] == 1
    # UAV 2 cannot be commanded: UAV 1, which computes, gives way itself.
    assert told["commands"]["issued"] == told["commands"]["applied"] > 0
    assert {t for t in summarise(path).messages if "/cmd/" in t} == {"1/cmd/1"}
    assert cli.run("check", str(path)).returncode == 0


def test_the_cells_shown_are_those_of_the_code() -> None:
    code = block((DOCS / "protocol" / "wire-format.md").read_text("utf-8"), "python", "cells_at")
    shown: dict[str, Any] = {}
    exec(code, shown)
    for range_m, tick_s, share in ((500.0, 0.1, 1.0), (5.0, 0.1, 1.3), (300.0, 4.0, 1.25)):
        slow, fast = (
            model.Uav(n, (0.0, 9000.0 * n, -300.0), 0.0, ((9e4, 0.0, -300.0),), 10.0 * n)
            for n in (1, 2)
        )
        own = msgspec.structs.replace(slow, performance=PointMassPerformance(max_speed_share=share))
        surveillance = model.Surveillance(range_m=range_m, broadcast_s=tick_s)
        scenario = Scenario(
            "cells", 90.0, tick_s=tick_s, surveillance=surveillance, uav=(own, fast)
        )
        cells = scenario.cells()
        assert cells is not None
        for place in ((0.0, 0.0, 0.0), (-1.0, 12_345.6, -300.0), (777.7, -50.0, -300.0)):
            told, within = shown["cells_at"](msgspec.to_builtins(scenario), *place[:2])
            assert told == cells.name(place)
            assert within == {*names_in(cells.block(place))}


# scenarios.md


def keys_told(heading: str) -> dict[str, list[str]]:
    """The table of a scenario's table."""
    if heading in ("converge", "crossing"):
        generate = section(SCENARIOS, "`[generate]`")
        return rows(generate.partition(f"| Key of `{heading}`")[2].partition("\n\n")[0])
    return rows(section(SCENARIOS, heading))


@pytest.mark.parametrize(("heading", "cls"), TABLES, ids=lambda x: str(x).strip("`[]"))
def test_every_key_is_told_with_type_default_and_range(
    heading: str, cls: type[msgspec.Struct]
) -> None:
    told = keys_told(heading)
    assert list(told) == [f.encode_name for f in fields(cls)]
    for field in fields(cls):
        kind, _, default, allowed, meaning = told[field.encode_name]
        assert meaning
        if kind in ("table", "list of tables"):
            absent = field.encode_name in ("fault", "uav", "generate") or field.default is None
            assert default == ("none" if absent else "see below")
            continue
        assert kind == shape(field.type)
        assert allowed == interval(field.type), field.name
        if field.default is msgspec.NODEFAULT:
            assert default == "required", field.name
        elif field.default is None:
            assert default == "none", field.name
        else:
            value = tomllib.loads(f"value = {default.strip('`')}")["value"]
            assert (tuple(value) if isinstance(value, list) else value) == field.default


def test_what_a_resolver_chooses_from_are_candidates() -> None:
    told = re.sub("`[^`]*`", "", section(SCENARIOS, "`[resolution]`"))
    assert "candidate" in told
    assert "option" not in told


def test_tables_without_keys_can_be_left_out_but_uavs_cannot() -> None:
    optional = {f.name for f in fields(Scenario) if f.default_factory is not msgspec.NODEFAULT}
    told = keys_told("Top level")
    assert optional == {name for name, cells in told.items() if cells[2] == "see below"}


@pytest.mark.parametrize(
    "cls", [Situation, Aircraft, Advisory, Candidate], ids=lambda c: c.__name__
)
def test_what_a_resolver_gets_and_gives_is_told(cls: Any) -> None:
    table = rows(RESOLVER.split(f"\n`{cls.__name__}`: ")[1].split("\n\n")[1])
    assert list(table) == [f.name for f in dataclasses.fields(cls)]
    if cls in (Advisory, Candidate):
        for field in dataclasses.fields(cls):
            default = table[field.name][1]
            if field.default is dataclasses.MISSING:
                assert default == "required"
            else:
                told = json.loads(default.strip("`"))
                given = [] if field.default == () else field.default
                assert repr(told) == repr(given), field.name


def test_the_commands_shown_name_packaged_scenarios_or_the_example() -> None:
    for name in re.findall(r"^fleet run ([\w.]+)", SCENARIOS, re.MULTILINE):
        assert name in {*packaged(), "three.toml"}


def three(**changes: Any) -> Scenario:
    """The worked example."""
    table = tomllib.loads(block(SCENARIOS, "toml", 'name = "three"'))
    return convert({**table, **changes}, "docs/scenarios.md")


@pytest.mark.parametrize(("resolver", "lost"), [("geometric", False), ("none", True)])
def test_the_worked_example_does_what_is_said(resolver: str, lost: bool) -> None:
    assert kept_run(three(resolver=resolver)).separation.lost() is lost


def test_the_example_of_a_resolver_keeps_separation_by_climbs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = block(RESOLVER, "python", "class SmallestClimb")
    (tmp_path / "smallest_climb.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    run_recorder = kept_run(three(resolver="smallest_climb:SmallestClimb"))
    assert run_recorder.separation.lost() is False
    commands = [m for m in run_recorder.kept if isinstance(m, Command)]
    assert {c.manoeuvre for c in commands} == {"climb", "resume"}
    assert {m.mode for m in run_recorder.kept if isinstance(m, Truth) and m.id == 1} == {"plan"}
    lines = [e for m in run_recorder.kept if isinstance(m, Decision) for e in m.encounters]
    told = [e for e in lines if e.manoeuvre == "climb"]
    assert {e.target for e in told} == {2, 3}
    for e in told:
        assert len(e.candidates) == 4
        (chosen,) = [c for c in e.candidates if c.chosen]
        assert (chosen.safe, chosen.climb_mps) == (True, e.climb_mps)


# The picture


def test_the_picture_can_be_drawn_from_a_log(log: Path, tmp_path: Path) -> None:
    drawn = tmp_path / "three.svg"
    command = [sys.executable, "-m", "tools.picture", str(log), str(drawn)]
    subprocess.run(command, check=True, timeout=60, cwd=ROOT)
    svg = drawn.read_text(encoding="utf-8")
    assert [f"UAV {n}<" in svg for n in (1, 2, 3)] == [True] * 3
    assert "nan" not in svg


def test_the_picture_goes_by_the_zone_of_each_uav(tmp_path: Path) -> None:
    own = {"uav.1.zone.radius_m": 600.0, "duration_s": 20.0}
    run = fleet.run(fleet.load_scenario("head_on", own), out=tmp_path / "own.mcap")
    assert run.path is not None
    drawn = pictured_run(run.path)
    assert [flight.zone_m for flight in drawn.flights] == [600.0, 200.0]
    (pair,) = drawn.pairs
    # both fly level: what is required of the pair is the sum of their radii
    assert pair.normalised == pytest.approx(pair.horizontal_m / 800.0)
    assert drawn.near.least[-1] == pytest.approx(pair.normalised[-1])
    radii = {float(r) for r in re.findall(r'r="([\d.]+)" fill="#\w+" fill-opacity', picture(drawn))}
    assert max(radii) == pytest.approx(3.0 * sorted(radii)[-2], rel=0.01)


def test_the_picture_of_the_readme_is_as_it_is_flown_now(tmp_path: Path) -> None:
    run = fleet.run("four_way", out=tmp_path / "four_way.mcap")
    assert run.path is not None
    shown = (DOCS / "four_way.svg").read_text(encoding="utf-8")
    flown, number = picture(pictured_run(run.path)), re.compile(r"\d+\.\d+")
    assert number.split(shown) == number.split(flown), "draw it anew: python -m tools.picture"
    pairs = zip(number.findall(shown), number.findall(flown), strict=True)
    # another C library may round another way
    assert max(abs(float(a) - float(b)) for a, b in pairs) < 0.3
