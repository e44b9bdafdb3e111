"""How a UAV takes part in a run: find it, join it, hear and be heard, on either clock.

Written from docs/protocol alone, with nothing but eclipse-zenoh and msgpack.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import queue
import struct
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import msgpack
import zenoh
from link_faults import Links, OnLink, Rule

Message = dict[str, Any]
Sent = tuple[str, Message]
"""Topic without issuer, and message."""
Due = tuple[int, str, Message]
"""Time of delivery in ns, class, message."""
Failed = tuple[str, Message, str]
"""Class, message, and the kind of the fault that kept it away."""

ORDER = "adsb", "heartbeat", "election", "cmd", "ack"
"""Of what one issuer has delivered at one time."""
BROADCAST = "adsb/0", "heartbeat", "election"
"""These do not come back to their issuer."""
FIELDS = {
    "adsb": {"position_ned_m", "equipment"},
    "heartbeat": {"highest_term"},
    "election": {"term", "group", "members", "computing", "valid_until_ns"},
    "cmd": {"target", "term", "number", "issued_ns", "manoeuvre", "heading_rad", "turn_rad"}
    | {"climb_mps", "level_down_m", "start_ns", "manoeuvre_end_ns", "expiry_ns"},
    "ack": {"target", "term", "number", "accepted"},
}
"""What a message needs to be used here, beside its header."""
STOPPED_TICKS = 5
"""In realtime, who is later than this has been stopped, and goes on from now."""

LEAVE_S = 0.5
GOLDEN = 0x9E3779B97F4A7C15
FUTURE_NS = 5_000_000_000
"""What is from so far ahead by the own clock cannot have been sent yet."""


class Uav(Protocol):
    """What takes part."""

    place: list[float]

    def step(self, now_ns: int, inbox: list[Due], failed: list[Failed]) -> list[Sent]:
        """Fly to `now_ns` with what has been delivered; what to send, by topic without issuer."""
        ...


MakeUav = Callable[[int, Message, list[Message]], Uav]


def take_part(endpoint: str, number: int, make: MakeUav) -> None:
    """Be UAV `number` of the run at an endpoint; `make(number, scenario, uavs)` makes it."""
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 60_000,
        "scouting/multicast/enabled": False,
    }.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        run, plan = find_run(session)
        place = Place(session, run, number, plan, make(number, plan["scenario"], plan["uavs"]))
        try:
            place.lockstep() if plan["clock"] == "lockstep" else place.realtime()
        finally:
            place.leave()


def find_run(session: zenoh.Session) -> tuple[str, Message]:
    """Name and plan of the run; waits until there is one."""
    while True:
        for reply in session.get("fleet/*/sim/plan", timeout=1.0):
            if reply.ok is not None:
                return str(reply.ok.key_expr).split("/")[1], json.loads(reply.ok.payload.to_bytes())
        time.sleep(0.05)


class Place:
    """One UAV's place in a run."""

    def __init__(
        self, session: zenoh.Session, run: str, number: int, plan: Message, uav: Uav
    ) -> None:
        scenario = plan["scenario"]
        if scenario["surveillance"]["range_m"] or scenario["coordination"]["range_m"]:
            raise SystemExit("this UAV does not know of cells: it flies without a radio range")
        self.session, self.run, self.number, self.uav = session, run, number, uav
        self.tick_ns: int = round(scenario["tick_s"] * 1e9)
        self.ticks = math.floor(scenario["duration_s"] / scenario["tick_s"] + 1e-9)
        self.issuers = {"coordinator": 0} | {str(u["id"]): u["id"] for u in plan["uavs"]}
        self.heard = ["adsb/0", "heartbeat", "election", f"cmd/{number}", f"ack/{number}"]
        self.declared: list[Any] = []
        self.publishers: dict[str, zenoh.Publisher] = {}
        self.account: dict[str, tuple[int, Any]] = {}
        self.holding: list[Due] = []
        self.failed: list[Failed] = []
        self.timed = False
        self.links = Links([], scenario["seed"], self.tick_ns)
        self.replan(scenario["fault"])

    def replan(self, plan: list[Rule]) -> None:
        """Go by this fault plan from now on; leave if that is not possible."""
        self.links.plan = plan
        self.placed = any(rule["kind"] == "range" for rule in plan)
        if self.links.unable():
            raise SystemExit(f"this UAV cannot apply faults: {', '.join(self.links.unable())}")

    def put(self, suffix: str, message: Message) -> None:
        """Publish, and keep account of it."""
        payload = msgpack.packb(message)
        if suffix not in self.publishers:
            self.publishers[suffix] = self.session.declare_publisher(
                f"fleet/{self.run}/{self.number}/{suffix}",
                congestion_control=zenoh.CongestionControl.BLOCK,
                reliability=zenoh.Reliability.RELIABLE,
            )
        mark = struct.pack("<q", time.time_ns() if self.timed else 0)
        mark += struct.pack("<3d", *self.uav.place) if self.placed else b""
        attachment = mark if self.timed or self.placed else None
        self.publishers[suffix].put(payload, attachment=attachment)
        count, hashed = self.account.get(suffix, (0, hashlib.blake2b(digest_size=8)))
        hashed.update(payload)
        self.account[suffix] = count + 1, hashed

    def done(self, tick: int) -> None:
        """Say that a step is over: what has been sent since the last time, and digests of it."""
        sent = {suffix: count for suffix, (count, _) in self.account.items()}
        digests = {suffix: hashed.hexdigest() for suffix, (_, hashed) in self.account.items()}
        seq = max(tick, 0)
        header = {"id": self.number, "seq": seq, "t_ns": seq * self.tick_ns, "tick": tick}
        self.put("done", {**header, "sent": sent, "digests": digests})
        self.account = {}

    def join(self, handler: Callable[[], Any]) -> list[Any]:
        """Subscribe, announce, say that it is ready: in this order. The clock's comes first."""
        for topic in ["sim/clock", *(f"*/{suffix}" for suffix in self.heard)]:
            own = topic[2:] not in BROADCAST
            origin = zenoh.Locality.ANY if own else zenoh.Locality.REMOTE
            key = f"fleet/{self.run}/{topic}"
            subscriber = self.session.declare_subscriber(key, handler(), allowed_origin=origin)
            self.declared.append(subscriber)
        subscribers, tokens, key = [*self.declared], self.session.liveliness(), f"fleet/{self.run}"
        watch = tokens.declare_subscriber(f"{key}/sim/alive", simulation_gone, history=True)
        self.declared += [watch, tokens.declare_token(f"{key}/{self.number}/alive")]
        self.done(-1)
        return subscribers

    def leave(self) -> None:
        """Undeclare all: what is left open would hang the end of the process."""
        for declared in reversed(self.declared):
            declared.undeclare()

    def message(self, sample: zenoh.Sample) -> tuple[str, Message] | None:
        """Class and message, if it is one that its issuer can have sent; else nobody uses it."""
        issuer, kind, *end = str(sample.key_expr).split("/")[2:]
        try:
            message = msgpack.unpackb(sample.payload.to_bytes())
            good = self.issuers[issuer] == message["id"]
            good = good and (kind != "heartbeat" or message["id"] == 0)
            good = good and message.keys() >= {"seq", "t_ns"} | FIELDS[kind]
            good = good and end in ([], ["0"], [str(message.get("target"))])
            values = [v for v in message.values() if isinstance(v, float)]
            return (kind, message) if good and all(map(math.isfinite, values)) else None
        except (ValueError, LookupError, TypeError, AttributeError):
            return None

    def judge(self, kind: str, message: Message, sample: Any, arrived_ns: int = -1) -> None:
        """Let the fault plan act on a message, and hold it until it is due."""
        bits, mark, distance_m = 8 * len(sample.payload.to_bytes()), sample.attachment, None
        if mark is not None and len(mark.to_bytes()) >= 32:
            distance_m = math.dist(struct.unpack("<3d", mark.to_bytes()[8:32]), self.uav.place)
        header = message["id"], self.number, message["seq"], message["t_ns"]
        fate = self.links.fate(OnLink(kind, *header, bits, distance_m))
        if isinstance(fate, str):
            self.failed.append((kind, message, fate))
            return
        for delay_ns in fate:
            in_lockstep_ns = message["t_ns"] + max(delay_ns, self.tick_ns)
            at_ns = arrived_ns + delay_ns if self.timed else in_lockstep_ns
            self.holding.append((at_ns, kind, message))

    def step(self, tick: int) -> None:
        """Step with all that is due, in an order that does not depend on arrival."""
        now_ns = tick * self.tick_ns
        due = [held for held in self.holding if held[0] <= now_ns]
        self.holding = [held for held in self.holding if held[0] > now_ns]
        due.sort(key=lambda d: (d[0], d[2]["id"], ORDER.index(d[1]), d[2]["seq"]))
        failed, self.failed = self.failed, []
        for suffix, message in self.uav.step(now_ns, due, failed):
            self.put(suffix, message)

    def lockstep(self) -> None:
        """Step when a tick is granted and all has come that its manifest lists."""
        clock, *subscribers = self.join(lambda: zenoh.handlers.FifoChannel(100_000))
        intakes = {
            s: Intake(self, s, each) for s, each in zip(self.heard, subscribers, strict=True)
        }
        last = None
        while True:
            grant = msgpack.unpackb(clock.recv().payload.to_bytes())
            if grant["state"] == "stop":
                return
            if last is not None and grant["tick"] != last + 1:
                continue  # it is not the simulation's
            if grant.get("plan"):
                self.replan(json.loads(grant["plan"]))
            if last is not None:  # with the first grant nothing is for it
                self.take_listed(intakes, grant["expected"])
            last = grant["tick"]
            if self.number not in grant.get("held", ()):
                self.step(last)
                self.done(last)

    def take_listed(self, intakes: dict[str, Intake], expected: Message) -> None:
        """Take what the manifest lists of what this UAV hears, in order of sending."""
        taken = []
        for suffix, listed in expected.items():
            taken += intakes[suffix].take(listed) if suffix in intakes else []
        for each in sorted(taken, key=lambda t: (t[1]["t_ns"], t[1]["id"], t[0], t[1]["seq"])):
            self.judge(*each)

    def realtime(self) -> None:
        """Step on the own wall clock, from the common epoch on."""
        arrivals: queue.SimpleQueue[tuple[int, zenoh.Sample]] = queue.SimpleQueue()
        self.timed, self.lates = True, 0
        self.join(lambda: lambda sample: arrivals.put((time.time_ns(), sample)))
        epoch_ns, tick, early = 0, 0, list[tuple[int, zenoh.Sample]]()
        newest: dict[str, int] = {}
        while tick <= self.ticks:
            due_ns = epoch_ns + tick * self.tick_ns + self.phase_ns(self.number)
            due_ns = due_ns if epoch_ns else 2**62
            try:
                wait_s = (due_ns - time.time_ns()) / 1e9
                early.append(arrivals.get(timeout=min(max(wait_s, 0.0), 1e6)))
            except queue.Empty:
                tick = self.timely(tick, time.time_ns() - due_ns)
                continue
            clock = early.pop()[1] if is_clock(early[-1][1]) else None
            if clock is not None:
                said = msgpack.unpackb(clock.payload.to_bytes())
                if said["state"] == "stop":
                    return
                if said.get("plan"):
                    self.replan(json.loads(said["plan"]))
                if not epoch_ns and said.get("epoch_unix_ns"):
                    epoch_ns = said["epoch_unix_ns"]
                    tick = max(0, -(-(time.time_ns() - epoch_ns) // self.tick_ns))
            if epoch_ns:
                for arrived_ns, sample in early:
                    self.take(sample, max(0, arrived_ns - epoch_ns), newest)
                early = []
        self.done(self.ticks)
        while msgpack.unpackb(arrivals.get()[1].payload.to_bytes()).get("state") != "stop":
            pass

    def take(self, sample: zenoh.Sample, arrived_ns: int, newest: dict[str, int]) -> None:
        """Take a message in realtime, if it is newer than the last one on its topic."""
        found, key = self.message(sample), str(sample.key_expr)
        if not found or found[1]["t_ns"] > arrived_ns + FUTURE_NS:
            return
        if newest.get(key, -1) < found[1]["seq"]:
            newest[key] = found[1]["seq"]
            behind_ns = self.phase_ns(found[1]["id"])
            self.judge(*found, sample, max(0, arrived_ns - behind_ns))

    def phase_ns(self, number: int) -> int:
        """How long after a tick's time a participant steps in realtime."""
        return (number * GOLDEN % 2**64 * (3 * self.tick_ns // 4)) >> 64

    def timely(self, tick: int, behind_ns: int) -> int:
        """Step, and tell if that begins late; returns the tick after it."""
        if behind_ns > STOPPED_TICKS * self.tick_ns:
            tick = min(self.ticks, tick + behind_ns // self.tick_ns)
        self.step(tick)
        if behind_ns > self.tick_ns // 10:
            header = {"id": self.number, "seq": self.lates, "t_ns": tick * self.tick_ns}
            self.put("late", {**header, "late_ns": behind_ns})
            self.lates += 1
        return tick + 1


class Intake:
    """What has come on the topics of one suffix; what is not listed yet waits."""

    def __init__(self, place: Place, suffix: str, subscriber: Any) -> None:
        self.place, self.subscriber = place, subscriber
        self.returns = suffix not in BROADCAST
        self.waiting: dict[tuple[int, int], tuple[str, Message, Any]] = {}

    def take(self, listed: list[list[int]]) -> list[tuple[str, Message, Any]]:
        """All that a manifest lists; waits for it. What does not come back is not waited for."""
        pairs = [(src, seq) for src, seq in listed if self.returns or src != self.place.number]
        while not self.waiting.keys() >= set(pairs):
            sample = self.subscriber.recv()
            found = self.place.message(sample)
            if found:
                kind, message = found
                self.waiting.setdefault((message["id"], message["seq"]), (kind, message, sample))
        return [self.waiting.pop(pair) for pair in pairs]


def is_clock(sample: zenoh.Sample) -> bool:
    """Whether the simulation's clock says something."""
    return str(sample.key_expr).endswith("/sim/clock")


def simulation_gone(token: zenoh.Sample) -> None:
    """Nobody flies on without the simulation; who has been told to stop has time to leave."""
    if token.kind == zenoh.SampleKind.DELETE:
        leaving = threading.Timer(LEAVE_S, os._exit, (4,))
        leaving.daemon = True
        leaving.start()
