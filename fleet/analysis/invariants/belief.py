"""Plausibility: no receiver believes that a UAV has jumped."""

from __future__ import annotations

from dataclasses import dataclass, field

from fleet.analysis.invariants.index import (
    ARRIVED_FATES,
    BELIEVED_FATES,
    Index,
    MessageKey,
    Receipt,
)
from fleet.analysis.invariants.verdict import Examination, Violation, Witness, witness
from fleet.model.conflict.tracks import BELIEVED_AFTER, StateReport, TrackRules, plausible
from fleet.protocol.messages import StateBroadcast
from fleet.protocol.surveillance import report_of


@dataclass
class Belief:
    """What one receiver takes one UAV to have said, and what it has doubted since."""

    known: tuple[Receipt, StateReport]
    doubted: list[StateReport] = field(default_factory=list)

    def take(self, receipt: Receipt, report: StateReport, rules: TrackRules) -> bool:
        """Go on to a newer report; False if it was believed without reason."""
        fits = plausible(self.known[1], report, rules)
        if not fits:
            if self.doubted and not plausible(self.doubted[-1], report, rules):
                self.doubted.clear()
            if not self.doubted or report.seq > self.doubted[-1].seq:
                self.doubted.append(report)
        if receipt.fate not in BELIEVED_FATES:
            return True
        insisted = len(self.doubted) >= BELIEVED_AFTER
        self.known = receipt, report
        self.doubted.clear()
        return fits or insisted


def plausibility(index: Index) -> Examination:
    """What a receiver believes of a UAV never jumps, but to what several reports in a row agree on.

    Reports are those of a delivery report, with the bits flipped that a fault flipped, and in the
    order of delivery; of no interest are such as are older than what is believed.
    """
    examination, rules = Examination(), index.scenario.track_rules()
    reports: dict[MessageKey, StateReport] = {}
    for node in index.nodes:
        incarnation, beliefs = -1, dict[int, Belief]()
        for step in index.steps[node]:
            if step.incarnation != incarnation:
                incarnation, beliefs = step.incarnation, {}
            for receipt in step.received:
                if receipt.fate not in ARRIVED_FATES or not isinstance(
                    receipt.message, StateBroadcast
                ):
                    continue
                report = _report(index, receipt, receipt.message, reports)
                belief = beliefs.get(report.id)
                if belief is None:
                    beliefs[report.id] = Belief((receipt, report))
                elif report.seq > belief.known[1].seq:
                    examination.examined += 1
                    before = belief.known[0]
                    if not belief.take(receipt, report, rules):
                        examination.violations.append(_jump(node, before, receipt))
    return examination


def _report(
    index: Index, receipt: Receipt, read: StateBroadcast, reports: dict[MessageKey, StateReport]
) -> StateReport:
    """What was read; the same at all receivers that read what was sent."""
    if index.sent[receipt.key].message is not read:
        return report_of(read)
    report = reports.get(receipt.key)
    if report is None:
        report = reports[receipt.key] = report_of(read)
    return report


def _jump(node: int, before: Receipt, receipt: Receipt) -> Violation:
    who = "the coordinator" if node == 0 else f"UAV {node}"
    what = f"{who} believes that UAV {receipt.key[0]} has jumped"
    return Violation(what, (_believed(before), _believed(receipt)))


def _believed(receipt: Receipt) -> Witness:
    """A broadcast as it was read."""
    read = receipt.message
    assert isinstance(read, StateBroadcast)
    fields = ("seq", "applies_ns", "position_ned_m", "speed_mps")
    return witness(read, *fields, heard_ns=receipt.at_ns, fate=receipt.fate)
