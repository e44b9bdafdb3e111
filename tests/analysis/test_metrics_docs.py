"""docs/metrics.md defines every field, with its unit and its source; its example runs."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from fleet.analysis import metrics
from fleet.analysis.metrics import NMAC
from fleet.faults.links import Harm, LinkRule
from fleet.faults.registry import kinds_of
from fleet.simulation.simulation import RunOptions, run_fleet
from tests.support.mutants import meeting

TEXT = (Path(__file__).parents[2] / "docs" / "metrics.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """What stands under a heading, up to the next one."""
    found = re.search(rf"^#+ {heading}\n(.*?)(?=^#|\Z)", TEXT, re.DOTALL | re.MULTILINE)
    assert found, heading
    return found[1]


def rows(text: str) -> dict[str, list[str]]:
    """The rows of a table, by the name in code type in their first cell."""
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert len({row[0] for row in cells}) == len(cells)
    return {row[0].strip("`"): row[1:] for row in cells}


@pytest.mark.parametrize("cls", metrics.ROWS, ids=lambda c: c.__name__)
def test_every_field_is_defined_with_unit_and_source(cls: type[Any]) -> None:
    told = rows(section(cls.__name__))
    assert list(told) == [f.name for f in fields(cls)]
    for name, (_, unit, definition, source) in told.items():
        assert definition
        assert source
        if name.endswith("_s"):
            assert unit == "s"
        if name.endswith("_m"):
            assert unit == "m"


def test_every_class_of_results_is_told() -> None:
    public = {name for name in metrics.__all__ if name.endswith(("Metrics", "Row"))}
    assert public <= {cls.__name__ for cls in metrics.ROWS}


def test_every_kind_of_link_fault_has_its_place_in_what_is_expected() -> None:
    told = set(rows(section("Expected")))
    links = kinds_of(LinkRule)
    assert told == {kind for kind, cls in links.items() if cls.harms & Harm.DROP}  # the others: 1


def test_the_numbers_told_are_those_of_the_code() -> None:
    assert (f"{NMAC.horizontal_m:g} m", f"{NMAC.vertical_m:g} m") == ("152.4 m", "30.48 m")


def test_links_within_the_document_lead_somewhere() -> None:
    headings = re.findall(r"^#+ (.*)$", TEXT, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
    assert set(re.findall(r"\]\(#([^)]+)\)", TEXT)) <= anchors


def test_the_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = RunOptions(meeting(), bus="memory", out=tmp_path / "four_way.mcap")
    run_fleet(options, lambda _: None)
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    found: dict[str, Any] = {}
    exec(code, found)
    assert len(found["rows"]) == 3
    run = found["run"]
    told = [run.pairs[0].least_separation, run.commands.latency_s.p99]
    assert [float(word) for word in capsys.readouterr().out.split()] == told
