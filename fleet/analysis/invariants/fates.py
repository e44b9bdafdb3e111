"""What the fault plan makes of every message, computed again from plan, seed and true states."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import defaultdict

import msgspec

from fleet.analysis.invariants.index import Fates, Index, SentMessage
from fleet.faults.channel import Channel, Fate
from fleet.faults.draws import LinkMessage
from fleet.faults.links import LinkRule
from fleet.model.types import COORDINATOR, Position
from fleet.model.units import to_ns


def fates_of(index: Index) -> Fates:
    """The fate of each message at each of its receivers, judged as a node runner does.

    That is in the step after the message came, all that came for it in order of sending, for what
    rates and bursts remember. An incarnation begins without such a memory.
    """
    out: Fates = {}
    alike: dict[Fate, Fate] = {}
    for node in index.nodes:
        channels: dict[int, Channel] = {}
        here = out[node] = {}
        for begun_ns, sent in _in_order(index, node):
            if begun_ns not in channels:
                plan, seed = index.run.plan, index.scenario.seed
                channels[begun_ns] = Channel(plan, seed, index.tick_ns)
            channel = channels[begun_ns]
            if channel.clean:
                return {}
            link_message = _with_distance(index, sent.link_message(node), sent)
            fate = channel.fate(link_message)
            here[sent.key] = alike.setdefault(fate, fate)
    return out


def determined(index: Index, link_message: LinkMessage) -> bool:
    """Whether the fate follows from the record.

    In realtime not where the moment matters, nor where messages queue with others of a class that
    is not known here.
    """
    if not index.run.realtime:
        if not index.run.unknown:
            return True
        return not any(rule.concerns(link_message) for rule in index.rules_by_order)
    if not index.plan_is_known:
        return False
    return not any(rule.concerns(link_message) for rule in index.rules_by_moment)


def may_concern(index: Index, rule: LinkRule, link_message: LinkMessage) -> bool:
    """Whether a rule concerns a message, by the plan that its receiver may still have gone by.

    In realtime a receiver goes by a rule that has been ended until it hears of it.
    """
    if rule.concerns(link_message):
        return True
    if index.plan_is_known or rule.end_s is None:
        return False
    src, dst, kind, sent_ns = (
        link_message.src,
        link_message.dst,
        link_message.kind,
        link_message.t_ns,
    )
    ended_ns = to_ns(rule.end_s)
    if sent_ns < ended_ns or not rule.concerns_link(src, dst, kind):
        return False
    return sent_ns < index.absences.heard_by_ns(dst, ended_ns)


def _in_order(index: Index, node: int) -> list[tuple[int, SentMessage]]:
    """All that a node took, in the order in which it judges it, and when that incarnation began."""
    batches: defaultdict[int, list[tuple[int, SentMessage]]] = defaultdict(list)
    steps = index.stepped[node]
    for _, sent in index.due_to(node, surely=False):
        begun_ns, ended_ns = index.absences.incarnation_of(node, sent.log_ns)
        place = bisect_right(steps, sent.log_ns)
        ended = ended_ns is not None and (begun_ns == ended_ns or place == len(steps))
        if ended or place == len(steps) or (ended_ns is not None and steps[place] >= ended_ns):
            continue
        batches[steps[place]].append((begun_ns, sent))
    out = []
    for step in sorted(batches):
        out += sorted(batches[step], key=lambda one: _order(one[1]))
    return out


def _order(sent: SentMessage) -> tuple[int, int, str, int]:
    m = sent.message
    return (m.t_ns, m.id, m.kind, m.seq)


def _with_distance(index: Index, link_message: LinkMessage, sent: SentMessage) -> LinkMessage:
    """The way with its length: the sender's place when it sent, the receiver's last one."""
    if not index.measures_distance:
        return link_message
    if index.run.realtime:
        return msgspec.structs.replace(link_message, distance_m=0.0)
    known_ns = _known_ns(index, link_message.dst, sent.log_ns)
    here = None if known_ns is None else _place(index, link_message.dst, known_ns)
    there = _place(index, link_message.src, sent.log_ns)
    if here is None or there is None:
        return link_message
    return msgspec.structs.replace(link_message, distance_m=math.dist(there, here))


def _known_ns(index: Index, node: int, t_ns: int) -> int | None:
    """Of when a node's own state is that it has at a time: of its last step, if it has made any.

    A process that is started again finds that of the tick before, and keeps it until it steps.
    """
    steps = index.stepped[node]
    before = bisect_right(steps, t_ns) - 1
    last_ns = steps[before] if before >= 0 else None
    begun_ns, _ = index.absences.incarnation_of(node, t_ns)
    if begun_ns > 0 and (last_ns is None or last_ns < begun_ns):
        return begun_ns - index.tick_ns
    return last_ns


def _place(index: Index, node: int, t_ns: int) -> Position | None:
    if node == COORDINATOR:
        return index.scenario.coordination.position_ned_m
    return index.places.get((node, t_ns))
