"""A resolver of your own: everybody but the computing UAV turns right, by 30 degrees."""

import math
from collections.abc import Sequence

import fleet

TURN_RAD = math.radians(30.0)


class TurnRight:
    """Asked once a round, with all that the computing UAV knows."""

    def __init__(self, scenario: fleet.Scenario) -> None:
        """Needs nothing of the scenario."""

    def resolve(self, situation: fleet.Situation) -> Sequence[fleet.Advisory]:
        """Advisories for those who do not fly one yet."""
        return [
            fleet.Advisory(
                one.id,
                "turn",
                heading_rad=math.remainder(one.guidance.heading_rad + TURN_RAD, math.tau),
                turn_rad=TURN_RAD,
                manoeuvre_s=30.0,
            )
            for one in situation.aircraft
            if one.id in situation.members and one.id != situation.computing
            if one.manoeuvre is None
        ]


scenario = fleet.load_scenario("head_on", {"duration_s": 90})
for name, resolver in {"turn right": TurnRight, "geometric": None}.items():
    run = fleet.run(scenario, resolver=resolver)
    least = fleet.measure(run).totals.least_separation
    print(f"{name}: least separation {least:.3f}, {fleet.check(run).overall}")
