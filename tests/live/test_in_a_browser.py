"""The page in a real browser, Chromium driven by Playwright; skipped where there is none."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from fleet.analysis.palette import ON_WHITE, colour_of
from fleet.analysis.recorded_run import RecordedRun
from fleet.faults.kinds.partition import Partition
from fleet.live.log_source import LogSource
from fleet.live.view import LiveView
from tests.conftest import Cli
from tests.live.opened_page import WAIT_MS, Opened, playwright
from tests.live.test_live_run import said
from tests.live.test_live_view import at

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs: apt-get install chromium")
COMMANDING = "2,3 #22272e"
"""Dashes and colour of the lines from a computing UAV to those that fly its commands."""
OUTLINED = "#b3123a"
"""Round whom a partition was drawn first; or whose separation is lost."""


@pytest.fixture
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


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
