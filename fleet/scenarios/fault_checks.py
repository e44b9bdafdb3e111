"""Fault plans: what makes a rule impossible, and which rules can do nothing in a run."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from fleet.model.faults.burst import Burst
from fleet.model.faults.navigation import Navigation
from fleet.model.faults.partition import Partition
from fleet.model.faults.plan import FaultRule
from fleet.model.faults.process import Kill
from fleet.model.faults.range import MODELS, Range
from fleet.model.faults.rules import COORDINATOR, LinkRule, NodeRule, names
from fleet.model.generate import uavs_of
from fleet.model.scenario import Scenario
from fleet.model.units import to_ns

_BY_UAVS, _BY_COORDINATOR = ("adsb", "cmd", "ack"), ("beat",)
"""Classes of messages that UAVs alone send, and the coordinator alone; elections come from both."""


def fault_problems(s: Scenario) -> Iterator[str]:
    """Rules that cannot be meant, as `key: what; remedy`."""
    flying = [u.id for u in uavs_of(s)] if s.fault else []
    for n, rule in enumerate(s.fault):
        key = f"fault[{n}]"
        if rule.end_s is not None and rule.end_s < rule.start_s:
            yield f"{key}.end_s: before start_s; make it later"
        if isinstance(rule, Kill) and rule.then == "vanish" and rule.end_s is not None:
            yield f"{key}.end_s: what has vanished cannot start again; remove it"
        yield from _nobody(key, rule, flying)
        if isinstance(rule, Partition) and not _parts(rule, [COORDINATOR, *flying]):
            yield (
                f"{key}.groups: '{rule.groups}' parts nobody from anybody; put those who shall not "
                "hear each other on different sides, as 1-2/3,4"
            )
        if isinstance(rule, Burst) and rule.enter > 1.0 + 1e-9:
            needed = math.ceil(rule.loss / (1.0 - rule.loss) - 1e-9)
            yield (
                f"{key}.mean_ticks: bursts so short cannot make up a mean loss of "
                f"{rule.loss:g}; make it {needed} or more"
            )
        if isinstance(rule, Range):
            yield from _range(key, rule)


def _nobody(key: str, rule: FaultRule, flying: Sequence[int]) -> Iterator[str]:
    """Parts of patterns that name no participant."""
    others = [] if isinstance(rule, Navigation) else [COORDINATOR]
    for name in ("node", "src", "dst", "groups"):
        for part in re.split("[,/]", getattr(rule, name, "*")):
            if not any(names(part, number) for number in [*flying, *others]):
                yield (
                    f"{key}.{name}: '{part}' names nobody whom it could concern; "
                    f"the UAVs are {min(flying)} to {max(flying)}"
                )


def _parts(rule: Partition, everybody: Sequence[int]) -> bool:
    """Whether there are two whom it parts, one in `src`, the other in `dst`."""
    sources = {rule.sides(n) for n in everybody if names(rule.src, n)}
    receivers = {rule.sides(n) for n in everybody if names(rule.dst, n)}
    return any(a and b and not a & b for a in sources for b in receivers)


def _range(key: str, rule: Range) -> Iterator[str]:
    """Keys that the model of a range rule needs, and such as it does not have."""
    if rule.model == "cutoff" and rule.max_m is None:
        yield f"{key}.max_m: missing; add it, since model 'cutoff' goes by it"
    if rule.model == "polynomial" and not (rule.quadratic_per_m2 or rule.linear_per_m):
        yield f"{key}.quadratic_per_m2: missing, and so is linear_per_m; add one of them"
    defaults = Range()
    for model, keys in MODELS.items():
        for other in keys:
            if model != rule.model and getattr(rule, other) != getattr(defaults, other):
                yield f"{key}.{other}: model '{rule.model}' does not have it; leave it out"


def idle_rules(s: Scenario) -> list[str]:
    """Rules that are possible, but do nothing in this run; a line each, with the reason."""
    if not s.fault:
        return []
    present = [COORDINATOR] if s.coordination.electors == "coordinator" else []
    present += [u.id for u in uavs_of(s)]
    found = ((n, rule, _idle(rule, s, present)) for n, rule in enumerate(s.fault))
    return [f"fault[{n}] ({rule.name}) does nothing: {why}" for n, rule, why in found if why]


def _idle(rule: FaultRule, s: Scenario, present: Sequence[int]) -> str:
    """Why a rule does nothing; empty if it may."""
    first = -(-to_ns(rule.start_s) // s.tick_ns)
    if first >= s.ticks:
        return f"it begins at {rule.start_s:g} s, and the run ends at {s.duration_s:g} s"
    if rule.end_s is not None and to_ns(rule.end_s) <= first * s.tick_ns:
        return f"there is no tick in its window from {rule.start_s:g} s to {rule.end_s:g} s"
    if isinstance(rule, NodeRule):
        return "" if any(map(rule.hits, present)) else "this run has no coordinator"
    return _idle_link(rule, present)


def _idle_link(rule: LinkRule, present: Sequence[int]) -> str:
    """The same, of the messages from some to some."""
    wanted = {*_BY_UAVS, *_BY_COORDINATOR, "election"}
    if rule.classes != "*":
        wanted = set(rule.classes.split(","))
    sources = [n for n in present if names(rule.src, n) and _sends(n, wanted)]
    receivers = {n for n in present if names(rule.dst, n)}
    if not any(receivers - {source} for source in sources[:2]):
        return "in this run nobody sends such messages to such a receiver"
    if isinstance(rule, Partition) and not _parts(rule, present):
        return "in this run it parts nobody from anybody"
    return ""


def _sends(number: int, classes: set[str]) -> bool:
    """Whether some of these classes may come from a participant."""
    others = _BY_UAVS if number == COORDINATOR else _BY_COORDINATOR
    return bool(classes.difference(others))
