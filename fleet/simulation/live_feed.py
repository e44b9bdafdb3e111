"""What whoever watches a run over the bus is shown: the newest states, and what has been said.

A viewer asks for it, as often as it can draw; who asks seldom misses frames, never what was said.
Nobody's asking costs nothing, and nobody can hold a run up.
"""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable

import msgspec
from msgspec import Struct

from fleet.faults.plan import plan_of
from fleet.protocol import codec
from fleet.protocol.messages import (
    Ack,
    Command,
    DeliveryReport,
    Election,
    Message,
    StateBroadcast,
    Truth,
)
from fleet.protocol.topics import VIEW
from fleet.transport.interface import ReceivedMessage
from fleet.transport.zenoh_bus import Bus

EVENTS_KEPT = 1000
"""So many events are kept for those who ask late."""
QUESTIONS_KEPT = 16
"""So many questions wait for the end of a tick; who asks then is not answered, and asks again."""
MOST_LATENCY_NS = 2**62
"""Reports may tell of any times; more than this is not told of a link."""
UNWATCHED_S = 10.0
"""When nobody has asked for so long, by the wall clock, links are no longer counted.

However many ticks pass between two questions of somebody who looks, none is left out.
"""


class ViewRequest(Struct, frozen=True):
    """What a viewer has already: all events up to this number; not the scenario if `whole`."""

    after: int = 0
    whole: bool = False


class LinkCount(Struct, frozen=True, array_like=True):
    """What came over a link since somebody has been watching."""

    src: int
    dst: int
    received: int
    lost: int
    latency_ns: int
    """Of all that was received together."""


class LiveFrame(Struct, frozen=True):
    """A moment of a run, as a viewer is shown it.

    `states` are topic and payload of the newest true state and broadcast of each UAV, and of the
    newest election of each group by each elector for each computing UAV: rivals are all told.
    `events` number, topic and payload of elections, commands and answers. `plan` is the fault plan,
    as JSON; `held` and `down` are processes that are stopped and dead. `speed` 0: as fast as it
    goes.
    """

    tick: int
    t_ns: int
    states: tuple[tuple[str, bytes], ...]
    events: tuple[tuple[int, str, bytes], ...]
    links: tuple[LinkCount, ...]
    plan: str
    held: tuple[int, ...]
    down: tuple[int, ...]
    paused: bool = False
    speed: float = 0.0
    paced: bool = True
    """Whether it can be paused; realtime cannot."""
    scenario: str = ""
    """As JSON, where it was asked for."""


def view_frame_of(reply: bytes) -> LiveFrame | None:
    """The frame of a reply, which anybody on the bus can have given; None if it is none.

    Whatever a viewer draws of it can be read.
    """
    try:
        frame = msgspec.msgpack.decode(reply, type=LiveFrame)
        for topic, payload in (*frame.states, *(event[1:] for event in frame.events)):
            codec.decode(topic, payload)
        plan_of(frame.plan or "[]")
    except (ValueError, RecursionError):
        return None
    return frame


class ReportedLinks:
    """Counts what came over each link, from delivery reports."""

    def __init__(self) -> None:
        self._counts: dict[tuple[int, int], list[int]] = {}

    def add(self, report: DeliveryReport) -> None:
        """Count what one report tells."""
        columns = report.src, report.sent_ns, report.delivered_ns
        for src, sent_ns, delivered_ns in zip(*columns, strict=True):
            if src == report.id:
                continue  # what one sends to oneself is on no link
            link = self._counts.setdefault((src, report.id), [0, 0, 0])
            if delivered_ns:
                link[0] += 1
                link[2] += delivered_ns - sent_ns
            else:
                link[1] += 1

    def counts(self) -> tuple[LinkCount, ...]:
        """What has come so far, in order of links."""
        out = []
        for link in sorted(self._counts):
            received, lost, latency_ns = self._counts[link]
            told_ns = min(max(latency_ns, -MOST_LATENCY_NS), MOST_LATENCY_NS)
            out.append(LinkCount(*link, received, lost, told_ns))
        return tuple(out)


def election_key(election: Election) -> tuple[int, int, int]:
    """What of an election a later one must share to take its place; a rival's does not."""
    return election.group, election.id, election.computing


class NewsFilter:
    """Tells what is said for the first time; elections are repeated while a group lasts."""

    def __init__(self) -> None:
        self._terms: dict[tuple[int, int, int], int] = {}

    def is_news(self, message: Message) -> bool:
        """Whether a message is an event that has not been told."""
        if isinstance(message, Election):
            key = election_key(message)  # rivals repeat theirs in turn
            known = self._terms.get(key)
            self._terms[key] = message.term
            return known != message.term
        return isinstance(message, Command | Ack)


class LiveFeed:
    """Keeps what viewers may ask for, and answers them when the conductor has time."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[bytes, Callable[[bytes], None]]] = (
            queue.SimpleQueue()
        )
        self._states: dict[tuple[str | int, ...], tuple[str, bytes]] = {}
        self._events: deque[tuple[int, str, bytes]] = deque(maxlen=EVENTS_KEPT)
        self._said = 0
        self.lacked_room = 0
        self._news = NewsFilter()
        self._links = ReportedLinks()
        self._watched_until_s = 0.0
        self._watched = False

    def listen(self, bus: Bus) -> None:
        """Take questions from now on."""
        bus.answer(VIEW, self._take)

    def _take(self, payload: bytes, reply: Callable[[bytes], None]) -> None:
        """Let a question wait, if there is room."""
        if self._waiting.qsize() < QUESTIONS_KEPT:
            self._waiting.put((payload, reply))
        else:
            self.lacked_room += 1

    def add(self, item: ReceivedMessage) -> None:
        """Take in a message of the run."""
        topic, payload, message = item
        if isinstance(message, Election):
            self._states[message.kind, *election_key(message)] = topic, payload
        match message:
            case Truth() | StateBroadcast():
                self._states[message.kind, message.id] = topic, payload
            case Election() | Command() | Ack() if self._news.is_news(message):
                self._said += 1
                self._events.append((self._said, topic, payload))
            case DeliveryReport() if self._watched:
                self._links.add(message)

    def serve(self, frame: Callable[..., LiveFrame]) -> None:
        """Answer all who have asked by now; `frame` makes one of states, events and links."""
        now_s = time.monotonic()
        for _ in range(self._waiting.qsize()):
            payload, reply = self._waiting.get()
            try:
                request = msgspec.msgpack.decode(payload, type=ViewRequest)
            except (ValueError, RecursionError):
                request = ViewRequest()
            self._watched_until_s = now_s + UNWATCHED_S
            events = tuple(event for event in self._events if event[0] > request.after)
            states = tuple(self._states.values())
            shown = frame(states, events, self._links.counts(), whole=request.whole)
            reply(msgspec.msgpack.encode(shown))
        self._watched = now_s < self._watched_until_s
