"""A log, as the page's source: it plays, pauses and goes to any time."""

from __future__ import annotations

import time
from bisect import bisect_right
from dataclasses import dataclass, field

import msgspec

from fleet.analysis.recorded_run import RecordedRun
from fleet.faults.plan import plan_json
from fleet.live.source import Change, ChangeOutcome
from fleet.live.view import LINK_WINDOW_NS
from fleet.model.units import to_ns, to_s
from fleet.protocol import codec
from fleet.protocol.codec import decode_clock
from fleet.protocol.messages import Clock, DeliveryReport, Election, StateBroadcast, Truth
from fleet.protocol.topics import CLOCK, SIMULATION, issuer_of
from fleet.simulation.live_feed import (
    EVENTS_KEPT,
    LinkCount,
    LiveFrame,
    NewsFilter,
    ReportedLinks,
    election_key,
)

LINKS_EVERY_NS = 500_000_000
"""Counts of links are kept so often."""
FASTEST_PLAY = 100.0
UNCHANGED = "a log cannot be changed; to fly it again otherwise: 'fleet repeat LOG --loss 30%'"


@dataclass
class Kept:
    """What was on record up to each of some times, in order."""

    times_ns: list[int] = field(default_factory=list)
    what: list[object] = field(default_factory=list)

    def add(self, t_ns: int, what: object) -> None:
        """Something from this time on."""
        self.times_ns.append(t_ns)
        self.what.append(what)

    def at(self, t_ns: int) -> object | None:
        """The last of it by a time."""
        place = bisect_right(self.times_ns, t_ns)
        return self.what[place - 1] if place else None


class LogSource:
    """Implements `fleet.live.source.Source`."""

    recorded = True

    def __init__(self, run: RecordedRun, title: str) -> None:
        self.title = title
        self._run = run
        self._states: dict[tuple[str | int, ...], Kept] = {}
        self._events: list[tuple[int, int, str, bytes]] = []
        self._links, self._grants = Kept(), Kept()
        self._end_ns = 0
        self._read()
        self._t_ns, self._since_s = 0, time.monotonic()
        self._speed, self._paused = 1.0, False

    @property
    def end_s(self) -> float:
        """When the record ends."""
        return to_s(self._end_ns)

    def frame(self, after: int, *, whole: bool = False) -> LiveFrame | None:
        """The frame of the time that it has come to."""
        self._pass()
        t_ns, grant = self._t_ns, self._grants.at(self._t_ns)
        states = [kept.at(t_ns) for kept in self._states.values()]
        clock = grant if isinstance(grant, Clock) else None
        scenario = self._run.scenario
        plan = clock.plan if clock and clock.plan else plan_json(scenario.fault)
        return LiveFrame(
            t_ns // scenario.tick_ns,
            t_ns,
            tuple(state for state in states if isinstance(state, tuple)),
            self._events_at(t_ns, after),
            self._links_at(t_ns),
            plan,
            clock.held if clock else (),
            clock.down if clock else (),
            self._paused,
            self._speed,
            scenario=msgspec.json.encode(scenario).decode() if whole else "",
        )

    def past(self, t_ns: int) -> LiveFrame | None:
        """Where all were at any time."""
        flown = [kept.at(t_ns) for key, kept in self._states.items() if key[0] == Truth.kind]
        states = tuple(state for state in flown if isinstance(state, tuple))
        return LiveFrame(t_ns // self._run.scenario.tick_ns, t_ns, states, (), (), "", (), ())

    def change(self, change: Change) -> ChangeOutcome:
        """Play otherwise; what was flown cannot be changed."""
        if change.faults or change.clear or change.end:
            return ChangeOutcome(good=False, text=UNCHANGED)
        self._pass()
        if change.speed is not None:
            if not 0.0 < change.speed <= FASTEST_PLAY:
                return ChangeOutcome(good=False, text=f"a speed above 0, up to {FASTEST_PLAY:g}")
            self._speed = change.speed
        if change.paused is not None:
            self._paused = change.paused
        step_ns = self._run.scenario.tick_ns * change.steps
        to = None if change.to_s is None else min(max(0.0, change.to_s), self.end_s)
        wanted_ns = self._t_ns if to is None else to_ns(to)
        self._t_ns = min(max(0, wanted_ns + step_ns), self._end_ns)
        return ChangeOutcome(good=True, text="")

    def is_over(self) -> bool:
        """A log is never over: one can go back."""
        return False

    def close(self) -> None:
        """Nothing is open."""

    def _events_at(self, t_ns: int, after: int) -> tuple[tuple[int, str, bytes], ...]:
        """The last events by a time, but those up to a number: no more than of a run."""
        last = bisect_right(self._events, t_ns, key=lambda event: event[0])
        told = self._events[max(0, last - EVENTS_KEPT) : last]
        return tuple(event[1:] for event in told if event[1] > after)

    def _links_at(self, t_ns: int) -> tuple[LinkCount, ...]:
        """What links did up to a time, since the window that is told of began."""
        now, before = self._links.at(t_ns), self._links.at(t_ns - LINK_WINDOW_NS)
        past = {(c.src, c.dst): c for c in before} if isinstance(before, tuple) else {}
        return tuple(_since(c, past) for c in now) if isinstance(now, tuple) else ()

    def _pass(self) -> None:
        """Let time pass."""
        now_s = time.monotonic()
        if not self._paused:
            gone_ns = round(1e9 * (now_s - self._since_s) * self._speed)
            self._t_ns = min(self._end_ns, self._t_ns + gone_ns)
        self._since_s = now_s

    def _read(self) -> None:
        counter, news, next_ns = ReportedLinks(), NewsFilter(), 0
        for record in self._run.records:
            if record.topic == CLOCK:
                self._note_grant(decode_clock(record.payload))
            if issuer_of(record.topic) == SIMULATION:
                continue
            message = codec.decode(record.topic, record.payload)
            t_ns = record.log_ns  # when it was said: in order, whatever its own time
            self._end_ns = max(self._end_ns, t_ns)
            told = record.topic, record.payload
            if isinstance(message, Election):
                rival = message.kind, *election_key(message)
                self._states.setdefault(rival, Kept()).add(t_ns, told)
            match message:
                case Truth() | StateBroadcast():
                    key = message.kind, message.id
                    self._states.setdefault(key, Kept()).add(t_ns, told)
                case DeliveryReport():
                    counter.add(message)
                    if t_ns >= next_ns:
                        next_ns = t_ns + LINKS_EVERY_NS
                        self._links.add(t_ns, counter.counts())
                case _ if news.is_news(message):
                    self._events.append((t_ns, len(self._events) + 1, *told))

    def _note_grant(self, clock: Clock) -> None:
        before = self._grants.what[-1] if self._grants.what else None
        if isinstance(before, Clock):
            plan = clock.plan or before.plan
            if (clock.held, clock.down, plan) == (before.held, before.down, before.plan):
                return
            clock = msgspec.structs.replace(clock, plan=plan)
        self._grants.add(clock.t_ns, clock)


def _since(link: LinkCount, past: dict[tuple[int, int], LinkCount]) -> LinkCount:
    """What came over a link after it had been counted before."""
    before = past.get((link.src, link.dst), LinkCount(link.src, link.dst, 0, 0, 0))
    return LinkCount(
        link.src,
        link.dst,
        link.received - before.received,
        link.lost - before.lost,
        link.latency_ns - before.latency_ns,
    )
