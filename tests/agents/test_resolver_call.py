"""What a resolver of a user does wrong ends the run with its name, and is never flown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

import fleet
from fleet.agents.advisory import Advisory, Situation
from fleet.agents.resolver_call import advisories_of
from fleet.errors import ResolverError

NOBODY = Situation(1, (1, 2), ())


class Answers:
    """Gives what it was made with, or raises it."""

    def __init__(self, answer: Any) -> None:
        self._answer = answer

    def resolve(self, _situation: Situation) -> Sequence[Advisory]:
        """The answer."""
        if isinstance(self._answer, Exception):
            raise self._answer
        answer: Sequence[Advisory] = self._answer
        return answer


class Wrong:
    """Advises for a UAV that is not there."""

    def __init__(self, scenario: fleet.Scenario) -> None:
        """Needs nothing of it."""

    def resolve(self, _situation: Situation) -> Sequence[Advisory]:
        """A climb for UAV 7."""
        return [Advisory(7, "climb", climb_mps=5.0)]


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero (test_res"),
        (None, "TypeError: 'NoneType' object is not iterable"),
        ([(2, "climb")], "tuple is no Advisory"),
        ([Advisory(7, "climb", climb_mps=5.0)], "UAV 7, which is not in the situation"),
    ],
)
def test_what_is_wrong_is_told_with_the_name_of_the_resolver(answer: Any, why: str) -> None:
    with pytest.raises(ResolverError) as failed:
        advisories_of(Answers(answer), NOBODY)
    assert str(failed.value).startswith(f"resolver {__name__}:Answers: ")
    assert why in str(failed.value)


def test_a_run_ends_by_the_name_of_its_resolver() -> None:
    with pytest.raises(fleet.FleetStoppedError, match=r":Wrong: an advisory for UAV 7, which is"):
        fleet.run("head_on", resolver=Wrong)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"manoeuvre": "clmb"}, "'clmb' is none of turn, climb, turn_climb, speed, resume, keep"),
        ({"heading_rad": math.nan}, "heading or climb of the advisory for UAV 2 is not finite"),
    ],
)
def test_a_manoeuvre_that_cannot_be_flown_is_named(changes: dict[str, Any], why: str) -> None:
    given: list[Situation] = []

    class Keeps(Answers):
        def resolve(self, _situation: Situation) -> Sequence[Advisory]:
            given.append(_situation)
            return []

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fleet.agents.resolvers.GeometricResolver", Keeps)
        fleet.run("head_on")
    advisory = Advisory(**{"target": 2, "manoeuvre": "turn", **changes})
    with pytest.raises(ResolverError) as failed:
        advisories_of(Answers([advisory]), given[0])
    assert why in str(failed.value)
