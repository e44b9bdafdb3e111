"""The player, on a clock of its own."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import msgspec
import pytest

from fleet.log.reader import Record
from fleet.playback.player import (
    CLOCK_TOPIC,
    READ_AHEAD,
    Player,
    PlayerKey,
    ReplayClock,
    ReplayReport,
)
from fleet.playback.schedule import ReplayMessage, ReplayTimeline, Window, replay_messages
from fleet.playback.topics import Selection
from tests.support.replay_tools import S, log_of

Clocks = dict[float, ReplayClock]


class FakeInput:
    """Time passes only while the player waits; keys are pressed at given times in s."""

    def __init__(self, *keys: tuple[float, PlayerKey]) -> None:
        self.t_ns = 0
        self._keys = [(round(s * S), key) for s, key in keys]

    def now_ns(self) -> int:
        return self.t_ns

    def wait(self, until_ns: int) -> Sequence[PlayerKey]:
        if self._keys and self._keys[0][0] <= until_ns:
            at_ns, key = self._keys.pop(0)
            self.t_ns = max(self.t_ns, at_ns)
            return [key]
        self.t_ns = max(self.t_ns, until_ns)
        return []


class Played:
    """Plays a schedule with a fake input; what was put, with its time in s."""

    def __init__(
        self,
        log: list[Record],
        *keys: tuple[float, PlayerKey],
        rate: float = 1.0,
        paused: bool = False,
        clock_hz: float = 0.0,
        put_s: float = 0.0,
    ) -> None:
        player_input = FakeInput(*keys)
        self.put: list[tuple[float, str, bytes]] = []

        def put(topic: str, payload: bytes) -> None:
            self.put.append((player_input.t_ns / S, topic, payload))
            player_input.t_ns += round(put_s * S)

        timeline = ReplayTimeline(0, rate, paused=paused)
        player = Player(timeline, player_input, put, clock_hz=clock_hz)
        player.play(replay_messages(lambda: log, Window(), Selection()))
        self.report: ReplayReport = player.report

    @property
    def times(self) -> list[float]:
        return [t for t, topic, _ in self.put if topic != CLOCK_TOPIC]


EVERY_100_MS = log_of(*((n / 10, "a") for n in range(21)))


@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0])
def test_messages_go_out_when_they_are_due(rate: float) -> None:
    played = Played(EVERY_100_MS, rate=rate)
    assert played.times == pytest.approx([n / 10 / rate for n in range(21)])
    assert played.report.messages == 21
    assert played.report.duration_s == pytest.approx(2.0 / rate)
    assert played.report.errors_s() == {"p50": 0.0, "p99": 0.0, "max": 0.0}


def test_a_report_says_in_short_how_it_went() -> None:
    error = "timing error p50 0.00 ms, p99 0.00 ms, max 0.00 ms"
    assert repr(Played(EVERY_100_MS).report) == f"<replayed 21 messages in 2.000 s; {error}>"
    assert repr(ReplayReport()) == "<replayed 0 messages in 0.000 s>"


def test_a_pause_shifts_what_comes_after_it_and_nothing_else() -> None:
    played = Played(EVERY_100_MS, (0.55, PlayerKey.PAUSE), (7.05, PlayerKey.PAUSE))
    expected = [n / 10 for n in range(6)] + [n / 10 + 6.5 for n in range(6, 21)]
    assert played.times == pytest.approx(expected)


def test_next_sends_one_message_and_the_schedule_is_there_then() -> None:
    log = log_of((0.0, "a"), (1.0, "b"), (1.0, "c"), (4.0, "d"))
    keys = [(s, PlayerKey.NEXT) for s in (2.0, 3.0)]
    played = Played(log, (1.5, PlayerKey.NEXT), *keys, (10.0, PlayerKey.PAUSE), paused=True)
    assert played.times == pytest.approx([1.5, 2.0, 3.0, 13.0])
    assert [topic for _, topic, _ in played.put] == ["a", "b", "c", "d"]
    assert played.report.bins.total() == 1


def test_next_does_nothing_while_the_schedule_runs() -> None:
    assert Played(EVERY_100_MS, (0.55, PlayerKey.NEXT)).times == Played(EVERY_100_MS).times


def test_the_rate_changes_by_a_tenth_from_there_on() -> None:
    faster = Played(EVERY_100_MS, (1.0, PlayerKey.FASTER)).times
    assert faster[:11] == pytest.approx([n / 10 for n in range(11)])
    assert faster[-1] == pytest.approx(1.0 + 1.0 / 1.1)
    assert Played(EVERY_100_MS, (1.0, PlayerKey.SLOWER)).times[-1] == pytest.approx(1.0 + 1.0 / 0.9)


def test_what_is_behind_time_is_sent_at_once_in_order_and_counted_as_late() -> None:
    played = Played(EVERY_100_MS, rate=1.0, put_s=0.15)
    assert played.times == pytest.approx([0.15 * n for n in range(21)])
    assert [p for _, _, p in played.put] == [r.payload for r in EVERY_100_MS]
    assert played.report.errors_s()["max"] == pytest.approx(20 * 0.05)


def test_keys_are_heard_also_by_a_player_that_is_behind() -> None:
    played = Played(EVERY_100_MS, (0.4, PlayerKey.PAUSE), (9.0, PlayerKey.PAUSE), put_s=0.15)
    assert any(b - a > 8.0 for a, b in zip(played.times, played.times[1:], strict=False))


def test_the_clock_tells_the_log_time_at_its_own_pace() -> None:
    log = log_of((5.0, "a"), (6.0, "a"), (7.0, "a"))
    played = Played(log, (1.05, PlayerKey.PAUSE), (3.05, PlayerKey.PAUSE), rate=2.0, clock_hz=10.0)
    told = [
        (t, msgspec.msgpack.decode(payload, type=ReplayClock))
        for t, topic, payload in played.put
        if topic == CLOCK_TOPIC
    ]
    assert played.times == pytest.approx([0.0, 0.5, 1.0])
    assert [t for t, _ in told] == pytest.approx([n / 10 for n in range(len(told))])
    assert [c.t_ns / S for _, c in told] == pytest.approx([5.0 + 2 * t for t, _ in told])


def ticking(log: list[Record], chosen: str, count: int, *keys: tuple[float, PlayerKey]) -> Clocks:
    """What the clock tells at ten times a second, by time in s, while a loop sends so many."""
    player_input, told = FakeInput(*keys), Clocks()

    def put(topic: str, payload: bytes) -> None:
        if topic == CLOCK_TOPIC:
            told[round(player_input.t_ns / S, 1)] = msgspec.msgpack.decode(
                payload, type=ReplayClock
            )

    endless = replay_messages(lambda: log, Window(), Selection([chosen]), loop=True)
    Player(ReplayTimeline(0), player_input, put, clock_hz=10.0).play(
        itertools.islice(endless, count)
    )
    return told


def test_the_clock_stands_while_paused_and_begins_anew_with_each_round() -> None:
    log = log_of((5.0, "a"), (6.0, "a"))
    at = ticking(log, "a", 5, (0.25, PlayerKey.PAUSE), (1.25, PlayerKey.PAUSE))
    assert at[0.2] == ReplayClock(5_200_000_000, 1.0, False, 0)
    assert at[0.7] == at[1.2] == ReplayClock(5_250_000_000, 1.0, True, 0)
    assert at[1.5] == ReplayClock(5_500_000_000, 1.0, False, 0)
    assert at[2.5] == ReplayClock(5_500_000_000, 1.0, False, 1)


def test_the_clock_is_right_also_between_the_last_message_of_a_round_and_the_next() -> None:
    at = ticking(log_of((5.0, "a"), (5.5, "b"), (6.0, "a")), "b", 3)
    assert [at[t] for t in (0.2, 0.8, 1.2)] == [
        ReplayClock(5_200_000_000, 1.0, False, 0),
        ReplayClock(5_800_000_000, 1.0, False, 0),
        ReplayClock(5_200_000_000, 1.0, False, 1),
    ]


def test_reading_ahead_is_done_in_gaps_and_bounded() -> None:
    taken = ahead = 0

    def source() -> Iterator[ReplayMessage]:
        nonlocal taken
        for n in range(READ_AHEAD + 2000):
            taken += 1
            yield ReplayMessage(n * S, 0, 0, 0, "a", b"")

    def put(_topic: str, _payload: bytes) -> None:
        nonlocal ahead
        sent = player.report.messages
        ahead = max(ahead, taken - sent - 1)
        assert ahead == 0 or sent > 0

    player = Player(ReplayTimeline(0), FakeInput(), put)
    player.play(source())
    assert ahead == READ_AHEAD


def test_the_connection_is_checked_once_a_second() -> None:
    checks: list[int] = []
    player_input = FakeInput()
    timeline = ReplayTimeline(0)
    player = Player(
        timeline, player_input, lambda *_: None, check=lambda: checks.append(player_input.t_ns)
    )
    player.play(replay_messages(lambda: log_of((0.0, "a"), (10.0, "a")), Window(), Selection()))
    assert [t // S for t in checks] == list(range(11))
