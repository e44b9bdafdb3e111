"""What the fault plan lets one expect of a link, where that has a closed form.

Delivery: the probability with which a message passes every rule in force when it was sent. Latency:
the distribution of the delays, quantile by quantile.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from msgspec.structs import replace

from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.values import Spread
from fleet.analysis.relative_motion import Bools
from fleet.faults.draws import LinkMessage
from fleet.faults.links import Harm, LinkRule
from fleet.faults.rules import Rule
from fleet.model.types import Array
from fleet.model.units import to_ns

Pattern = tuple[LinkRule, ...]
"""The rules in force that delay a message."""

RANGE_SAMPLES = 1000
"""A distribution of delays is taken at so many quantiles, in the middle of equal parts."""
_PARTS = (np.arange(RANGE_SAMPLES) + 0.5) / RANGE_SAMPLES


def concerning(plan: Sequence[Rule], link: LinkMessage) -> list[LinkRule]:
    """The rules about a link and class, at whatever time; `link` is any message of them."""
    found = []
    for rule in plan:
        if isinstance(rule, LinkRule):
            link_message = LinkMessage(link.src, link.dst, link.kind, 0, to_ns(rule.start_s))
            if rule.concerns(link_message):
                found.append(rule)
    return found


def in_force(rule: Rule, t_ns: Ints) -> Bools:
    """Whether a rule is in force at these times, shape (n,)."""
    end_ns = math.inf if rule.end_s is None else to_ns(rule.end_s)
    return (t_ns >= to_ns(rule.start_s)) & (t_ns < end_ns)


def chances(
    rules: Sequence[LinkRule],
    link: LinkMessage,
    t_ns: Ints,
    bits: Ints,
    distances_m: Callable[[], Array],
) -> Array | None:
    """Probability (n,) that each message of a link is delivered; None without a closed form.

    `distances_m` gives those of sender and receiver when the messages were sent, shape (n,).
    """
    out = np.ones(len(t_ns))
    for rule in rules:
        now = in_force(rule, t_ns)
        if not now.any():
            continue
        passed: Array | float | None
        if rule.by_distance:
            passed = _passed(rule, link, bits[now], distances_m()[now])
        else:
            passed = rule.passes(link)
        if passed is None:
            return None
        out[now] *= passed
    return out


def _passed(rule: LinkRule, link: LinkMessage, bits: Ints, distances_m: Array) -> Array | None:
    """The same of one rule that goes by distance; None also where a distance is unknown."""
    if not np.isfinite(distances_m).all():
        return None
    passed = []
    for bits_of, distance_m in zip(bits.tolist(), distances_m.tolist(), strict=True):
        one = replace(link, bits=bits_of, distance_m=distance_m)
        passed.append(rule.passes(one))
    found = [p for p in passed if p is not None]
    return np.array(found) if len(found) == len(passed) else None


def patterns_of(rules: Sequence[LinkRule], t_ns: Ints) -> Counter[Pattern]:
    """How many messages sent at these times (n,) were delayed by which rules."""
    delaying = [r for r in rules if r.harms & Harm.DELAY]
    table = np.array([in_force(r, t_ns) for r in delaying]).reshape(len(delaying), len(t_ns))
    kinds, counts = np.unique(table, axis=1, return_counts=True)
    found: Counter[Pattern] = Counter()
    for kind, count in zip(kinds.T.tolist(), counts.tolist(), strict=True):
        found[tuple(r for r, now in zip(delaying, kind, strict=True) if now)] += count
    return found


def expected_latency(counted: Counter[Pattern], least_s: float) -> Spread:
    """Expected spread of the latency of so many messages; blank without a closed form.

    Nothing comes before `least_s`: a tick in lockstep. Realtime has no such bound, and there what
    zenoh takes is on top.
    """
    laws = [(law(pattern, least_s), count) for pattern, count in counted.items() if count]
    if not laws or any(values is None for values, _ in laws):
        return Spread()
    values = np.concatenate([v for v, _ in laws if v is not None])
    weights = np.concatenate([np.full(RANGE_SAMPLES, n / RANGE_SAMPLES) for _, n in laws])
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    places = np.searchsorted(below, below[-1] * np.array([0.50, 0.95, 0.99]))
    p50, p95, p99 = values[order][places].tolist()
    mean = float(np.sum(values * weights) / below[-1])
    return Spread(sum(counted.values()), mean, p50, p95, p99)


@lru_cache(maxsize=256)
def law(pattern: Pattern, least_s: float) -> Array | None:
    """Latencies (SAMPLES,) at equal steps of probability, where one delay at most is random."""
    delays = []
    for rule in pattern:
        delay = rule.quantiles_s(_PARTS)
        if delay is None:
            return None
        delays.append(delay)
    if sum(bool(np.ptp(d) > 0.0) for d in delays) > 1:
        return None
    return np.maximum(np.sum(delays, axis=0) if delays else np.zeros(RANGE_SAMPLES), least_s)
