"""`fleet.LogReplay`: a log published again by a program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import fleet
from tests.support.replay_tools import Ear, expected, logged, until


def test_a_program_replays_a_log_byte_for_byte(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    run = logged(log, "head_on", "2")
    with fleet.LogReplay(log, rate=20.0) as replay, Ear(replay.endpoint, f"fleet/{run}/**") as ear:
        report = replay.play()
        until(lambda: len(ear.heard) >= report.messages)
    assert ear.heard == expected(log, run)
    assert replay.report is report
    assert repr(replay) == f"<replay of {log} at rate 20: {report.words()}>"
    assert replay.left_out() == []


def test_a_run_that_was_opened_is_replayed_in_part_and_the_rest_is_named(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    logged(log, "head_on", "2")
    found, topics = fleet.open_log(log), ["1/truth", "9/truth"]
    with fleet.LogReplay(found, topics=topics, start_s=1.0, rate=100.0, run="again") as replay:
        assert replay.play().messages == 11
        with pytest.raises(ValueError, match="played once"):
            replay.play()
    assert replay.run == "again"
    assert replay.left_out() == ["no message was concerned by '9/truth'"]


def test_what_cannot_be_replayed_is_told_before_anything_is_opened(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    logged(log, "head_on", "1")
    wrong: dict[str, Any]
    for wrong in ({"rate": 0.0}, {"start_s": -1.0}, {"remap": ["1"]}, {"run": "a/b"}):
        with pytest.raises(ValueError):  # noqa: PT011
            fleet.LogReplay(log, **wrong)
    none = fleet.LogReplay(tmp_path / "none.mcap")
    with pytest.raises(fleet.LogError, match="No such file"), none:
        pass
    with pytest.raises(ValueError, match="within its context"):
        fleet.LogReplay(log).play()
