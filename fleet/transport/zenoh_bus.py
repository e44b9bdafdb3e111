"""The zenoh bus: the one module that imports zenoh.

Everything the lockstep barrier depends on is reliable and blocking; zenoh may batch small messages
(express off), which the barrier gains from. Lockstep takes messages from channels, in exact
numbers; realtime has them stamped on arrival. Callbacks only enqueue: zenoh may run them on
several threads.
"""

from __future__ import annotations

import json
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import zenoh
from msgspec.structs import replace

from fleet.errors import BusError
from fleet.model.types import Position
from fleet.printing import printable
from fleet.protocol.sample import DELETION, Sample, attachment, sample_of
from fleet.protocol.topics import PLAN, alive, key, topic_in
from fleet.security.handshake import why_no_link
from fleet.security.identity import Identity
from fleet.security.links import LONGEST_MESSAGE_BYTES, client_settings, tls_endpoint
from fleet.transport.bounded_queue import BoundedQueue
from fleet.transport.zenoh_config import ZenohTable, laid_below, zenoh_file_text

CHANNEL_CAPACITY = 16_384
"""So many messages of a topic wait in lockstep; who sends more is held up."""
LEASE_S = 60.0
"""How long a link may be silent before it counts as lost, unless the run says otherwise."""
BEFORE_PROBE_S = 3.0
"""When a router has not answered for so long, it is looked into why."""
LEAVE_S = 0.5
"""A participant that has been told to stop has so long to leave when its simulation goes."""
MOST_SAID = 500
LOST_SIMULATION_EXIT = 4
"""Exit code of a participant whose simulation has gone."""


@dataclass(frozen=True)
class SessionOptions:
    """How a client opens its session: who it is, and how long it holds on to its link.

    With an identity the link is mutual TLS. `zenoh_config` is a file of zenoh's own configuration.
    The router ends a link that has been silent for longer than its lease; a session ends it itself
    when it could not get rid of a message for `patience_s`, and connects again.
    """

    identity: Identity | None = None
    zenoh_config: str = ""
    lease_s: float = LEASE_S
    patience_s: float = 5.0


BY_DEFAULT = SessionOptions()

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    # 64 B to 1 kB payloads gain nothing from it, and its counters limit the number of sessions.
    "transport/shared_memory/enabled": False,
    "transport/link/rx/max_message_size": LONGEST_MESSAGE_BYTES,
    # What is published while a link is silent waits here: about 1 MB, and nothing is lost of it.
    "transport/link/tx/queue/size/data": 16,
}
_ROUTER: dict[str, Any] = {
    "mode": "router",
    "adminspace/enabled": True,
    # Hundreds of UAVs connect at the same moment.
    "transport/unicast/accept_pending": 10_000,
    "transport/unicast/max_sessions": 10_000,
    "transport/unicast/accept_timeout": 60_000,
}
_PATIENCE = "transport/link/tx/queue/congestion_control/block/wait_before_close"
_LEASE = "transport/link/tx/lease"
_CONNECT_TIMEOUT = "connect/timeout_ms"
_RETURN_CHECK_S = 0.05
_CLIENT: dict[str, Any] = {
    "mode": "client",
    "listen/endpoints": [],
    "transport/unicast/open_timeout": 60_000,
    "connect/retry": {
        "period_init_ms": 100,
        "period_max_ms": 200,
        "period_increase_factor": 1.5,
    },
}


def _arrival(run: str, sample: zenoh.Sample, now_unix_ns: int = 0) -> Sample:
    payload, mark = sample.payload.to_bytes(), sample.attachment
    if not payload and sample.kind == zenoh.SampleKind.DELETE:  # the kind is dear to ask for
        bare = sample_of(run, str(sample.key_expr), payload, None, now_unix_ns)
        return replace(bare, flaw=bare.flaw or DELETION)
    data = None if mark is None else mark.to_bytes()
    return sample_of(run, str(sample.key_expr), payload, data, now_unix_ns)


def _config(settings: dict[str, Any], file: str) -> zenoh.Config:
    own = {**_COMMON, **settings}
    return zenoh.Config.from_json5(json.dumps(laid_below(own, _file_table(file), file)))


def _file_table(file: str) -> ZenohTable:
    """The table in a file of zenoh's configuration; none without a file."""
    if not file:
        return {}
    text = zenoh_file_text(file)
    try:
        reader = zenoh.Config()
        reader.insert_json5("metadata", text)  # where anything may stand
        table = json.loads(reader.get_json("metadata"))
        if not isinstance(table, dict):
            raise BusError(f"--zenoh-config {file}: no table; write {{ key: value }}")
        zenoh.Config.from_json5(text)  # what it does not know it names
    except zenoh.ZError as error:
        raise BusError(f"--zenoh-config {file}: {_flaw(str(error))}") from error
    return table


def _flaw(error: str) -> str:
    """What zenoh does not like in a file, in a line."""
    place, wanted = re.search(r"--> (\d+):(\d+)", error), re.search(r" = ([^\"\\\n]+)", error)
    if place and wanted:
        return f"line {place[1]}, column {place[2]}: {wanted[1]}"
    return printable(error.split(" at /", maxsplit=1)[0].partition(", expected one of")[0])[:200]


def check_zenoh_config(options: SessionOptions) -> None:
    """Whether clients may have that file, before any of them is started; raises BusError."""
    _config(_client_settings("tcp/localhost:0", options), options.zenoh_config)


def _open(settings: dict[str, Any], endpoint: str, failure: str, file: str) -> zenoh.Session:
    _check_endpoint(endpoint)
    try:
        return zenoh.open(_config(settings, file))
    except zenoh.ZError as error:
        raise BusError(f"{failure} ({_reason(str(error))})") from error


def _check_endpoint(endpoint: str) -> None:
    if not re.fullmatch(r"[a-z0-9-]+/\S+", endpoint):
        raise BusError(
            f"'{endpoint}' is no endpoint; write PROTOCOL/ADDRESS, as tcp/127.0.0.1:7447"
        )


def _reason(error: str) -> str:
    """The part of zenoh's message that says why: it adds the whole way through its sources."""
    for known in ("Address already in use", "invalid port", "Cannot assign", "Timeout"):
        if known.lower() in error.lower():
            return known.lower()
    return error.split(" at /", maxsplit=1)[0][:120]


def open_router(
    endpoint: str,
    patience_s: float = 0.2,
    lease_s: float = LEASE_S,
    secured: Mapping[str, Any] | None = None,
    zenoh_config: str = "",
    links: Sequence[str] = (),
) -> tuple[zenoh.Session, str]:
    """A router-mode session listening on `endpoint` (port 0: any free one), and where it listens.

    A receiver that takes nothing holds everybody up for `patience_s` before it is disconnected.
    `secured` are settings for TLS and access control (`fleet.security.links.router_settings`).
    Clients hold on to a router that has been silent for up to its lease. `zenoh_config` is a file
    of zenoh's own configuration. `links` are the endpoints of other routers: it connects to them,
    again and again until they are there, and what is said at one is heard at all.

    Raises:
        BusError: an endpoint is malformed or taken, or the file is no good.

    """
    if secured:
        endpoint, links = tls_endpoint(endpoint), [tls_endpoint(link) for link in links]
    for link in links:
        _check_endpoint(link)
    failure = f"cannot listen on {endpoint}; choose another endpoint, or port 0 for any free one"
    own = {
        "listen/endpoints": [endpoint],
        _PATIENCE: round(1e6 * patience_s),
        _LEASE: round(1e3 * lease_s),
        **({"connect/endpoints": [*links]} if links else {}),
        **(secured or {}),
    }
    session = _open({**_ROUTER, **own}, endpoint, failure, zenoh_config)
    replies = session.get(f"@/{session.zid()}/router")
    for reply in replies:
        if reply.ok is not None:
            told = json.loads(reply.ok.payload.to_string())["locators"]
            if told or not endpoint.endswith(":0"):
                return session, str((told or [endpoint])[0])  # over ws/ it tells of none
    session.close()
    raise BusError(
        f"cannot listen on {endpoint}: the router does not say which port it took; choose one"
    )


def open_client(
    endpoint: str, timeout_s: float, options: SessionOptions = BY_DEFAULT
) -> zenoh.Session:
    """A client session to the router at `endpoint`; waits for it up to the time-out.

    Raises:
        BusError: the endpoint or the file of zenoh's is no good, or no router answers there.

    """
    if options.identity is not None:
        endpoint = tls_endpoint(endpoint)
    settings, file = _client_settings(endpoint, options), options.zenoh_config
    failure = (
        f"no zenoh router answers at {endpoint} within {timeout_s:g} s; start one there "
        "('fleet router'), or mend the endpoint"
    )

    def opened(within_s: float) -> zenoh.Session:
        limit = {_CONNECT_TIMEOUT: round(1000 * within_s)}
        return _open({**settings, **limit}, endpoint, failure, file)

    first_s = min(timeout_s, BEFORE_PROBE_S)
    try:
        return opened(first_s)
    except BusError as error:
        why = why_no_link(endpoint, options.identity)
        if why:
            raise BusError(why) from error
        if first_s == timeout_s:
            raise
    return opened(timeout_s - first_s)


def _client_settings(endpoint: str, options: SessionOptions) -> dict[str, Any]:
    secured = {} if options.identity is None else client_settings(options.identity)
    return {
        **_CLIENT,
        _LEASE: round(1e3 * options.lease_s),
        _PATIENCE: round(1e6 * options.patience_s),
        **secured,
        "connect/endpoints": [endpoint],
        _CONNECT_TIMEOUT: 60_000,
    }


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

        If it is the router that has gone, both may come back within `patience_s`.
        """
        there = threading.Event()

        def end() -> None:
            if self._closing.wait(LEAVE_S):
                return
            lost = not self.has_router()
            if lost and self._returned(there, patience_s):
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
            threading.Thread(target=end, daemon=True).start()

        watch = self._session.liveliness().declare_subscriber(
            key(self.run, alive(name)), check, history=True
        )
        self._declared.append(watch)

    def _returned(self, there: threading.Event, patience_s: float) -> bool:
        """Whether somebody is there again within the time, or this process is leaving."""
        deadline_s = time.monotonic() + patience_s
        while time.monotonic() < deadline_s:
            if there.wait(_RETURN_CHECK_S) or self._closing.is_set():
                return True
        return False

    def end_on(self, topic: str) -> None:
        """End this process when a reason for that is published on a topic, and say it."""

        def end(sample: zenoh.Sample) -> None:
            why = sample.payload.to_bytes()[:MOST_SAID].decode(errors="replace")
            self._leave(printable(why), silently=False)

        watch = self._session.declare_subscriber(key(self.run, topic), end)
        self._declared.append(watch)

    def _leave(self, why: str, *, silently: bool) -> None:
        if not silently:
            sys.stderr.write(f"fleet: process {self.name} ends: {why}\n")
            sys.stderr.flush()
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
                f"run {self.run} can no longer be asked ({_reason(str(error))})"
            ) from error
        good = (reply.ok for reply in replies if reply.ok is not None)
        answer = next(good, None)
        return None if answer is None else answer.payload.to_bytes()

    def ask_all(self, topics: str, timeout_s: float) -> dict[str, bytes]:
        """Answers to a question on topics (a key expression), by topic."""
        replies = self._session.get(key(self.run, topics), timeout=timeout_s)
        good = [reply.ok for reply in replies if reply.ok is not None]
        return {topic_in(self.run, str(r.key_expr)): r.payload.to_bytes() for r in good}

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


def ask(
    endpoint: str,
    run: str,
    topic: str,
    payload: bytes,
    timeout_s: float,
    options: SessionOptions = BY_DEFAULT,
) -> bytes | None:
    """The answer of a run's simulation to a question; None if there is none in time.

    Raises:
        BusError: no router answers at the endpoint.

    """
    session = open_client(endpoint, timeout_s, options)
    with Bus(session, run, "", endpoint) as bus:
        return bus.ask(topic, payload, timeout_s)


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


def _plans(session: zenoh.Session) -> dict[str, bytes]:
    """The plans of all runs that the router carries, by name."""
    replies = session.get(key("*", PLAN), timeout=1.0)
    good = [reply.ok for reply in replies if reply.ok is not None]
    return {str(r.key_expr).split("/")[1]: r.payload.to_bytes() for r in good}


def find_plan(
    endpoint: str, run: str, timeout_s: float, options: SessionOptions = BY_DEFAULT
) -> tuple[str, bytes]:
    """The name and plan of the run (`*`: the only one) that a router carries; waits for one.

    Raises:
        BusError: no router, no simulation, several runs to choose from, or only others.

    """
    deadline = time.monotonic() + timeout_s
    session = open_client(endpoint, timeout_s, options)
    others: set[str] = set()
    try:
        while time.monotonic() < deadline:
            found = _plans(session)
            if run in found:
                return run, found[run]
            names = ", ".join(map(printable, sorted(found)))
            if run == "*" and len(found) > 1:
                raise BusError(f"several runs at {endpoint}: {names}; choose one with --run")
            if run == "*" and found:
                return found.popitem()
            if others & found.keys():  # asked twice: one that is busy may answer too late
                raise BusError(f"no run '{printable(run)}' at {endpoint}; there: {names}")
            others = set(found)
            time.sleep(0.1)  # no simulation yet: it may start after its UAVs
        raise BusError(f"no run at {endpoint} within {timeout_s:g} s; start 'fleet run' there")
    finally:
        session.close()
