"""Fault plans: what makes a rule impossible. What is possible, but idle, is in `idle_rules`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.config.uav_numbers import ranges_of
from fleet.faults.rules import NodeRule, Rule
from fleet.faults.whom import names
from fleet.model.types import COORDINATOR

MOST_RULES = 1000
"""In a fault plan: each is asked of every message, and all of them go to every participant."""


def fault_problems(s: Scenario) -> Iterator[str]:
    """Rules that cannot be meant, as `key: what; remedy`."""
    if len(s.fault) > MOST_RULES:
        yield f"fault: {len(s.fault)} rules; at most {MOST_RULES} can be in a plan"
        return
    flying = [u.id for u in uavs_of(s)] if s.fault else []
    for n, rule in enumerate(s.fault):
        key = f"fault[{n}]"
        if rule.end_s is not None and rule.end_s < rule.start_s:
            yield f"{key}.end_s: before start_s; make it later"
        yield from _nobody(key, rule, flying)
        for name, what in rule.problems([COORDINATOR, *flying]):
            yield f"{key}.{name}: {what}"


def _nobody(key: str, rule: Rule, flying: Sequence[int]) -> Iterator[str]:
    """Parts of patterns that name no participant."""
    of_uavs = isinstance(rule, NodeRule) and rule.of_uavs
    possible = [*flying] if of_uavs else [COORDINATOR, *flying]
    for name in rule.who_keys:
        for part in re.split("[,/]", getattr(rule, name)):
            if not any(names(part, number) for number in possible):
                yield (
                    f"{key}.{name}: '{part}' names nobody whom it could concern; "
                    f"the UAVs are {ranges_of(flying)}"
                )
