"""The page of a study as a browser draws it, on a screen and on paper."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest

from fleet.study_report.study_data import study_data_of
from tests.support.study_samples import LOSS, results_in, study_table

pytest.importorskip("plotly")
playwright = pytest.importorskip("playwright.sync_api", reason="needs: pip install playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs: apt-get install chromium")

LABELS = ["5 Hz, at once", "network Remote ID: 1 Hz, 1 s (95 %)", "<b>all</b> & more", "a" * 40]
PAPER_PX = 718
"""The width of A4 less margins of a centimetre."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from fleet.study_report.study_page import study_page

    folder = tmp_path_factory.mktemp("page")
    network = {"name": "network", "level": [{"label": label} for label in LABELS]}
    table = study_table(20, factor=[network, {**LOSS, "values": [*range(8)]}])
    results = results_in(folder / "s.study", table, lambda cell: cell.number % 20)
    (folder / "s.html").write_text(study_page(study_data_of(results, "x")), encoding="utf-8")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        opened = chromium.new_page(viewport={"width": 1280, "height": 900})
        opened.goto((folder / "s.html").as_uri())
        opened.wait_for_selector("html[data-ready=yes]")
        yield opened
        chromium.close()


def test_every_level_is_named_as_it_is_and_beside_the_others(page: Any) -> None:
    for chart in ("maps", "curves"):
        if chart == "curves":
            page.locator("#curves-pickers select").nth(1).select_option("0")
        ticks = page.locator(f"#plot-{chart} .xtick text")
        playwright.expect(ticks).to_have_count(len(LABELS))
        texts = ["".join(text.split()) for text in ticks.all_text_contents()]
        assert texts == ["".join(label.split()) for label in LABELS], chart
        boxes = [tick.bounding_box() for tick in ticks.all()]
        for one, other in pairwise(boxes):
            assert one["x"] + one["width"] < other["x"] + 8, (chart, one, other)


def test_tables_are_whole_on_paper(page: Any) -> None:
    page.evaluate(
        "document.querySelectorAll('details').forEach((d) => (d.open = !d.closest('td')))"
    )
    page.emulate_media(media="print")
    page.set_viewport_size({"width": PAPER_PX, "height": 1000})
    seen = page.evaluate(
        """[...document.querySelectorAll('.scroll')].map((box) => [
            box.scrollWidth - box.clientWidth, box.scrollHeight - box.clientHeight])"""
    )
    assert len(seen) > 4
    assert all(beyond <= [0, 0] for beyond in seen), seen
