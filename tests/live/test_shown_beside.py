"""A run that is watched: at which speed it flies."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest

from fleet.cli import application, run
from fleet.errors import BusError
from fleet.simulation.simulation import RunOptions, RunOutcome


@pytest.mark.parametrize(
    ("given", "flown"),
    [((), 1.0), (("--speed", "0"), 0.0), (("--speed", "3"), 3.0), (("--clock", "realtime"), 0.0)],
)
@pytest.mark.parametrize("shown", [("--live",), ("--foxglove",)])
def test_a_watched_run_flies_at_real_time_unless_a_speed_is_given(
    given: tuple[str, ...],
    flown: float,
    shown: tuple[str, ...],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    speeds = []

    def fly(options: RunOptions, _: object) -> RunOutcome:
        speeds.append(options.speed)
        raise BusError("enough")

    monkeypatch.setattr(run, "run_fleet", fly)
    monkeypatch.setattr(run, "shown_beside", lambda *_, **__: nullcontext())
    words = ["run", "four_way", "--out", str(tmp_path / "x.mcap"), *given, *shown]
    with pytest.raises(BusError, match="enough"):
        application(["run"])(words, standalone_mode=False)
    assert speeds == [flown]
