"""`fleet study report`: figures for a paper, files, and what it refuses."""

from __future__ import annotations

import re
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("plotly")
pytest.importorskip("matplotlib")

from matplotlib import rc_context
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from fleet.cli import application
from fleet.cli.report_files import ReportFormat
from fleet.cli.study_report import page_beside, study_report
from fleet.errors import LogError, MissingExtraError, StudyError
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder, open_results
from fleet.study_report.colours import LINE_COLOURS, RAMP
from fleet.study_report.outcomes import outcomes_of
from fleet.study_report.paper import PAPER_STYLE, study_figures, write_study_figures
from fleet.study_report.study_data import StudyData, study_data_of
from tests.conftest import Cli
from tests.support.study_samples import ELECTORS, LATENCY, LOSS, results_in, study_table

PNG = b"\x89PNG\r\n\x1a\n"
LOST = (0, 4, 10, 40)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Results of four cells."""
    factor = [{**LATENCY, "values": [1, 0]}, {**LOSS, "values": [0, 30]}]
    path = tmp_path / "made_up.study"
    results_in(path, study_table(factor=factor), lambda cell: LOST[cell.number])
    return path


@pytest.fixture
def data(folder: Path) -> StudyData:
    return study_data_of(open_results(folder), "made_up.study")


def drawn(data: StudyData, name: str) -> Figure:
    """A figure as it is written."""
    with rc_context(PAPER_STYLE):
        return study_figures(data)[name]()


def test_there_is_a_figure_for_each_outcome(data: StudyData) -> None:
    names = {outcome.id for outcome in outcomes_of(data)}
    assert names >= {"lost", "nmac", "induced", "unresolved", "least_separation", "delay"}
    expected = {f"made_up_{kind}_{name}" for kind in ("map", "curve") for name in names}
    assert set(study_figures(data)) == expected | {
        "made_up_survival_loss-0",
        "made_up_survival_loss-30",
    }


@pytest.mark.parametrize(
    ("labels", "names"),
    [(["a, b", "50%"], ["a-b", "50"]), (["+5", "-5"], ["0", "1"]), (["%", "x"], ["0", "1"])],
)
def test_levels_in_names_of_files_stay_apart(
    tmp_path: Path, labels: list[str], names: list[str]
) -> None:
    level = [{"label": label} for label in labels]
    network = {"name": "network", "level": level}
    factor = [{**LATENCY, "values": [0, 1]}, {**LOSS, "values": [0, 1]}, network]
    data = study_data_of(results_in(tmp_path, study_table(2, factor=factor), lambda _: 1), "x")
    maps = [name for name in study_figures(data) if "_map_lost" in name]
    assert maps == [f"made_up_map_lost_network-{name}" for name in names]


def test_a_map_has_the_values_intervals_and_colours_of_its_cells(data: StudyData) -> None:
    figure = drawn(data, "made_up_map_lost")
    axes: Any = figure.axes[0]
    texts = {text.get_position(): text.get_text() for text in axes.texts}
    assert texts[0.5, 0.5] == "0 %"  # latency 1, the first level; loss 0
    assert texts[0.5, 1.5] == "10.0 %"
    assert texts[1.5, 0.5] == "25.0 %"
    assert texts[0.5, 1.44] == "2.8 to 23.7"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["1s", "0s"]
    assert "without avoidance 50.0 % (33.8 to 66.2)" in axes.get_title(loc="left")
    (mesh,) = axes.collections
    assert to_hex(mesh.to_rgba(0.0)) == RAMP[0]
    assert to_hex(mesh.to_rgba(100.0)) == RAMP[-1]
    assert figure.get_size_inches()[0] == 3.5


def test_curves_have_the_probabilities_and_their_bands(data: StudyData) -> None:
    axes: Any = drawn(data, "made_up_curve_lost").axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    first = lines["loss 0%"]
    assert first.get_xdata().tolist() == [0.0, 1.0]
    assert first.get_ydata().tolist() == [25.0, 0.0]
    assert lines["loss 30%"].get_ydata().tolist() == [100.0, 10.0]
    assert first.get_color() == LINE_COLOURS[0]
    ((vertices,),) = [[path.vertices for path in axes.collections[0].get_paths()]]
    assert np.max(vertices[:, 1]) == pytest.approx(41.2, abs=0.05)  # Clopper-Pearson of 10 of 40
    dotted = [line for line in axes.lines if set(line.get_ydata()) == {50.0}]
    assert len(dotted) == 1


LONG_LABELS = [
    "5 Hz, at once",
    "ADS-B: 2 Hz, 1.2 s (95 %)",
    "network Remote ID: 1 Hz, 1 s (95 %)",
    "as received by $EUROCAE_ED-269$, on the ground",
    "a" * 60,
]


@pytest.mark.parametrize("kind", ["map", "curve"])
def test_long_labels_stand_beside_each_other(tmp_path: Path, kind: str) -> None:
    """All within the figure, none over another, and every letter as it is."""
    network = {"name": "network", "level": [{"label": label} for label in LONG_LABELS]}
    results = results_in(tmp_path, study_table(factor=[network]), lambda cell: 4 * cell.number)
    figure = drawn(study_data_of(results, "x"), f"made_up_{kind}_lost")
    with rc_context(PAPER_STYLE):
        figure.draw_without_rendering()
    labels = figure.axes[0].get_xticklabels()
    assert ["".join(label.get_text().split()) for label in labels] == [
        "".join(label.split()) for label in LONG_LABELS
    ]
    assert not any(label.get_parse_math() for label in labels)
    places = [label.get_window_extent() for label in labels]
    assert all(one.x1 < other.x0 for one, other in pairwise(places))
    assert places[0].x0 > 0.0
    assert places[-1].x1 < figure.bbox.x1
    assert all(place.y0 > 0.0 for place in places)
    fields = [
        text.get_window_extent() for text in figure.axes[0].texts if " to " in text.get_text()
    ]
    assert all(one.x1 < other.x0 for one, other in pairwise(fields))


def test_survival_steps_through_the_runs_that_keep_so_much(data: StudyData) -> None:
    axes: Any = drawn(data, "made_up_survival_loss-30").axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    for label, lost in (("latency 1s", 4), ("latency 0s", 40)):
        x, y = lines[label].get_xdata(), lines[label].get_ydata()
        assert y[list(x).index(1.0)] == pytest.approx(100.0 * (1.0 - lost / 40))
    assert any(list(line.get_xdata()) == [1.0, 1.0] for line in axes.lines)


@pytest.mark.parametrize("kind", ["none", "words", "drawn"])
def test_figures_of_other_kinds_of_study(tmp_path: Path, kind: str) -> None:
    bounds = {**LATENCY, "low": 0.0, "high": 1.0}
    changes: dict[str, dict[str, Any]] = {
        "none": {},
        "words": {"factor": [ELECTORS]},
        "drawn": {"factor": [bounds], "design": {"kind": "sobol", "points": 4}},
    }
    change = changes[kind]
    results = results_in(tmp_path, study_table(10, **change), lambda cell: cell.number)
    figures = study_figures(study_data_of(results, "x"))
    wanted = {
        "none": {"made_up_survival"},
        "words": {"made_up_map_lost", "made_up_curve_lost", "made_up_survival"},
        "drawn": {"made_up_points_lost", "made_up_survival"},
    }[kind]
    assert wanted <= set(figures)
    write_study_figures({name: figures[name] for name in wanted}, tmp_path, "png", 50)
    assert all((tmp_path / f"{name}.png").read_bytes().startswith(PNG) for name in wanted)


def test_files_are_what_they_say_and_the_same_each_time(data: StudyData, tmp_path: Path) -> None:
    some = {k: v for k, v in study_figures(data).items() if k.endswith("map_lost")}
    written = []
    for turn in ("one", "two"):
        (tmp_path / turn).mkdir()
        for suffix in ("pdf", "png", "svg"):
            write_study_figures(some, tmp_path / turn, suffix, 100)
        files = sorted((tmp_path / turn).iterdir())
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]
    pdf, png, svg = written[0]
    assert pdf.startswith(b"%PDF")
    assert re.search(rb"/MediaBox \[ 0 0 252 ", pdf)  # 3.5 in
    assert b"/FontFile2" in pdf
    assert b"CreationDate" not in pdf
    assert png.startswith(PNG)
    assert int.from_bytes(png[16:20]) == 350
    assert b"<svg" in svg
    assert b"<text" not in svg  # letters are paths: no font is needed


# The command


def test_the_page_is_written_beside_the_results_and_never_over_a_file(folder: Path) -> None:
    assert study_report(folder) == 0
    page = folder.parent / "made_up.html"
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    page.write_text("mine", encoding="utf-8")
    with pytest.raises(LogError, match="exists already, not overwriting; use --force"):
        study_report(folder)
    assert page.read_text(encoding="utf-8") == "mine"
    assert study_report(folder, force=True) == 0
    assert page.stat().st_size > 1e6


def test_figures_are_written_without_the_page_and_never_over_a_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def few(data: StudyData) -> object:
        return {k: v for k, v in study_figures(data).items() if "survival" in k}

    monkeypatch.setattr("fleet.study_report.paper.study_figures", few)
    figures = folder.parent / "figures"
    formats = [ReportFormat.pdf, ReportFormat.png]
    assert study_report(folder, figures=figures, formats=formats, dpi=50) == 0
    assert sorted(path.name for path in figures.iterdir()) == [
        f"made_up_survival_loss-{level}.{suffix}" for level in (0, 30) for suffix in ("pdf", "png")
    ]
    assert not (folder.parent / "made_up.html").exists()
    with pytest.raises(LogError, match="exists already"):
        study_report(folder, figures=figures)


@pytest.mark.parametrize(
    ("said", "page"),
    [("a/x.study", "a/x.html"), ("x", "x.html"), ("a/v1.2", "a/v1.2.html"), ("x.study/", "x.html")],
)
def test_the_page_has_the_name_of_the_results(said: str, page: str) -> None:
    assert page_beside(Path(said)) == Path(page)


def test_results_here_have_the_name_of_their_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert page_beside(Path()) == folder.parent / "made_up.html"


def test_a_study_without_runs_has_no_figures(tmp_path: Path) -> None:
    ResultsFolder.create(tmp_path / "x", load_study(study_table()))
    with pytest.raises(StudyError, match="no run was flown"):
        study_report(tmp_path / "x", figures=tmp_path / "figures")


def test_a_missing_extra_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "plotly.offline", None)
        with pytest.raises(MissingExtraError, match=r"pip install 'zenoh-fleet\[report\]'"):
            study_report(folder)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match="a figure needs the library 'matplotlib'"):
        study_report(folder, figures=folder.parent / "figures")


def test_the_command_is_one_of_a_study(folder: Path) -> None:
    done = CliRunner().invoke(
        application(["study"]), ["study", "report", str(folder), "--against", "2"]
    )
    assert done.exit_code == 0, done.output
    page = (folder.parent / "made_up.html").read_text(encoding="utf-8")
    assert "Against cell 2: latency 0s, loss 0%" in page


def test_wrong_usage_is_one_line(cli: Cli) -> None:
    done = cli.run("study", "report", "missing.study")
    assert done.returncode == 2
    assert "missing.study has no results of a study" in done.stderr
    assert done.stderr.count("\n") == 1
