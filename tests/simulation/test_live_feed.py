"""What a run tells those who look: whatever they ask, and however often, it goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from fleet.protocol import codec
from fleet.protocol.messages import DeliveryReport, Election
from fleet.simulation.live_feed import (
    MOST_LATENCY_NS,
    QUESTIONS_KEPT,
    UNWATCHED_S,
    LinkCount,
    LiveFeed,
    LiveFrame,
    ReportedLinks,
    ViewRequest,
)

REPORT = DeliveryReport(3, 0, 0, (1,), ("adsb",), (0,), (10,), (20,), ("received",))


class Viewers:
    """Stand in for the bus: hand on what is asked."""

    def __init__(self, feed: LiveFeed) -> None:
        feed.listen(self)  # type: ignore[arg-type]

    def answer(self, _topic: str, take: Callable[[bytes, Callable[[bytes], None]], None]) -> None:
        self._take = take

    def ask(self, request: bytes, reply: Callable[[bytes], None]) -> None:
        self._take(request, reply)


def frame(
    states: tuple[Any, ...], events: tuple[Any, ...], links: tuple[LinkCount, ...], *, whole: bool
) -> LiveFrame:
    return LiveFrame(7, 7, states, events, links, "", (), (), scenario="{}" if whole else "")


@pytest.mark.parametrize(
    "nonsense", [b"", b"\xff", b"\x81\xa5after\xa1x", b"\x81\xa1x" + b"\x91" * 100_000 + b"\xc0"]
)
def test_a_question_that_is_not_understood_breaks_nothing(nonsense: bytes) -> None:
    feed = LiveFeed()
    answers: list[bytes] = []
    Viewers(feed).ask(nonsense, answers.append)
    feed.serve(frame)
    assert [msgspec.msgpack.decode(a, type=LiveFrame).tick for a in answers] == [7]


def test_a_flood_of_questions_holds_no_tick_up() -> None:
    feed = LiveFeed()
    viewers, request = Viewers(feed), msgspec.msgpack.encode(ViewRequest())
    answers: list[bytes] = []

    def asks_again(answer: bytes) -> None:
        answers.append(answer)
        if len(answers) < 1000:
            viewers.ask(request, asks_again)

    for _ in range(10 * QUESTIONS_KEPT):
        viewers.ask(request, asks_again)
    feed.serve(frame)
    assert len(answers) == QUESTIONS_KEPT
    assert feed.lacked_room == 9 * QUESTIONS_KEPT


def test_links_are_counted_in_every_tick_while_somebody_looks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 100.0
    monkeypatch.setattr("fleet.simulation.live_feed.time.monotonic", lambda: now_s)
    feed, answers = LiveFeed(), list[bytes]()
    viewers, request = Viewers(feed), msgspec.msgpack.encode(ViewRequest())

    def fly(ticks: int) -> None:
        for _ in range(ticks):
            feed.add(("3/delivery", b"", REPORT))
            feed.serve(frame)

    def received() -> int:
        viewers.ask(request, answers.append)
        feed.serve(frame)
        links = msgspec.msgpack.decode(answers[-1], type=LiveFrame).links
        return sum(link.received for link in links)

    fly(5)
    assert received() == 0  # nobody has looked
    fly(500)  # fast lockstep, between two questions
    assert received() == 500
    now_s += UNWATCHED_S
    fly(7)  # the first of these ends it
    now_s += UNWATCHED_S
    assert received() == 501


def test_absurd_times_in_a_report_do_not_keep_others_from_looking() -> None:
    """What is reported is added up, and must fit into a frame."""
    feed = LiveFeed()
    viewers, answers = Viewers(feed), list[bytes]()
    viewers.ask(msgspec.msgpack.encode(ViewRequest()), answers.append)
    feed.serve(frame)
    late_ns = (2**63 - 1,) * 3
    report = DeliveryReport(
        1, 0, 0, (2,) * 3, ("cmd",) * 3, (0, 1, 2), (0,) * 3, late_ns, ("",) * 3
    )
    feed.add(("1/delivery", b"", report))
    viewers.ask(msgspec.msgpack.encode(ViewRequest()), answers.append)
    feed.serve(frame)
    shown = msgspec.msgpack.decode(answers[1], type=LiveFrame)
    assert [(link.received, link.latency_ns) for link in shown.links] == [(3, MOST_LATENCY_NS)]


def test_rivals_for_the_same_group_are_all_told_and_each_is_news_once() -> None:
    feed, answers = LiveFeed(), list[bytes]()
    for n in range(5):
        for uav, term in ((1, 1), (3, 3)):
            until_ns = (n + 2) * 10**9
            said = Election(uav, n, n * 10**9, term, 1, (1, 2, 3, 4), uav, until_ns)
            feed.add((f"{uav}/election", codec.encode(said), said))
    Viewers(feed).ask(msgspec.msgpack.encode(ViewRequest()), answers.append)
    feed.serve(frame)
    shown = msgspec.msgpack.decode(answers[0], type=LiveFrame)
    newest = [codec.decode(*state) for state in shown.states]
    assert [(m.id, m.seq) for m in newest] == [(1, 4), (3, 4)]
    assert [event[1] for event in shown.events] == ["1/election", "3/election"]


def test_what_one_sends_to_oneself_is_on_no_link() -> None:
    links = ReportedLinks()
    kinds = ("adsb", "adsb", "cmd")
    both = DeliveryReport(3, 0, 0, (1, 2, 3), kinds, (0, 0, 0), (1, 1, 1), (2, 2, 2), ("",) * 3)
    links.add(both)
    assert [(link.src, link.dst) for link in links.counts()] == [(1, 3), (2, 3)]
