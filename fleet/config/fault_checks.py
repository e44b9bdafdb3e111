"""Fault plans: what makes a rule impossible. What is possible, but idle, is in `idle`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.faults.burst import Burst
from fleet.faults.lifecycle import Kill
from fleet.faults.navigation import Navigation
from fleet.faults.partition import Partition
from fleet.faults.plan import FaultRule
from fleet.faults.range import MODELS, Range
from fleet.faults.rules import names
from fleet.model.types import COORDINATOR


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
