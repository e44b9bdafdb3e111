"""The zenoh bus: one process's place in a run.

Everything the lockstep barrier depends on is reliable and blocking; zenoh may batch small messages
(express off), which the barrier gains from. Lockstep takes messages from channels, in exact
numbers; realtime has them stamped on arrival. Callbacks only enqueue: zenoh may run them on
several threads.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Self

import zenoh
from msgspec.structs import replace

from fleet.errors import BusError
from fleet.model.types import Position
from fleet.printing import printable
from fleet.protocol.sample import DELETION, Sample, attachment, sample_of
from fleet.protocol.topics import PLAN, alive, key, topic_in
from fleet.transport.bounded_queue import BoundedQueue
from fleet.transport.zenoh_session import (
    BY_DEFAULT,
    SessionOptions,
    open_client,
    open_router,
    reason_of,
)

CHANNEL_CAPACITY = 16_384
"""So many messages of a topic wait in lockstep; who sends more is held up."""
LEAVE_S = 0.5
"""A participant that has been told to stop has so long to leave when its simulation goes."""
RENEWED_S = 5.0
"""So long a token may be away while there is a router: the link to it, or beyond it, is renewed."""
MOST_SAID = 500
LOST_SIMULATION_EXIT = 4
"""Exit code of a participant whose simulation has gone."""


class NoReplyError(Exception):
    """A question has no answer; the message says why, of whom is asked."""


_RETURN_CHECK_S = 0.05


def _arrival(run: str, sample: zenoh.Sample, now_unix_ns: int = 0) -> Sample:
    payload, mark = sample.payload.to_bytes(), sample.attachment
    if not payload and sample.kind == zenoh.SampleKind.DELETE:  # the kind is dear to ask for
        bare = sample_of(run, str(sample.key_expr), payload, None, now_unix_ns)
        return replace(bare, flaw=bare.flaw or DELETION)
    data = None if mark is None else mark.to_bytes()
    return sample_of(run, str(sample.key_expr), payload, data, now_unix_ns)


def _origin(*, own: bool) -> zenoh.Locality:
    return zenoh.Locality.ANY if own else zenoh.Locality.REMOTE


def _publisher_options() -> dict[str, Any]:
    return {
        "congestion_control": zenoh.CongestionControl.BLOCK,
        "reliability": zenoh.Reliability.RELIABLE,
        "express": False,
    }


class Bus:
    """One process's place in a run: publishes topics, receives those it declared."""

    def __init__(self, session: zenoh.Session, run: str, name: str, router: str = "") -> None:
        """`router` is where a client's router is; without it this process is the router itself."""
        self.run = run
        self.router = router
        self.name = name
        self._session = session
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._channels: dict[str, zenoh.Subscriber[Any]] = {}
        self._stamped: dict[str, zenoh.Subscriber[Any]] = {}
        self._declared: list[Any] = []
        self._tokens: list[Any] = []
        self._closing = threading.Event()
        self._timed = False
        self._queue = BoundedQueue()
        self.before_leaving: Callable[[], None] = lambda: None
        """Called before this process ends at once, for whatever reason."""
        self.unfinished: Callable[[], str] = lambda: ""
        """What this process still waits for, told when it ends at once."""

    def __enter__(self) -> Self:
        """Nothing to do: everything is declared on demand."""
        return self

    def __exit__(self, *_: object) -> None:
        """Undeclare and close."""
        self.close()

    def close(self) -> None:
        """Undeclare everything (an open callback subscriber would hang the exit) and close."""
        self._closing.set()
        self.retire()
        subscribers = (*self._channels.values(), *self._stamped.values())
        for declared in [*self._declared, *subscribers, *self._publishers.values()]:
            declared.undeclare()
        self._declared.clear()
        self._channels.clear()
        self._stamped.clear()
        self._publishers.clear()
        self._session.close()

    def put(
        self, topic: str, payload: bytes, place: Position | None = None, *, round_ns: int = 0
    ) -> None:
        """Publish; blocks while the network is congested, never drops."""
        publisher = self._publishers.get(topic)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key(self.run, topic), **_publisher_options()
            )
            self._publishers[topic] = publisher
        mark = attachment(time.time_ns() if self._timed else 0, place, round_ns)
        if mark is None:
            publisher.put(payload)
        else:
            publisher.put(payload, attachment=mark)

    def listen(self, topic: str, *, own: bool = True) -> None:
        """Receive a topic (key expression) through a channel of its own, by `take`.

        Without `own`, what this process publishes does not come back to it.
        """
        self._channels[topic] = self._session.declare_subscriber(
            key(self.run, topic),
            zenoh.handlers.FifoChannel(CHANNEL_CAPACITY),
            allowed_origin=_origin(own=own),
        )

    def take(self, topic: str) -> Sample:
        """The next message of a topic given to `listen`; waits for it."""
        return _arrival(self.run, self._channels[topic].recv())

    def waiting(self, topic: str) -> Iterator[Sample]:
        """What has come of a topic given to `listen`, as long as there is any."""
        while (sample := self._channels[topic].try_recv()) is not None:
            yield _arrival(self.run, sample)

    def stamp(self, topic: str, *, own: bool = True, marking: bool = True) -> None:
        """Receive a topic with times of arrival, by `next_before`; `own` as in `listen`.

        From now on this process marks what it publishes with the time of publication, if `marking`.
        """
        run, put = self.run, self._queue.put
        self._timed = self._timed or marking

        def enqueue(sample: zenoh.Sample) -> None:
            put(_arrival(run, sample, time.time_ns()))

        self._stamped[topic] = self._session.declare_subscriber(
            key(run, topic), enqueue, allowed_origin=_origin(own=own)
        )

    def leave(self, topic: str) -> None:
        """Receive no more of a topic given to `listen` or `stamp`."""
        for subscribers in (self._channels, self._stamped):
            subscriber = subscribers.pop(topic, None)
            if subscriber is not None:
                subscriber.undeclare()

    def retract(self, end: str) -> None:
        """Publish no more on topics that end so, for now: many would pile up in a long flight."""
        for topic in [t for t in self._publishers if t.endswith(f"/{end}")]:
            self._publishers.pop(topic).undeclare()

    def next_before(self, deadline_unix_ns: int) -> Sample | None:
        """The next stamped message, or None once the wall clock has passed the deadline.

        Raises:
            FleetStoppedError: more has come than there is room for.

        """
        return self._queue.get((deadline_unix_ns - time.time_ns()) / 1e9)

    @staticmethod
    def stopwatch_ns() -> int:
        """A time by which it can be measured how long something takes."""
        return time.perf_counter_ns()

    def now_unix_ns(self) -> int:
        """The wall clock, the same that stamps arrivals."""
        return time.time_ns()

    def has_router(self) -> bool:
        """Whether there is a router, of this process or of others: else what is put is lost."""
        return not self.router or bool(self._session.info.routers_zid())

    def router_answers(self, timeout_s: float) -> bool:
        """Whether a router says something when it is asked."""
        replies = self._session.get("@/*/router", timeout=timeout_s)
        return any(reply.ok is not None for reply in replies)

    def is_alive(self, name: str) -> bool:
        """Whether a process of the run has its token declared."""
        replies = self._session.liveliness().get(key(self.run, alive(name)), timeout=5.0)
        return any(reply.ok is not None for reply in replies)

    def announce(self) -> None:
        """Declare this process's liveliness token."""
        token = self._session.liveliness().declare_token(key(self.run, alive(self.name)))
        self._tokens.append(token)

    def retire(self) -> None:
        """Withdraw the token: whoever cannot go on without this process ends."""
        for token in self._tokens:
            token.undeclare()
        self._tokens.clear()

    def end_without(self, name: str, *, patience_s: float = 0.0, silently: bool = False) -> None:
        """End this process when another one's token vanishes, unless it is leaving anyway.

        If it is the router that has gone, both may come back within `patience_s`. And tokens vanish
        for a moment where a link is renewed: they have as long to come back, up to `RENEWED_S`.
        """
        there = threading.Event()

        def end() -> None:
            if self._closing.wait(LEAVE_S):
                return
            lost = not self.has_router()
            if self._returned(there, patience_s if lost else min(patience_s, RENEWED_S)):
                return
            self._leave(
                f"the zenoh router at {self.router} has gone" if lost else f"{name} has gone",
                silently=silently,
            )

        def check(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.DELETE:
                there.set()
                return
            there.clear()
            threading.Thread(target=end, name=f"without {name}", daemon=True).start()

        watch = self._session.liveliness().declare_subscriber(
            key(self.run, alive(name)), check, history=True
        )
        self._declared.append(watch)

    def _returned(self, there: threading.Event, patience_s: float) -> bool:
        """Whether somebody is there again within the time, or this process is leaving."""
        deadline_s = time.monotonic() + patience_s
        while not (there.wait(_RETURN_CHECK_S) or self._closing.is_set()):
            if time.monotonic() >= deadline_s:
                return False
        return True

    def end_on(self, topic: str) -> None:
        """End this process when a reason for that is published on a topic, and say it."""

        def end(sample: zenoh.Sample) -> None:
            why = sample.payload.to_bytes()[:MOST_SAID].decode(errors="replace")
            self._leave(printable(why), silently=False)

        watch = self._session.declare_subscriber(key(self.run, topic), end)
        self._declared.append(watch)

    def _leave(self, why: str, *, silently: bool) -> None:
        if not silently:
            waiting = self.unfinished()
            more = f"; {waiting}" if waiting else ""
            sys.stderr.write(f"fleet: process {self.name} ends: {why}{more}\n")
            sys.stderr.flush()
        self.before_leaving()
        os._exit(LOST_SIMULATION_EXIT)

    def watch(
        self, lost: Callable[[str], None], back: Callable[[str], None] = lambda _: None
    ) -> None:
        """Call these with the name of every process of the run whose token vanishes, or comes."""

        def check(sample: zenoh.Sample) -> None:
            call = lost if sample.kind == zenoh.SampleKind.DELETE else back
            call(topic_in(self.run, str(sample.key_expr)).partition("/")[0])

        watch = self._session.liveliness().declare_subscriber(key(self.run, alive("*")), check)
        self._declared.append(watch)

    def offer_plan(self, plan: Callable[[], bytes]) -> None:
        """Answer the question for the plan of this run, as it is by then."""
        own = key(self.run, PLAN)
        self._declared.append(
            self._session.declare_queryable(own, lambda query: query.reply(own, plan()))
        )

    def answer(self, topic: str, take: Callable[[bytes, Callable[[bytes], None]], None]) -> None:
        """Take questions on a topic: `take(payload, reply)` is called on a thread of zenoh's."""
        own = key(self.run, topic)

        def handle(query: zenoh.Query) -> None:
            payload = query.payload.to_bytes() if query.payload is not None else b""

            def reply(answer: bytes) -> None:
                query.reply(own, answer)
                query.drop()

            take(payload, reply)

        self._declared.append(self._session.declare_queryable(own, handle))

    def ask(self, topic: str, payload: bytes, timeout_s: float) -> bytes | None:
        """The answer to a question on a topic; None if there is none in time.

        Raises:
            BusError: the session has ended.
        """
        try:
            replies = self._session.get(key(self.run, topic), payload=payload, timeout=timeout_s)
        except zenoh.ZError as error:
            raise BusError(
                f"run {self.run} can no longer be asked ({reason_of(str(error))})"
            ) from error
        good = (reply.ok for reply in replies if reply.ok is not None)
        answer = next(good, None)
        return None if answer is None else answer.payload.to_bytes()

    def question(
        self, topic: str, payload: bytes, timeout_s: float, *, wait_s: float = 0.0
    ) -> bytes | None:
        """The answer of the one process that takes questions on a topic.

        None: nobody has been there within `wait_s`.

        Raises:
            NoReplyError: somebody is there, and does not answer in time; or several are.

        """
        deadline_s = time.monotonic() + wait_s
        while not (replies := self._replies(topic, payload, timeout_s)):
            if time.monotonic() >= deadline_s:
                return None
            time.sleep(_RETURN_CHECK_S)
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        if len(answers) > 1:  # errors do not count: a time-out may be told twice
            raise NoReplyError("is there more than once; end all but one")
        if not answers:
            raise NoReplyError(f"has not answered for {timeout_s:g} s")
        return answers[0]

    def _replies(self, topic: str, payload: bytes, timeout_s: float) -> list[zenoh.Reply]:
        every = zenoh.ConsolidationMode.NONE
        return [
            *self._session.get(
                key(self.run, topic), payload=payload, timeout=timeout_s, consolidation=every
            )
        ]

    def ask_all(self, topics: str, timeout_s: float) -> dict[str, bytes]:
        """Answers to a question on topics (a key expression), by topic."""
        return {topic: answer for topic, answer, _ in self.answers(topics, timeout_s)}

    def answers(self, topics: str, timeout_s: float) -> Iterator[tuple[str, bytes, int]]:
        """The same one by one as they come: topic, answer, Unix time in ns."""
        for reply in self._session.get(key(self.run, topics), timeout=timeout_s):
            came_ns = time.time_ns()
            if reply.ok is not None:
                topic = topic_in(self.run, str(reply.ok.key_expr))
                yield topic, reply.ok.payload.to_bytes(), came_ns

    def declared(self, kind: str, timeout_s: float) -> dict[str, set[str]]:
        """What the routers know to be declared in this run: sessions by topic.

        `kind` is subscriber, queryable or token.
        """
        begin = f"/router/{kind}/{key(self.run, '')}"
        out: dict[str, set[str]] = {}
        for reply in self._session.get(f"@/*{begin}**", timeout=timeout_s):
            if reply.ok is not None:
                sources = json.loads(reply.ok.payload.to_string())
                topic = str(reply.ok.key_expr).partition(begin)[2]
                out.setdefault(topic, set()).update(sources["clients"])
        return out


def open_router_bus(
    run: str,
    name: str,
    endpoint: str,
    secured: Mapping[str, Any] | None = None,
    zenoh_config: str = "",
) -> tuple[Bus, str]:
    """The bus of a process that is the run's router too, and its endpoint."""
    session, where = open_router(endpoint, secured=secured, zenoh_config=zenoh_config)
    return Bus(session, run, name), where


def open_client_bus(
    run: str,
    name: str,
    endpoint: str,
    timeout_s: float = 60.0,
    options: SessionOptions = BY_DEFAULT,
) -> Bus:
    """The bus of a process that connects to a router."""
    return Bus(open_client(endpoint, timeout_s, options), run, name, endpoint)
