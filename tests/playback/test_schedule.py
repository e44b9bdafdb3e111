"""What is replayed when: topics, schedule and time line; keys, and the wait at the end."""

from __future__ import annotations

from pathlib import Path

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.errors import LogError
from fleet.log.reader import Record, read
from fleet.log.topics import matcher
from fleet.playback.flush import flush
from fleet.playback.player import PlayerKey
from fleet.playback.player_input import keys_in
from fleet.playback.schedule import ReplayMessage, ReplayTimeline, Window, replay_messages
from fleet.playback.topics import Selection
from tests.support.replay_tools import S, log_of

fast = settings(deadline=None, derandomize=True, max_examples=300)


def schedule(
    log: list[Record], offset_s: float = 0.0, length_s: float | None = None, *chosen: str
) -> list[ReplayMessage]:
    length_ns = None if length_s is None else round(length_s * S)
    return list(
        replay_messages(lambda: log, Window(round(offset_s * S), length_ns), Selection(chosen))
    )


# topics


CHUNKS = st.sampled_from(["1", "12", "adsb", "cmd", "0", "*", "**", "$*1", "1$*", "a$*b", "c$*d$*"])
TOPICS = st.lists(st.sampled_from(["1", "12", "adsb", "cmd", "0", "cdd"]), min_size=1, max_size=4)


@given(st.lists(CHUNKS, min_size=1, max_size=4), TOPICS)
@fast
def test_expressions_match_as_in_zenoh(chunks: list[str], topic: list[str]) -> None:
    ours = matcher("/".join(chunks))("/".join(topic))
    theirs = zenoh.KeyExpr.autocanonize("/".join(chunks)).intersects(zenoh.KeyExpr("/".join(topic)))
    assert ours == theirs


@pytest.mark.parametrize("text", ["", "/1", "1/", "1//2", "1*", "a#b", "a?b", "1/$x", "***", "a/"])
def test_what_is_no_expression_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no key expression"):
        matcher(text)


def test_topics_are_chosen_excluded_and_renamed() -> None:
    chosen = Selection(
        ["*/adsb/**", "1/*"], ["2/**"], ["1/truth:=7/truth", "1/**:=9/**", "8/x:=8/y"]
    )
    names = {t: chosen.name(t) for t in ("1/adsb/0", "2/adsb/0", "3/adsb/0", "1/truth", "3/truth")}
    assert names == {
        "1/adsb/0": "9/adsb/0",
        "2/adsb/0": None,
        "3/adsb/0": "3/adsb/0",
        "1/truth": "7/truth",
        "3/truth": None,
    }
    assert chosen.unused() == ["8/x:=8/y"]
    assert Selection(remaps=["**:=old/**"]).name("1/truth") == "old/1/truth"


@pytest.mark.parametrize(
    "text", ["1/a", "1/a:=", ":=1/a", "1/*:=2/*", "1/**:=2", "1:=2/**", "/1:=2", "1//**:=2/**"]
)
def test_what_is_no_remapping_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no remapping"):
        Selection(remaps=[text])


# Schedule


def test_messages_keep_the_order_of_the_log_whatever_their_times() -> None:
    log = log_of((5.0, "a"), (5.0, "c"), (5.0, "b"), (5.3, "a"), (5.1, "b"), (5.3, "b"))
    found = schedule(log)
    assert [c.payload for c in found] == [r.payload for r in log]
    assert [c.schedule_ns / S for c in found] == [0.0, 0.0, 0.0, 0.3, 0.3, 0.3]


def test_a_window_has_both_its_ends_and_keeps_the_time_before_its_first_message() -> None:
    log = log_of(*((10.0 + n, "ab"[n % 2]) for n in range(10)))
    assert [c.schedule_ns / S for c in schedule(log, 2.0, 3.0)] == [0.0, 1.0, 2.0, 3.0]
    assert [c.payload for c in schedule(log, 2.5, 3.0)] == [b"3", b"4", b"5"]
    assert [c.schedule_ns / S for c in schedule(log, 2.0, 3.0, "b")] == [1.0, 3.0]
    assert {c.origin_ns for c in schedule(log, 2.5)} == {12_500_000_000}


def test_a_loop_keeps_its_period_also_where_the_last_messages_are_not_chosen() -> None:
    log = log_of((0.0, "a"), (1.0, "a"), (2.5, "b"))
    endless = replay_messages(lambda: log, Window(), Selection(["a"]), loop=True)
    found = [next(endless) for _ in range(6)]
    assert [c.schedule_ns / S for c in found] == [0.0, 1.0, 2.5, 3.5, 5.0, 6.0]
    assert [c.round for c in found] == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize(
    ("log", "offset_s", "chosen", "loop", "why"),
    [
        (log_of(), 0.0, [], False, "the log has no messages"),
        (log_of((0.0, "a"), (3.0, "a")), 4.0, [], False, "the log lasts 3 s"),
        (log_of((0.0, "a")), 0.0, ["b"], True, "no message in this part of the log"),
        (log_of((0.0, "a")), 0.0, ["a"], True, "lasts 0 s"),
    ],
)
def test_nothing_to_replay_is_said(
    log: list[Record], offset_s: float, chosen: list[str], loop: bool, why: str
) -> None:
    with pytest.raises(LogError, match=why):
        list(
            replay_messages(lambda: log, Window(round(offset_s * S)), Selection(chosen), loop=loop)
        )


# time line


@given(
    st.lists(
        st.tuples(st.integers(0, 10 * S), st.sampled_from(["pause", "resume", "rate"])), max_size=8
    ),
    st.floats(0.1, 10.0),
)
@fast
def test_the_schedule_never_jumps(changes: list[tuple[int, str]], rate: float) -> None:
    timeline, now_ns = ReplayTimeline(0), 0
    for step_ns, what in changes:
        before = timeline.position_ns(now_ns)
        now_ns += step_ns
        moved = 0 if timeline.paused else step_ns * timeline.rate
        at = timeline.position_ns(now_ns)
        assert at - before == pytest.approx(moved, abs=2)
        match what:
            case "pause":
                timeline.pause(now_ns)
            case "resume":
                timeline.resume(now_ns)
            case _:
                timeline.set_rate(rate, now_ns)
        assert timeline.position_ns(now_ns) == at
    due_ns = timeline.due_ns(timeline.position_ns(now_ns) + S)
    if timeline.paused:
        assert due_ns is None
    else:
        assert due_ns is not None
        assert due_ns - now_ns == pytest.approx(S / timeline.rate, abs=2)


# keys and flush


@pytest.mark.parametrize(
    ("typed", "keys", "left"),
    [
        (b" ", [PlayerKey.PAUSE], b""),
        (b"\x1b[A\x1b[B\x1b[C", [PlayerKey.FASTER, PlayerKey.SLOWER, PlayerKey.NEXT], b""),
        (b"\x1bOA\x1bOB\x1bOC", [PlayerKey.FASTER, PlayerKey.SLOWER, PlayerKey.NEXT], b""),
        (b"x\x1b[D \x1b[", [PlayerKey.PAUSE], b"\x1b["),
        (b"\x1b\x1b[C", [PlayerKey.NEXT], b""),
    ],
)
def test_keys_are_recognised_in_what_is_typed(
    typed: bytes, keys: list[PlayerKey], left: bytes
) -> None:
    assert keys_in(typed) == (keys, left)


class Buffer:
    """A send buffer that is emptied at some bytes a second, after being full for a while."""

    def __init__(self, fill: int, bytes_per_s: float) -> None:
        self.t_s = 0.0
        self._fill = fill
        self._bytes_per_s = bytes_per_s

    def unsent(self) -> int:
        return max(0, round(self._fill - self._bytes_per_s * self.t_s))

    def sleep(self, seconds: float) -> None:
        self.t_s += seconds


def test_flushing_waits_as_long_as_something_moves() -> None:
    buffer = Buffer(1000, 10.0)
    assert flush(1.0, buffer.unsent, lambda: buffer.t_s, buffer.sleep)
    assert 100.0 <= buffer.t_s < 101.0


def test_flushing_gives_up_when_nothing_moves() -> None:
    buffer = Buffer(1000, 0.0)
    assert not flush(1.0, buffer.unsent, lambda: buffer.t_s, buffer.sleep)
    assert 1.0 <= buffer.t_s < 1.1


def test_there_is_no_log_of_that_name(tmp_path: Path) -> None:
    with pytest.raises(LogError):
        list(replay_messages(lambda: read(tmp_path / "x.mcap"), Window(), Selection()))
