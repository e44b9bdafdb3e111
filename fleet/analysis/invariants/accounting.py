"""Accounting: everything received was sent, and nothing sent is missing without a reason."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence

from fleet.analysis.invariants.fates import determined, may_concern
from fleet.analysis.invariants.index import ARRIVED_FATES, Index, MessageKey, Receipt, SentMessage
from fleet.analysis.invariants.verdict import Examination, Witness, witness
from fleet.analysis.invariants.views import View
from fleet.faults.links import UNREADABLE, Harm, LinkRule
from fleet.model.units import to_ns
from fleet.model.words import ArrivalFate
from fleet.protocol.messages import StateBroadcast
from fleet.protocol.topics import issuer_name


def receipts(index: Index) -> Examination:
    """Every entry of a delivery report is a message that was sent to this receiver, in due time.

    In due time: not before a tick has passed, and later only by a fault that delays. It comes more
    than once only by faults that copy, and is dropped or altered only by faults that do that.
    """
    examination = Examination()
    for one, other in index.clashes:
        examination.blame("two messages have the same number", sent_of(one), sent_of(other))
    rules = index.link_rules
    count: Counter[tuple[int, MessageKey]] = Counter()
    for node, step, receipt in index.receipts():
        examination.examined += 1
        count[node, receipt.key] += 1
        sent = index.sent.get(receipt.key)
        what = _wrong(index, node, step.t_ns, receipt, sent, rules)
        if sent and not what and count[node, receipt.key] > 1:
            link_message = sent.link_message(node)
            most = 1 + sum(
                r.copies
                for r in rules
                if r.harms & Harm.COPY and may_concern(index, r, link_message)
            )
            if count[node, receipt.key] > most:
                what = f"it comes {count[node, receipt.key]} times"
        if what:
            shown = [sent_of(sent)] if sent else []
            examination.blame(what, *shown, entry_of(node, step.t_ns, receipt))
    return examination


def losses(index: Index) -> Examination:
    """Every message is in the delivery report of everybody who should hear it.

    That are all for whom it is, and who are within radio range when it is sent. Unless the
    receiver did not step again after it was due: it was killed, or the run ended.
    """
    examination = Examination()
    seen: defaultdict[int, set[MessageKey]] = defaultdict(set)
    for node, _, receipt in index.receipts():
        seen[node].add(receipt.key)
    for node in index.nodes:
        for key, sent in index.due_to(node):
            if index.run.unknown and not determined(index, sent.link_message(node)):
                continue  # how long it queues depends on messages of which nothing is known
            examination.examined += 1
            if key not in seen[node] and not excused(index, node, sent, _due_ns(index, node, sent)):
                what = f"{name(node)} never received it, and no fault kept it away"
                examination.blame(what, sent_of(sent))
    return examination


def answers(views: Sequence[View]) -> Examination:
    """Every acknowledgement, also a refusal, answers a command that its issuer had received."""
    examination = Examination(sum(view.answers for view in views))
    for view in views:
        for ack in view.unfounded:
            fields = ("term", "number", "accepted", "reason")
            examination.blame(
                f"UAV {view.uav} answers what it had not received", witness(ack, *fields)
            )
    return examination


def _wrong(
    index: Index,
    node: int,
    now_ns: int,
    receipt: Receipt,
    sent: SentMessage | None,
    rules: Sequence[LinkRule],
) -> str:
    """What is wrong with an entry of a delivery report; empty if nothing."""
    if sent is None:
        return "it was never sent" if _would_be_known(index, receipt) else ""
    if sent.message.t_ns != receipt.sent_ns:
        return "it was sent at another time"
    if not index.receivers.may_hear(node, sent.message):
        far = sent.message.is_for(node) and index.receivers.limited
        return f"{name(node)} is out of its range" if far else f"it is not for {name(node)}"
    if receipt.fate not in ARRIVED_FATES:
        link_message = sent.link_message(node)
        by_fault = any(
            _accounts(r, receipt.fate) and may_concern(index, r, link_message) for r in rules
        )
        return "" if by_fault else f"no fault of the plan is '{receipt.fate}' to it"
    if receipt.message is None and not _may_be_altered(index, node, sent, rules):
        return "no fault of the plan altered it to anything that can be read"
    if receipt.fate == ArrivalFate.IMPLAUSIBLE and receipt.kind != StateBroadcast.kind:
        return "only broadcasts can be implausible"
    if index.run.realtime:
        return ""
    early_ns = sent.message.t_ns + index.tick_ns - receipt.delivered_ns
    if early_ns > 0 or receipt.delivered_ns > now_ns:
        return "it comes before its time"
    if early_ns < 0 and not any(
        r.longest_s() > 0.0 and r.concerns(sent.link_message(node)) for r in rules
    ):
        return "it comes late without a fault"
    return ""


def _may_be_altered(index: Index, node: int, sent: SentMessage, rules: Sequence[LinkRule]) -> bool:
    """Whether it is not known what a receiver's plan made of a message: it was being changed."""
    link_message = sent.link_message(node)
    return not index.plan_is_known and any(
        r.harms & Harm.ALTER and may_concern(index, r, link_message) for r in rules
    )


def _would_be_known(index: Index, receipt: Receipt) -> bool:
    """Whether the simulation would have what is told to be received, if it was sent.

    What was sent in an outage can have reached this receiver, and the simulation not.
    """
    src, told_ns = receipt.key[0], receipt.sent_ns
    in_outage = index.absences.in_outage(src, since_ns=told_ns, until_ns=told_ns)
    return told_ns <= index.settled_ns and not in_outage


def _accounts(rule: LinkRule, fate: str) -> bool:
    """Whether a rule can be why a message did not arrive."""
    if rule.harms & Harm.ALTER and fate == UNREADABLE:
        return True
    return bool(rule.harms & Harm.DROP) and fate == rule.name


def excused(index: Index, node: int, sent: SentMessage, due_ns: int) -> bool:
    """Whether a message that is in no report was still on its way when its receiver ended.

    A receiver whose clock is ahead ends before the others. Or a link was silent meanwhile.
    """
    sent_ns = sent.message.t_ns if index.run.realtime else sent.log_ns
    if index.absences.in_outage(node, sent.message.id, since_ns=sent_ns, until_ns=due_ns):
        return True
    ahead_ns = max(0, index.wall_clocks.at_most_ahead_ns(node, sent.message.id))
    sent_ns, due_ns = sent_ns + ahead_ns, due_ns + ahead_ns
    begun_ns, ended_ns = index.absences.incarnation_of(node, sent_ns)
    if ended_ns == begun_ns or sent_ns < index.absences.settled_after_ns(node, begun_ns):
        return True
    steps = index.steps_between(node, index.absences.settled_after_ns(node, sent_ns), ended_ns)
    if not steps:
        return True
    return index.absences.settled_after_ns(node, due_ns) > steps[-1]


def _due_ns(index: Index, node: int, sent: SentMessage) -> int:
    """The latest moment at which a message was due; a drop would have been reported at once."""
    link_message = sent.link_message(node)
    fate = index.fate(node, sent.key)
    if fate is None:
        return sent.message.t_ns + index.tick_ns
    deliveries = fate.deliveries
    if not deliveries:
        return 0
    delay_ns = deliveries[0].delay_ns
    for rule in index.rules_by_order if index.run.realtime else ():
        if rule.concerns(link_message):
            delay_ns += to_ns(rule.longest_s(index.longest_payload_bits))
    return sent.message.t_ns + max(delay_ns, index.tick_ns)


def name(node: int) -> str:
    """A participant, as findings call it."""
    return f"UAV {node}" if node else "the coordinator"


def sent_of(sent: SentMessage) -> Witness:
    """A message as a witness."""
    return witness(sent.message, "seq")


def entry_of(node: int, now_ns: int, receipt: Receipt) -> Witness:
    """An entry of a delivery report."""
    src, kind, seq = receipt.key
    return Witness(
        now_ns,
        f"{issuer_name(node)}/delivery",
        {
            "src": src,
            "kind": kind,
            "seq": seq,
            "sent_ns": receipt.sent_ns,
            "delivered_ns": receipt.delivered_ns,
            "fate": receipt.fate,
        },
    )
