"""What came of a run, as plain maps for programs; SI units, latencies and times in seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from fleet.analysis.latency_bins import binned_quantiles_s
from fleet.analysis.run_summary import RunSummary
from fleet.analysis.separation import PairMinimum
from fleet.analysis.tally import RunTally, quantiles
from fleet.faults.links import Harm, LinkRule
from fleet.faults.rules import Rule
from fleet.model.words import ArrivalFate
from fleet.protocol.classes import AUDIBLE

PAIRS_TOLD, LOST_TOLD = 20, 200
"""So many pairs, the nearest; of those that lost separation so many."""


def result_of(summary: RunSummary, plan: Sequence[Rule]) -> dict[str, Any]:
    """Separation, arrivals, elections, commands, delivery of a run under this fault plan."""
    arrivals, tally = summary.arrivals.arrivals(), summary.tally
    return {
        **separation_json(summary.separation.minima()),
        **arrivals.totals(),
        "arrivals": [asdict(row) for row in arrivals.rows],
        "elections": len(tally.terms),
        "commands": {
            "issued": len(tally.issued),
            "transmissions": tally.transmissions,
            "applied": len(tally.applied),
            "refused": sum(tally.refused.values()),
            "refused_by_reason": dict(sorted(tally.refused.items())),
            "latency_s": quantiles(list(tally.applied.values())),
        },
        "unresolved": tally.unresolved,
        "leaderless": sorted(tally.leaderless),
        "delivery": _delivery(tally, plan),
        "faults": len(plan),
        "messages": dict(sorted(summary.messages.items())),
    }


def separation_json(minima: Sequence[PairMinimum]) -> dict[str, Any]:
    """How near the pairs came: least and counts of all, and a list of the nearest ones.

    Every pair that lost separation is in the list, up to `LOST_TOLD` of them.
    """
    lost = sum(m.lost for m in minima)
    told = minima[: max(PAIRS_TOLD, min(lost, LOST_TOLD))]
    return {
        "least_separation": minima[0].least_separation if minima else None,
        "pairs": len(minima),
        "pairs_lost": lost,
        "nearest_pairs": [asdict(m) for m in told],
        "pairs_left_out": len(minima) - len(told),
    }


def _delivery(tally: RunTally, plan: Sequence[Rule]) -> dict[str, Any]:
    """By class of message: sent (times receivers), received, dropped by which fault, and when.

    What no receiver reports went to a process that was down, or was still under way at the end. How
    much that is cannot be told from sums where faults multiply messages.
    """
    multiplied = any(isinstance(rule, LinkRule) and rule.harms & Harm.COPY for rule in plan)
    out: dict[str, Any] = {}
    for kind in sorted(AUDIBLE):
        fates = {fate: n for (k, fate), n in sorted(tally.fates.items()) if k == kind}
        came = {fate: fates.pop(fate, 0) for fate in ArrivalFate}
        if not tally.sent[kind]:
            continue
        out[kind] = {
            "messages": tally.transmitted[kind],
            "sent": tally.sent[kind],
            "delivered": sum(came.values()),
            "altered": came[ArrivalFate.ALTERED],
            "implausible": came[ArrivalFate.IMPLAUSIBLE],
            "dropped": fates,
            "unreported": None
            if multiplied
            else tally.sent[kind] - sum(came.values()) - sum(fates.values()),
            "latency_s": binned_quantiles_s(tally.latencies[kind]),
        }
    return out
