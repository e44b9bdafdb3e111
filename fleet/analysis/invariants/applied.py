"""The fault plan was applied: what reports say became of a message is what the plan makes of it."""

from __future__ import annotations

from fleet.analysis.invariants.accounting import entry_of, excused, name, sent_of
from fleet.analysis.invariants.fates import determined
from fleet.analysis.invariants.index import ARRIVED_FATES, Index, MessageKey, Receipt, SentMessage
from fleet.analysis.invariants.verdict import Examination
from fleet.faults.channel import Fate
from fleet.faults.links import UNREADABLE
from fleet.model.words import ArrivalFate

FateAtTime = tuple[str, int]
"""A fate as reports name it, and the time of delivery; in realtime 0, as that is measured."""

FateCounts = dict[FateAtTime, list[int]]
"""All that a receiver must report of a message, and when each time it is due."""


NOTHING_MORE: FateCounts = {}
"""Everything has been reported; one for all, since an hour has millions of receipts."""


def plan_applied(index: Index) -> Examination:
    """No report tells of a fate that plan, seed and true states do not give the message.

    None was received that the plan drops, none earlier than it allows, none altered or unaltered
    against it, and every copy that it makes came too. In realtime a delivery is not before the
    delay that the plan adds.
    """
    examination = Examination()
    left: dict[int, dict[MessageKey, FateCounts]] = {node: {} for node in index.nodes}
    for node, step, receipt in index.receipts():
        sent, fate = index.sent.get(receipt.key), index.fate(node, receipt.key)
        if sent is None or fate is None or not determined(index, sent.link_message(node)):
            continue
        examination.examined += 1
        known = left[node].get(receipt.key)
        if known is None:
            known = left[node][receipt.key] = _outcomes(index, sent, fate)
        told = _told(index, receipt, known)
        due = known.get(told)
        if not due or _early(index, node, receipt, sent, fate):
            what = f"by the fault plan it is {_words(fate)}"
            examination.blame(what, sent_of(sent), entry_of(node, step.t_ns, receipt))
        if due:
            due.pop(0)
            if not any(known.values()):
                left[node][receipt.key] = NOTHING_MORE
    _copies_missing(index, left, examination)
    return examination


def _copies_missing(
    index: Index, left: dict[int, dict[MessageKey, FateCounts]], examination: Examination
) -> None:
    """Blame what is left of what must be reported; that of which nothing is, `losses` blames."""
    pairs = ((node, key, left[node][key]) for node in left for key in left[node])
    for node, key, outcomes in pairs:
        if any(outcomes.values()):
            sent, first_ns = index.sent[key], min(min(due) for due in outcomes.values() if due)
            if not excused(index, node, sent, first_ns):
                what = f"{name(node)} has not all of it: by the fault plan it is "
                examination.blame(what + _words(index.fates[node][key]), sent_of(sent))


def _outcomes(index: Index, sent: SentMessage, fate: Fate) -> FateCounts:
    """What the plan makes of a message; what is dropped is reported at once."""
    if fate.dropped_by:
        return {(fate.dropped_by, 0): [0]}
    out: FateCounts = {}
    for delivery in sorted(fate.deliveries, key=lambda p: p.delay_ns):
        due_ns = sent.message.t_ns + max(delivery.delay_ns, index.tick_ns)
        at_ns = 0 if index.run.realtime else due_ns
        told: FateAtTime
        if not delivery.flips:
            told = ArrivalFate.RECEIVED, at_ns
        elif index.read_as(sent, delivery.flips) is None:
            told, due_ns = (UNREADABLE, 0), 0
        else:
            told = ArrivalFate.ALTERED, at_ns
        out.setdefault(told, []).append(due_ns)
    return out


def _told(index: Index, receipt: Receipt, known: FateCounts) -> FateAtTime:
    """What a report tells; what was not believed has been received all the same."""
    at_ns = 0 if index.run.realtime else receipt.delivered_ns
    if receipt.fate != ArrivalFate.IMPLAUSIBLE:
        return receipt.fate, at_ns
    altered = (ArrivalFate.ALTERED, at_ns) in known
    return (ArrivalFate.ALTERED if altered else ArrivalFate.RECEIVED), at_ns


def _early(index: Index, node: int, receipt: Receipt, sent: SentMessage, fate: Fate) -> bool:
    """Realtime: a delivery sooner after the message's step than the plan delays it.

    By the clock of its sender, as far as it is known how far that is ahead.
    """
    if not index.run.realtime or receipt.fate not in ARRIVED_FATES or not fate.deliveries:
        return False
    least_ns = min(p.delay_ns for p in fate.deliveries)
    apart_ns = index.wall_clocks.at_most_ahead_ns(sent.message.id, node)
    return receipt.delivered_ns + apart_ns < sent.message.t_ns + least_ns - index.tick_ns


def _words(fate: Fate) -> str:
    if fate.dropped_by:
        return f"dropped ({fate.dropped_by})"
    delays = " and ".join(f"{p.delay_ns / 1e9:.3f} s" for p in fate.deliveries)
    altered = ", altered" if any(p.flips for p in fate.deliveries) else ""
    return f"delivered after {delays} (or a tick, if that is longer){altered}"
