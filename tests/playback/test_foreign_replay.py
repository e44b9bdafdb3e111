"""What other programs have added to a log goes out on zenoh if asked for, never as one of a run."""

from __future__ import annotations

from pathlib import Path

import pytest

import fleet
from fleet.errors import LogError
from fleet.playback.topics import foreign_key
from tests.support.foreign_logs import Added, with_added
from tests.support.replay_tools import Ear, expected, logged, until

ADDED = [
    Added("7/battery", b"\x81\xa6charge\x01", t_s=0.5),
    Added("/imu/", b"\x00\x01", "cdr", "sensor_msgs/Imu", 0.6),
    Added("sim/abort", b"\x80", t_s=0.7),
    Added("/1/adsb/0", b"\x80", t_s=0.8),
    Added("a//b*", b"\x80", t_s=0.9),
]


@pytest.mark.parametrize(
    ("topic", "key"),
    [
        ("7/battery", "7/battery"),
        ("/imu/", "imu"),
        ("coordinator/mood", "coordinator/mood"),
        ("sim/abort", None),
        ("/sim/x", None),
        ("replay/clock", None),
        ("/1/adsb/0", None),
        ("1/adsb", None),
        ("a//b", None),
        ("a*", None),
        ("a?b", None),
        ("/", None),
        ("", None),
    ],
)
def test_a_foreign_topic_keeps_its_name_unless_it_would_be_one_of_a_run(
    topic: str, key: str | None
) -> None:
    assert foreign_key(topic) == key


def test_foreign_messages_are_replayed_if_asked_for(tmp_path: Path) -> None:
    base, log = tmp_path / "base.mcap", tmp_path / "run.mcap"
    run = logged(base, "head_on", "2")
    with_added(base, log, ADDED)
    with fleet.LogReplay(log, rate=50.0, foreign=True) as replay:
        with Ear(replay.endpoint, f"fleet/{run}/**") as ear:
            report = replay.play()
            until(lambda: len(ear.heard) == report.messages)
        left_out = replay.left_out()
    theirs = [(f"fleet/{run}/7/battery", ADDED[0].payload), (f"fleet/{run}/imu", b"\x00\x01")]
    assert sorted(ear.heard) == sorted([*expected(base, run), *theirs])
    assert [words.split("'")[1] for words in left_out] == ["/1/adsb/0", "a//b*", "sim/abort"]


def test_else_they_are_left_out_and_that_is_said(tmp_path: Path) -> None:
    base, log = tmp_path / "base.mcap", tmp_path / "run.mcap"
    run = logged(base, "head_on", "2")
    with_added(base, log, ADDED)
    with fleet.LogReplay(log, rate=50.0) as replay:
        report = replay.play()
        assert replay.left_out() == ["not replayed: 5 messages of foreign topics; --foreign does"]
    assert report.messages == len(expected(base, run))


def test_a_log_of_another_program_is_replayed_under_a_name(tmp_path: Path) -> None:
    log = with_added(None, tmp_path / "x.mcap", ADDED)
    with pytest.raises(LogError, match="has foreign messages alone; replay them with --foreign"):
        fleet.LogReplay(log, run="x").__enter__()
    with pytest.raises(LogError, match="names no run; give a name with --run"):
        fleet.LogReplay(log, foreign=True).__enter__()
    with fleet.LogReplay(log, foreign=True, run="x", rate=50.0) as replay:
        assert replay.play().messages == 2
