"""The pace of a lockstep run, as an operator changes it."""

from __future__ import annotations

import msgspec
import pytest

from fleet.simulation import pace as module
from fleet.simulation.pace import Pace, PaceRequest


class Clockwork:
    """A wall clock that goes on when somebody sleeps."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Operator:
    """Stands in for the bus: hands on what is asked."""

    def __init__(self, pace: Pace) -> None:
        pace.listen(self)  # type: ignore[arg-type]

    def answer(self, _topic: str, take: object) -> None:
        self._take = take

    def ask(self, request: bytes) -> list[bytes]:
        answers: list[bytes] = []
        self._take(request, answers.append)  # type: ignore[operator]
        return answers


@pytest.fixture
def clockwork(monkeypatch: pytest.MonkeyPatch) -> Clockwork:
    clockwork = Clockwork()
    monkeypatch.setattr(module, "time", clockwork)
    return clockwork


def asked(operator: Operator, pace: Pace, **change: object) -> str:
    answers = operator.ask(msgspec.json.encode(PaceRequest(**change)))  # type: ignore[arg-type]
    pace.due(0)
    return answers[0].decode()


def test_a_pace_holds_simulated_time_to_the_wall_clock(clockwork: Clockwork) -> None:
    pace, begun_s = Pace(4.0), clockwork.now_s
    for tick in range(101):
        while not pace.due(tick * 100_000_000):
            pass
        assert clockwork.now_s - begun_s == pytest.approx(tick * 0.1 / 4.0, abs=1e-6)


def test_without_a_pace_nobody_waits(clockwork: Clockwork) -> None:
    pace = Pace()
    assert all(pace.due(tick * 100_000_000) for tick in range(100))
    assert clockwork.now_s == 50.0


def test_a_paused_run_goes_on_by_ticks_or_when_it_is_told_to(clockwork: Clockwork) -> None:
    pace = Pace(1.0)
    operator = Operator(pace)
    assert pace.due(0)
    assert asked(operator, pace, paused=True) == ""
    before_s = clockwork.now_s
    assert not any(pace.due(100_000_000) for _ in range(10))
    assert clockwork.now_s > before_s  # or it would keep a processor busy
    operator.ask(msgspec.json.encode(PaceRequest(steps=2)))
    assert [pace.due(100_000_000) for _ in range(4)] == [True, True, False, False]
    operator.ask(msgspec.json.encode(PaceRequest(paused=False)))
    now_s = clockwork.now_s
    assert pace.due(300_000_000)
    assert clockwork.now_s == now_s  # what was paused is not caught up with


def test_requests_that_make_no_sense_are_refused_and_change_nothing() -> None:
    pace = Pace(2.0)
    operator = Operator(pace)
    assert "a speed of -1" in asked(operator, pace, speed=-1.0)
    assert "a speed of 1e+09" in asked(operator, pace, speed=1e9)
    assert "-1 ticks" in asked(operator, pace, steps=-1)
    for nonsense in (b"", b"{", b'{"speed": "fast"}', b"[" * 5000):
        answers = operator.ask(nonsense)
        pace.due(0)
        assert answers[0].startswith(b"no request for a pace")
    assert (pace.speed, pace.paused) == (2.0, False)


def test_of_a_flood_of_requests_so_many_wait_and_the_rest_are_told() -> None:
    pace = Pace()
    operator = Operator(pace)
    request = msgspec.json.encode(PaceRequest())
    answers = [operator.ask(request) for _ in range(module.MOST_PACE_REQUESTS + 1)]
    assert answers[-1] == [b"64 requests wait; ask again"]
    assert answers[0] == []
    assert pace.lacked_room == 1
    pace.due(0)
    assert answers[0] == [b""]
