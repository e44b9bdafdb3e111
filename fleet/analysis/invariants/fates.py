"""What the fault plan makes of every message, computed again from plan, seed and true states."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import defaultdict
from typing import TYPE_CHECKING

import msgspec

from fleet.comms.arrival import Place
from fleet.comms.messages import COORDINATOR
from fleet.model.faults.channel import Channel, Fate
from fleet.model.faults.draws import Hop
from fleet.model.faults.range import Range
from fleet.model.faults.rate import Rate
from fleet.model.faults.rules import LinkRule

if TYPE_CHECKING:
    from fleet.analysis.invariants.index import Index, Key, Sent

Fates = dict[tuple[int, "Key"], Fate]
"""By receiver and message; only of what a receiver had taken when it stepped."""


def fates_of(index: Index) -> Fates:
    """The fate of each message at each of its receivers, judged as a station does.

    That is in the step after the message came, all that came for it in order of sending, for what
    rates and bursts remember. A life begins without such a memory.
    """
    out: Fates = {}
    for node in index.nodes:
        channels: dict[int, Channel] = {}
        for begun_ns, sent in _in_order(index, node):
            if begun_ns not in channels:
                plan, seed = index.history.plan, index.scenario.seed
                channels[begun_ns] = Channel(plan, seed, index.tick_ns)
            channel, message = channels[begun_ns], sent.message
            if channel.clean:
                return {}
            hop = _with_distance(index, sent.hop(node), sent)
            out[node, (message.id, message.kind, message.seq)] = channel.fate(hop)
    return out


def determined(index: Index, hop: Hop) -> bool:
    """Whether the fate follows from the record; in realtime not where the moment matters."""
    if not index.history.realtime:
        return True
    if not index.plan_is_known:
        return False
    plan = [r for r in index.history.plan if isinstance(r, LinkRule)]
    return not any(isinstance(r, Range | Rate) and r.concerns(hop) for r in plan)


def _in_order(index: Index, node: int) -> list[tuple[int, Sent]]:
    """All that a node took, in the order in which it judges it, and when that life began."""
    batches: defaultdict[int, list[tuple[int, Sent]]] = defaultdict(list)
    steps = index.stepped[node]
    for sent in index.sent.values():
        if not index.hears(node, sent.message):
            continue
        begun_ns, ended_ns = index.life_of(node, sent.log_ns)
        place = bisect_right(steps, sent.log_ns)
        ended = ended_ns is not None and (begun_ns == ended_ns or place == len(steps))
        if ended or place == len(steps) or (ended_ns is not None and steps[place] >= ended_ns):
            continue
        batches[steps[place]].append((begun_ns, sent))
    out = []
    for step in sorted(batches):
        out += sorted(batches[step], key=lambda one: _order(one[1]))
    return out


def _order(sent: Sent) -> tuple[int, int, str, int]:
    m = sent.message
    return (m.t_ns, m.id, m.kind, m.seq)


def _with_distance(index: Index, hop: Hop, sent: Sent) -> Hop:
    """The way with its length: the sender's place when it sent, the receiver's last one."""
    if not any(isinstance(r, Range) for r in index.history.plan):
        return hop
    if index.history.realtime:
        return msgspec.structs.replace(hop, distance_m=0.0)
    steps = index.stepped[hop.dst]
    before = bisect_right(steps, sent.log_ns) - 1
    here = _place(index, hop.dst, steps[before]) if before >= 0 else None
    there = _place(index, hop.src, sent.log_ns)
    if here is None or there is None:
        return hop
    return msgspec.structs.replace(hop, distance_m=math.dist(there, here))


def _place(index: Index, node: int, t_ns: int) -> Place | None:
    if node == COORDINATOR:
        return index.scenario.coordination.position_ned_m
    return index.places.get((node, t_ns))
