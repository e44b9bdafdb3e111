"""The scene of a play: a scenario of three UAVs, and the two that are played as they would fly."""

from __future__ import annotations

import msgspec

from fleet.agents.vehicle import Vehicle
from fleet.config.loading import convert
from fleet.config.scenario import Scenario
from fleet.model.types import Position
from fleet.protocol.messages import StateBroadcast
from fleet.protocol.surveillance import broadcast_of

PLAYED = (1, 3)
FOREIGN = 2
"""The number of the UAV that is tried."""
SEED = 20_110_805
LOCKSTEP_S, REALTIME_S = 19.0, 4.0
"""How long the plays last."""


def played_scenario(duration_s: float) -> Scenario:
    """Three UAVs side by side; elections are short, so that they can be seen to run out."""
    return convert(
        {
            "name": "conformance",
            "duration_s": duration_s,
            "seed": SEED,
            "coordination": {"election_valid_s": 1.0, "election_repeat_s": 0.4}
            | {"silence_limit_s": 0.8},
            "uav": [
                {
                    "id": n,
                    "position_ned_m": [0.0, 900.0 * (n - 1), -300.0],
                    "heading_deg": 0.0,
                    "waypoints_ned_m": [[6000.0, 900.0 * (n - 1), -300.0]],
                    "equipment": "no_compute" if n == FOREIGN else "full",
                }
                for n in (1, 2, 3)
            ],
        },
        "conformance",
    )


class PlayedUav:
    """Flies its plan, and tells it."""

    def __init__(self, number: int, scenario: Scenario) -> None:
        uav = next(u for u in scenario.uav if u.id == number)
        self._vehicle = Vehicle(uav, scenario)

    def fly_to(self, now_ns: int) -> None:
        """Fly on to a time."""
        self._vehicle.fly_to(now_ns)

    @property
    def position_ned_m(self) -> Position:
        """Where it is."""
        return self._vehicle.state.position_ned_m

    def broadcast(self, now_ns: int) -> StateBroadcast:
        """What it tells at a time, rising from call to call; its number is left to be filled in."""
        self.fly_to(now_ns)
        report = self._vehicle.report(self._vehicle.state, now_ns)
        told = broadcast_of(report, now_ns, 0)
        return msgspec.structs.replace(told, hears=True, equipment="full")
