"""The page in a real browser, Chromium driven by Playwright; skipped where there is none."""

from __future__ import annotations

import json
import shutil
import signal
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from fleet.analysis.palette import ON_WHITE, colour_of
from fleet.analysis.recorded_run import RecordedRun
from fleet.faults.kinds.partition import Partition
from fleet.live.log_source import LogSource
from fleet.live.view import LiveView, ViewData
from tests.conftest import Cli
from tests.live.test_live_run import said
from tests.live.test_live_view import at

playwright = pytest.importorskip("playwright.sync_api", reason="needs: pip install playwright")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs: apt-get install chromium")
WAIT_MS = 30_000
COMMANDING = "2,3 #22272e"
"""Dashes and colour of the lines from a computing UAV to those that fly its commands."""
OUTLINED = "#b3123a"
"""Round whom a partition was drawn first; or whose separation is lost."""
NOTED_LINES = """
window.lines = {};
window.words = {};
window.bends = {};
let bends = 0;
const begin = CanvasRenderingContext2D.prototype.beginPath;
const on = CanvasRenderingContext2D.prototype.lineTo;
const write = CanvasRenderingContext2D.prototype.fillText;
const stroke = CanvasRenderingContext2D.prototype.stroke;
const clear = CanvasRenderingContext2D.prototype.clearRect;
CanvasRenderingContext2D.prototype.clearRect = function (...where) {
    window.lines[this.canvas.parentElement.id] = [];
    window.words[this.canvas.parentElement.id] = [];
    window.bends[this.canvas.parentElement.id] = [];
    clear.apply(this, where);
};
CanvasRenderingContext2D.prototype.beginPath = function () {
    bends = 0;
    begin.apply(this);
};
CanvasRenderingContext2D.prototype.lineTo = function (...where) {
    bends += 1;
    on.apply(this, where);
};
CanvasRenderingContext2D.prototype.stroke = function () {
    const look = `${this.getLineDash()} ${this.strokeStyle}`;
    window.lines[this.canvas.parentElement.id].push(look);
    window.bends[this.canvas.parentElement.id].push([look, bends]);
    stroke.apply(this);
};
CanvasRenderingContext2D.prototype.fillText = function (text, ...where) {
    const plain = text.replace("\\u2013", "-");
    window.words[this.canvas.parentElement.id].push([plain, this.fillStyle, where[1]]);
    write.call(this, text, ...where);
};
"""
"""How each line was drawn, of how many parts, and each text, of what a canvas shows now."""


@pytest.fixture
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Opened:
    """The page of a run, and all that it asked for and complained of."""

    def __init__(
        self, browser: Any, address: str, size: tuple[int, int], told: Sequence[ViewData] = ()
    ) -> None:
        """`told`: what the page is told, if not what its server would tell."""
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.asked: list[str] = []
        self.problems: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("console", lambda message: self.problems.append(message.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.add_init_script(NOTED_LINES)
        if told:
            messages = [json.dumps(message) for message in told]
            self.page.route_web_socket(
                "**/live", lambda socket: [socket.send(message) for message in messages]
            )
        self.page.goto(address)

    def shows(self, where: str, words: str) -> None:
        """Wait until something says so."""
        playwright.expect(self.page.locator(where)).to_contain_text(words, timeout=WAIT_MS)

    def drawn(self, where: str) -> int:
        """How many pixels of a canvas are not empty."""
        script = """(canvas) => {
            const pen = canvas.getContext("2d");
            const pixels = pen.getImageData(0, 0, canvas.width, canvas.height).data;
            let count = 0;
            for (let k = 3; k < pixels.length; k += 4) count += pixels[k] > 0;
            return count;
        }"""
        return int(self.page.locator(f"{where} canvas").evaluate(script))

    def drawn_round(self, box: tuple[float, float, float, float]) -> None:
        """Drag over the plan view with Shift, from corner to corner in parts of its size."""
        canvas = self.page.locator("#plan canvas").bounding_box()
        left, top, right, bottom = box
        mouse, (x, y, w, h) = self.page.mouse, (canvas[k] for k in ("x", "y", "width", "height"))
        self.page.keyboard.down("Shift")
        mouse.move(x + left * w, y + top * h)
        mouse.down()
        mouse.move(x + right * w, y + bottom * h)
        mouse.up()
        self.page.keyboard.up("Shift")

    def lines(self, where: str, look: str) -> int:
        """How many lines of a look a canvas shows."""
        return int(self.page.evaluate(f"lines.{where}.filter((line) => line === '{look}').length"))

    def parts(self, where: str, look: str) -> list[int]:
        """Of how many parts each line of a look is, on what a canvas shows."""
        drawn = self.page.evaluate(f"bends.{where}")
        return [count for its, count in drawn if its == look]


def opened_log(cli: Cli, browser: Any, scenario: str, size: tuple[int, int]) -> Opened:
    """The page of a log of a minute, which stands still."""
    cli.run("run", scenario, "--bus", "memory", "--duration", "60", "--out", "y.mcap")
    server = cli.start("live", "y.mcap")
    opened = Opened(browser, said(server, r"(http://\S+)"), size)
    opened.shows("#state", " of 60 s")
    opened.page.locator("#pause").click()
    return opened


@pytest.mark.parametrize("size", [(1400, 1100), (390, 844)])
def test_a_kill_clicked_in_the_browser_is_in_the_log_and_repeats(
    cli: Cli, tmp_path: Path, browser: Any, size: tuple[int, int]
) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    run = cli.start(
        "run", "four_way", "--duration", "40", "--speed", "4", "--out", "x.mcap", **here
    )
    server = cli.start("live", said(run, r"^run (\w+):"), "--wait", "30", **here)
    address = said(server, r"(http://\S+)")
    opened = Opened(browser, address, size)
    opened.shows("#state", " of 40 s")
    opened.page.locator("#processes .row[data-process='2'] button", has_text="Kill").click()
    opened.shows("#rules", "kill")
    opened.shows("#processes .row[data-process='2']", "Restart")
    for canvas in ("#plan", "#space", "#strip", "#links"):
        assert opened.drawn(canvas) > 1000
    before = opened.page.locator("#state").inner_text()
    playwright.expect(opened.page.locator("#state")).not_to_have_text(before, timeout=WAIT_MS)
    opened.page.locator("#speed").select_option("20")
    opened.shows("#state", "the run is over")
    width = opened.page.evaluate("document.documentElement.scrollWidth")
    assert width <= size[0]  # nothing to scroll sideways
    assert opened.problems == []
    assert {url.split("/")[2] for url in opened.asked if not url.startswith("data:")} == {
        address.split("/")[2]
    }
    _, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "kill" in [rule.name for rule in RecordedRun.of_log(tmp_path / "x.mcap").plan]
    assert cli.run("repeat", "x.mcap", **here).returncode == 0


def test_a_partition_is_drawn_round_two_groups(cli: Cli, tmp_path: Path, browser: Any) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    run = cli.start(
        "run", "four_way", "--duration", "20", "--speed", "1", "--out", "x.mcap", **here
    )
    server = cli.start("live", said(run, r"^run (\w+):"), "--wait", "30", **here)
    opened = Opened(browser, said(server, r"(http://\S+)"), (1400, 1100))
    opened.shows("#state", " of 20 s")
    north, west = (0.1, 0.02, 0.9, 0.3), (0.02, 0.35, 0.3, 0.65)  # where UAVs 3 and 1 are
    everything = (0.02, 0.02, 0.98, 0.98)
    field = opened.page.locator("[name=partition]")
    assert "With Shift, drag" in opened.page.locator("#plan .hint").inner_text()
    for box, groups in (
        (north, "3/coordinator,1,2,4"),
        (west, "3/1"),
        (everything, "1,2,3,4/coordinator"),
        (west, "2,3,4/1"),
        ((0.05, 0.05, 0.1, 0.1), ""),  # where nobody is
        (north, "3/coordinator,1,2,4"),
        (west, "3/1"),
    ):
        opened.drawn_round(box)
        assert field.input_value() == groups
        assert opened.lines("plan", f" {OUTLINED}") > 0 or not groups
    opened.page.locator("#faults button", has_text="Add").click()
    opened.shows("#rules", "partition")
    playwright.expect(field).to_have_value("", timeout=WAIT_MS)
    opened.page.locator("#speed").select_option("20")
    opened.shows("#state", "the run is over")
    assert opened.problems == []
    run.communicate(timeout=60)
    (rule,) = RecordedRun.of_log(tmp_path / "x.mcap").plan
    assert isinstance(rule, Partition)
    assert (rule.groups, rule.src, rule.dst) == ("3/1", "*", "*")


def test_nothing_is_drawn_round_where_nothing_can_be_cut(
    cli: Cli, tmp_path: Path, browser: Any
) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    run = cli.start("run", "four_way", "--duration", "600", "--speed", "1", **here)
    server = cli.start("live", said(run, r"^run (\w+):"), "--read-only", "--wait", "30", **here)
    of_run = Opened(browser, said(server, r"(http://\S+)"), (1400, 1100))
    of_run.shows("#state", " of 600 s")
    for opened in (opened_log(cli, browser, "four_way", (1400, 1100)), of_run):
        assert "Shift" not in opened.page.locator("#plan .hint").inner_text()
        opened.drawn_round((0.02, 0.02, 0.98, 0.98))
        assert opened.lines("plan", f" {OUTLINED}") == 0
        assert opened.problems == []
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=60)


def test_a_log_is_gone_through_in_the_browser(cli: Cli, browser: Any) -> None:
    opened = opened_log(cli, browser, "head_on", (1000, 800))
    opened.shows("#state", "paused")
    opened.page.locator("#when").fill("45")
    opened.shows("#state", "45.0 of 60 s")
    opened.shows("#events", "computes for 1, 2")
    assert opened.page.locator("#processes button").count() == 0
    assert opened.problems == []


def test_of_a_log_all_that_was_flown_is_drawn_wherever_one_goes(cli: Cli, browser: Any) -> None:
    opened = opened_log(cli, browser, "four_way", (1400, 1100))
    # the separation of two minutes and the paths of one are told of from second to second
    for time_s in (2, 58, 30):
        opened.page.locator("#when").fill(str(time_s))
        opened.shows("#state", f"{time_s}.0 of 60 s")
        for where in ("plan", "space"):
            for uav in range(4):
                assert max(opened.parts(where, f" {colour_of(uav).lower()}")) >= time_s
        assert (
            sum(max(opened.parts("strip", f" {c.lower()}"), default=0) >= time_s for c in ON_WHITE)
            == 6
        )
    assert opened.problems == []


def test_of_a_run_no_path_is_drawn_for_what_was_not_seen(
    cli: Cli, tmp_path: Path, browser: Any
) -> None:
    cli.run("run", "four_way", "--bus", "memory", "--duration", "60", "--out", "y.mcap")
    flown = RecordedRun.of_log(tmp_path / "y.mcap")
    source, view = LogSource(flown, "a run"), LiveView(flown.scenario)
    times_s = (1.0, 2.0, 4.0, 50.0, 51.0)
    told = [{"about": view.about(title="a run", read_only=False)}]
    told += [{"view": at(source, view, time_s)} for time_s in times_s]
    address = said(cli.start("live", "y.mcap"), r"(http://\S+)")
    opened = Opened(browser, address, (1400, 1100), told)
    opened.shows("#state", "51.0 of 60 s")
    for uav in range(4):
        assert opened.parts("plan", f" {colour_of(uav).lower()}")[:2] == [2, 1]
        assert opened.parts("space", f" {colour_of(uav).lower()}")[:2] == [2, 1]
    assert opened.problems == []


@pytest.mark.parametrize("size", [(1400, 1100), (390, 844)])
def test_both_views_tell_from_whom_a_command_is(
    cli: Cli, browser: Any, size: tuple[int, int]
) -> None:
    opened = opened_log(cli, browser, "four_way", size)
    for time_s, commanded in (("1", 0), ("45", 3)):  # UAV 1 commands the other three
        opened.page.locator("#when").fill(time_s)
        opened.shows("#state", f"{time_s}.0 of 60 s")
        for view in ("plan", "space"):
            assert opened.lines(view, COMMANDING) == commanded


def test_each_pair_has_a_look_of_its_own_and_its_label_too(cli: Cli, browser: Any) -> None:
    opened = opened_log(cli, browser, "four_way", (1400, 1100))
    for time_s in ("1", "45"):
        opened.page.locator("#when").fill(time_s)
        opened.shows("#state", f"{time_s}.0 of 60 s")
        words = [word for word in opened.page.evaluate("words.strip") if "-" in word[0]]
        assert sorted(text[:3] for text, *_ in words) == ["1-2", "1-3", "1-4", "2-3", "2-4", "3-4"]
        assert len({colour for _, colour, _ in words}) == 6
        places = sorted(place for *_, place in words)
        assert all(b - a >= 13 for a, b in pairwise(places))  # none on another
        for _, colour, _ in words:
            assert opened.lines("strip", f" {colour}") == 2  # the line, and from it to its label
        assert all(text.endswith("> 4") for text, *_ in words) == (time_s == "1")
    assert opened.problems == []
