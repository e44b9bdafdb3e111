"""What the page draws of a moment: worked out from frames, without a browser or a bus."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any

import msgspec

from fleet.analysis.palette import ON_WHITE, colour_of
from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.faults.plan import plan_of
from fleet.live.words import said
from fleet.model.conflict.detection import trajectories
from fleet.model.elementary import hypot
from fleet.model.types import Position
from fleet.model.units import to_s
from fleet.model.words import AVOIDING
from fleet.protocol import codec
from fleet.protocol.messages import Election, Message, StateBroadcast, Truth
from fleet.protocol.surveillance import report_of
from fleet.simulation.live_feed import LinkCount, LiveFrame

ViewData = dict[str, Any]
LinkCounts = dict[tuple[int, int], LinkCount]
"""By source and destination."""

EVENTS_SHOWN = 60
NEAREST_SHOWN = 8
GROUPS_SHOWN = 6
"""Those that are over are shown up to so many together; all that are in force are."""
PATH_STEP = 2
"""Of a predicted trajectory every second sample is drawn."""
LINK_WINDOW_NS = 5_000_000_000
"""What links do is told of so long a time."""
LINK_STEP_NS = 100_000_000
"""Counts are kept no more often, however slowly simulated time passes."""


class LiveView:
    """Takes frames of one run in order of time, and makes of each what the page draws."""

    def __init__(
        self, scenario: Scenario, *, recorded: bool = False, warnings: Sequence[str] = ()
    ) -> None:
        """`recorded`: frames are those of a log, which count what links did of late alone.

        `warnings` say what is wrong with it.
        """
        self.scenario, self._recorded = scenario, recorded
        self._warnings = tuple(warnings)
        self._outlook = scenario.outlook()
        self._required, self._ratios = scenario.required(), scenario.zone_ratios()
        self._uavs = uavs_of(scenario)
        self._events: deque[ViewData] = deque(maxlen=EVENTS_SHOWN)
        self._links: deque[tuple[int, LinkCounts]] = deque()
        self.last_event = 0

    def about(self, *, title: str, read_only: bool) -> ViewData:
        """What does not change while a run is shown."""
        s = self.scenario
        return {
            "title": title,
            "scenario": s.name,
            "description": s.description,
            "end_s": s.duration_s,
            "tick_s": s.tick_s,
            "recorded": self._recorded,
            "warnings": list(self._warnings),
            "read_only": read_only,
            "processes": list(participants(s)),
            "pair_colours": ON_WHITE,
            "uavs": [
                {
                    "id": u.id,
                    "colour": colour_of(n),
                    "radius_m": s.zone_of(u.id).radius_m,
                    "half_height_m": s.zone_of(u.id).half_height_m,
                    "route": [u.position_ned_m, *u.waypoints_ned_m],
                }
                for n, u in enumerate(self._uavs)
            ],
        }

    def forget_events(self) -> None:
        """All events come again with each frame of a log."""
        self._events.clear()
        self.last_event = 0

    def take(self, frame: LiveFrame) -> ViewData:
        """What the page draws of a frame."""
        messages = [codec.decode(topic, payload) for topic, payload in frame.states]
        truths = _truths(messages)
        broadcasts = [m for m in messages if isinstance(m, StateBroadcast)]
        self._hear(frame)
        return {
            "t_s": to_s(frame.t_ns),
            "tick": frame.tick,
            "paused": frame.paused,
            "speed": frame.speed,
            "paced": frame.paced,
            "uavs": [_uav(truth) for truth in truths],
            "paths": self._paths(broadcasts, truths, frame.t_ns),
            "pairs": self._pairs([(t.id, t.position_ned_m) for t in truths]),
            "groups": _groups([m for m in messages if isinstance(m, Election)], frame.t_ns),
            "links": self._link_rows(frame),
            "events": list(self._events),
            "rules": rules_in_force(frame),
            "held": list(frame.held),
            "down": list(frame.down),
        }

    def moment(self, frame: LiveFrame) -> ViewData:
        """What the page draws of the past: where each was, and how far pairs were apart."""
        truths = _truths([codec.decode(topic, payload) for topic, payload in frame.states])
        places = [(t.id, t.position_ned_m) for t in truths]
        return {
            "t_s": to_s(frame.t_ns),
            "uavs": [{"id": uav, "ned_m": _rounded(place)} for uav, place in places],
            "pairs": self._pairs(places),
        }

    def _hear(self, frame: LiveFrame) -> None:
        for number, topic, payload in frame.events:
            message = codec.decode(topic, payload)
            self.last_event = max(self.last_event, number)
            kind, text = said(message)
            event = {"n": number, "t_s": to_s(message.t_ns), "kind": kind, "text": text}
            self._events.append(event)

    def _paths(
        self, broadcasts: Sequence[StateBroadcast], truths: Sequence[Truth], now_ns: int
    ) -> dict[str, list[Position]]:
        """What each would fly by its last broadcast; not of those who have none, or are dead."""
        flying = {t.id for t in truths}
        reports = [report_of(m) for m in broadcasts if m.id in flying]
        if not reports:
            return {}
        paths = trajectories(reports, now_ns, self._outlook)[:, ::PATH_STEP]
        return {str(r.id): path.round(1).tolist() for r, path in zip(reports, paths, strict=True)}

    def _pairs(self, places: Sequence[tuple[int, Position]]) -> list[ViewData]:
        """The nearest pairs, by what is required of them."""
        found = []
        for (one, here), (other, there) in combinations(places, 2):
            required = self._ratios.of_pair((one, other), self._required)
            level_m = hypot(here[0] - there[0], here[1] - there[1])
            upright_m = abs(here[2] - there[2])
            apart = max(level_m / required.horizontal_m, upright_m / required.vertical_m)
            found.append({"a": one, "b": other, "apart": round(apart, 3)})
        return sorted(found, key=lambda pair: pair["apart"])[:NEAREST_SHOWN]

    def _link_rows(self, frame: LiveFrame) -> list[list[float]]:
        """Of each link source, destination, share lost, mean latency in s, and how many came."""
        now = {(link.src, link.dst): link for link in frame.links}
        before = {} if self._recorded else self._links_before(frame.t_ns, now)
        return [row for link in now.values() if (row := _link_row(link, before)) is not None]

    def _links_before(self, now_ns: int, now: LinkCounts) -> LinkCounts:
        """What had been counted at the beginning of the time that is told of."""
        if not self._links or now_ns >= self._links[-1][0] + LINK_STEP_NS:
            self._links.append((now_ns, now))
        while len(self._links) > 2 and self._links[1][0] <= now_ns - LINK_WINDOW_NS:
            self._links.popleft()
        return self._links[0][1]


def _groups(elections: Sequence[Election], now_ns: int) -> list[ViewData]:
    """Who computes for whom: every election that is valid, rivals for the same members together.

    The highest term first. After them those of groups that are over, if there is room.
    """
    by_members: dict[tuple[int, ...], list[Election]] = {}
    for election in sorted(elections, key=lambda e: e.term, reverse=True):
        by_members.setdefault(election.members, []).append(election)
    valid, over = list[Election](), list[Election]()
    for rivals in by_members.values():
        of_now = [e for e in rivals if e.valid_until_ns > now_ns]
        valid += of_now
        over += [] if of_now else rivals[:1]
    shown = [*valid, *over[: max(0, GROUPS_SHOWN - len(valid))]]
    return [
        {
            "term": e.term,
            "elector": e.id,
            "computing": e.computing,
            "members": list(e.members),
            "fresh": e.valid_until_ns > now_ns,
            "rivals": len({(r.id, r.computing) for r in valid if r.members == e.members}) > 1,
        }
        for e in shown
    ]


def _link_row(link: LinkCount, before: LinkCounts) -> list[float] | None:
    past = before.get((link.src, link.dst), LinkCount(link.src, link.dst, 0, 0, 0))
    received, lost = link.received - past.received, link.lost - past.lost
    if received + lost <= 0:
        return None
    latency_s = to_s(link.latency_ns - past.latency_ns) / received if received else 0.0
    return [link.src, link.dst, lost / (received + lost), round(latency_s, 4), received + lost]


def _truths(messages: Iterable[Message]) -> list[Truth]:
    """Where UAVs truly are, in order of number."""
    return sorted((m for m in messages if isinstance(m, Truth)), key=lambda m: m.id)


def _rounded(place: Position) -> list[float]:
    return [round(x, 2) for x in place]


def _uav(truth: Truth) -> ViewData:
    return {
        "id": truth.id,
        "ned_m": _rounded(truth.position_ned_m),
        "heading_rad": round(truth.heading_rad, 4),
        "speed_mps": round(truth.speed_mps, 2),
        "mode": truth.mode,
        "by": truth.command_issuer if truth.mode in AVOIDING else None,
        "term": truth.command_term,
    }


def rules_in_force(frame: LiveFrame) -> list[ViewData]:
    """The rules of the plan that are in force or to come, with their numbers in it."""
    rules: Iterable[Any] = plan_of(frame.plan) if frame.plan else ()
    now_s = to_s(frame.t_ns)
    return [
        {
            "n": n,
            "text": rule.words(when=True),
            "on": rule.start_s <= now_s,
            "kind": rule.name,
            "node": getattr(rule, "node", ""),
        }
        for n, rule in enumerate(rules)
        if rule.end_s is None or rule.end_s > now_s
    ]


def scenario_of(frame: LiveFrame) -> Scenario:
    """The scenario of a frame that was asked for whole."""
    return msgspec.json.decode(frame.scenario, type=Scenario)
