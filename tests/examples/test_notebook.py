"""The example notebook, cell by cell as a kernel runs it; and what notebooks show of ours."""

from __future__ import annotations

import ast
import json
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

import fleet
from fleet.errors import ArgumentError

NOTEBOOK = Path(__file__).parents[2] / "examples" / "notebook.ipynb"


def executed(code: str, names: dict[str, Any]) -> Any:
    """Execute a cell; the value of its last line, if that is an expression."""
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


class Balanced(HTMLParser):
    """Raises AssertionError if elements are not closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, _attributes: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def test_the_notebook_runs_from_the_scenario_to_the_heat_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    names: dict[str, Any] = {}
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    codes = ["".join(c["source"]) for c in cells if c["cell_type"] == "code"]
    assert all(cell["outputs"] == [] for cell in cells if cell["cell_type"] == "code")
    run, separation, animation, results, heat_map = (executed(code, names) for code in codes)
    words = Balanced(run._repr_html_()).words
    assert "1, 2" in words
    assert run.digest in words
    assert len(separation.axes) == 3
    assert separation._repr_png_().startswith(b"\x89PNG")
    views = json.loads(animation.html.split("views } = ")[1].split(";\n")[0])["views"]
    truths = run["1/truth"]
    for view in views[:: len(views) // 5]:
        place = truths.position_ned_m[round(view["t_s"] * 10)]
        assert view["uavs"][0]["ned_m"] == pytest.approx(place, abs=0.01)
    assert "http" not in animation.html
    assert animation._repr_html_().startswith("<iframe srcdoc=")
    rows = Balanced(results._repr_html_()).words
    assert rows[:2] == ["latency", "loss"]
    assert rows.count("4") == 4
    assert [text.get_text()[:4] for text in heat_map.axes[0].texts[:1]] == ["0%\n0"]


def test_figures_and_speeds_that_are_none_are_refused() -> None:
    run = fleet.run(fleet.load_scenario("head_on", {"duration_s": 2.0}))
    with pytest.raises(ArgumentError, match="'map' is none of separation, commands"):
        run.plot("map")
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(ArgumentError, match="speed"):
            run.animate(wrong)


def test_what_a_scenario_is_called_is_no_code_in_a_notebook(tmp_path: Path) -> None:
    scenario = fleet.load_scenario(
        "head_on", {"duration_s": 2.0, "description": "<!--<script></script><b>"}
    )
    run = fleet.run(scenario, out=tmp_path / "x.mcap")
    assert "<b>" not in run._repr_html_()
    html = run.animate().html  # nor does a comment hide the end of the script
    assert "</script><b>" not in html
    assert "<!--" not in html
    assert "1/truth" in Balanced(fleet.Log(tmp_path / "x.mcap")._repr_html_()).words
