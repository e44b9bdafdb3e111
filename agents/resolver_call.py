"""Asking a resolver, which may be anybody's: what it does wrong is told with its name."""

from __future__ import annotations

import math
import traceback
from pathlib import Path

from fleet.agents.advisory import Advisory, Resolver, Situation
from fleet.errors import ResolverError
from fleet.model.words import Manoeuvre


def advisories_of(resolver: Resolver, situation: Situation) -> tuple[Advisory, ...]:
    """What a resolver answers.

    Raises:
        ResolverError: it raised something, or what it gave are no advisories for this situation.

    """
    name = f"{type(resolver).__module__}:{type(resolver).__qualname__}"
    try:
        advisories = tuple(resolver.resolve(situation))
    except Exception as error:  # user code: whatever it raises is the user's to mend
        at = traceback.extract_tb(error.__traceback__)[-1]
        raise ResolverError(
            f"resolver {name}: {type(error).__name__}: {error} "
            f"({Path(at.filename).name}, line {at.lineno})"
        ) from error
    given = {*situation.members, *(aircraft.id for aircraft in situation.aircraft)}
    for advisory in advisories:
        why = _wrong(advisory, given)
        if why:
            raise ResolverError(f"resolver {name}: {why}")
    return advisories


def _wrong(advisory: object, given: set[int]) -> str:
    """Why something that a resolver gave is no advisory for these UAVs; empty if it is one."""
    if not isinstance(advisory, Advisory):
        return f"{type(advisory).__name__} is no Advisory"
    if advisory.target not in given:
        return f"an advisory for UAV {advisory.target}, which is not in the situation"
    if advisory.manoeuvre not in list(Manoeuvre):
        return f"'{advisory.manoeuvre}' is none of {', '.join(Manoeuvre)}"
    if not all(map(math.isfinite, (advisory.heading_rad, advisory.climb_mps))):
        return f"heading or climb of the advisory for UAV {advisory.target} is not finite"
    return ""
