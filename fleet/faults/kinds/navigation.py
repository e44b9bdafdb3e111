"""Navigation: a UAV is wrong about its own position and velocity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws
from fleet.faults.options import RuleTable, Shorthand, whom, whom_what
from fleet.faults.quantities import metres
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice, Probability
from fleet.faults.sensors import Sense, SensorRule
from fleet.model.elementary import asin, atan2, hypot
from fleet.model.units import to_ns, to_s
from fleet.model.vehicle.flight import State

OffsetVector = tuple[float, float, float]
OffsetMetres = Annotated[float, Meta(ge=-1e5, le=1e5)]
MetresPerSecond = Annotated[float, Meta(ge=-1e3, le=1e3)]
Noise = Annotated[float, Meta(ge=0.0, le=1e4)]
SpeedNoise = Annotated[float, Meta(ge=0.0, le=100.0)]

LEAST_SENSED_MPS = 1.0
"""A UAV never takes itself to be slower, whatever the noise: courses need a direction."""


@fault_kind
class Navigation(SensorRule, frozen=True, tag="navigation", kw_only=True):
    """What a UAV senses of its own position and velocity is wrong; so is what it broadcasts."""

    noise_m: Annotated[
        Noise,
        Meta(description="standard deviation of north and of east; all noise is white and normal"),
    ] = 0.0
    vertical_noise_m: Annotated[Noise, Meta(description="standard deviation of down")] = 0.0
    velocity_noise_mps: Annotated[
        SpeedNoise, Meta(description="standard deviation of each component of the velocity")
    ] = 0.0
    bias_ned_m: Annotated[
        tuple[OffsetMetres, OffsetMetres, OffsetMetres],
        Meta(description="constant error of the position"),
    ] = (0.0, 0.0, 0.0)
    drift_ned_mps: Annotated[
        tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond],
        Meta(description="growth of that error from `start_s` on"),
    ] = (0.0, 0.0, 0.0)
    freeze: Annotated[
        bool,
        Meta(description="the position stays what it was when first sensed in the window"),
    ] = False
    dropout: Annotated[
        Probability,
        Meta(
            description="probability that nothing is sensed, at each moment by itself; the UAV "
            "then does not know where it is, and does not broadcast"
        ),
    ] = 0.0

    shorthands = (
        Shorthand(
            option="gps-noise",
            metavar="[WHO:]LENGTH",
            help="Noise of the UAVs' own positions, as 10m or 2:10m.",
            example="2:10m",
            make=whom_what("noise_m", metres, "2:10m", everybody="uav"),
            note='`10m`: with `node = "uav"`',
        ),
        Shorthand(
            option="gps-freeze",
            metavar="WHO",
            help="UAVs take their positions not to change, as 2@30s+10s.",
            example="2@30s+10s",
            make=whom(freeze=True),
        ),
        Shorthand(
            option="gps-dropout",
            metavar="WHO",
            help="UAVs do not know where they are, as 2@30s+10s.",
            example="2@30s+10s",
            make=whom(dropout=1.0),
        ),
    )

    @property
    def remembers(self) -> bool:
        """Where a position froze."""
        return self.freeze

    def idle(self, _slack_s: float) -> str:
        """Why it senses what is true."""
        place = self.noise_m, self.vertical_noise_m, *self.bias_ned_m, *self.drift_ned_mps
        wrong = any(place) or self.velocity_noise_mps or self.freeze or self.dropout
        return "" if wrong else "none of its keys makes anything wrong, as noise_m or freeze would"

    def sensing(self, draws: Draws, uav: int) -> Sense:
        """Lose it, move it, keep the first position, or add to the velocity."""
        frozen: list[OffsetVector] = []

        def sense(state: State, now_ns: int) -> State | None:
            if draws.uniform("dropout", uav, now_ns) < self.dropout:
                return None
            position = self._position(draws, uav, state, now_ns)
            if self.freeze:
                frozen[:] = frozen or [position]
                position = frozen[0]
            state = _moved(state, position)
            if self.velocity_noise_mps:
                state = _with_velocity(state, self._velocity(draws, uav, state, now_ns))
            return state

        return sense

    def _position(self, draws: Draws, uav: int, state: State, now_ns: int) -> OffsetVector:
        since_s = to_s(now_ns - to_ns(self.start_s))
        sigmas_m = (self.noise_m, self.noise_m, self.vertical_noise_m)
        noise = _noise("position", sigmas_m, draws, uav, now_ns)
        north, east, down = (
            p + b + d * since_s + e
            for p, b, d, e in zip(
                state.position_ned_m, self.bias_ned_m, self.drift_ned_mps, noise, strict=True
            )
        )
        return north, east, down

    def _velocity(self, draws: Draws, uav: int, state: State, now_ns: int) -> OffsetVector:
        noise = _noise("velocity", (self.velocity_noise_mps,) * 3, draws, uav, now_ns)
        north, east, down = (v + e for v, e in zip(state.velocity_ned_mps, noise, strict=True))
        return north, east, down

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Each thing that can be wrong."""
        return dice.choice(
            (
                {"noise_m": 10.0},
                {"bias_ned_m": [300.0, 0.0, 0.0]},
                {"drift_ned_mps": [0.0, 5.0, 0.0]},
                {"freeze": True},
                {"dropout": 0.5},
                {"velocity_noise_mps": 2.0, "vertical_noise_m": 5.0},
            )
        )


def _noise(purpose: str, sigmas: OffsetVector, draws: Draws, uav: int, now_ns: int) -> list[float]:
    return [
        sigma * draws.normal(purpose, uav, now_ns, axis) if sigma else 0.0
        for axis, sigma in enumerate(sigmas)
    ]


def _moved(state: State, position_ned_m: OffsetVector) -> State:
    return State(*position_ned_m, state.speed_mps, state.heading_rad, state.flight_path_rad)


def _with_velocity(state: State, velocity_ned_mps: OffsetVector) -> State:
    north, east, down = velocity_ned_mps
    speed = max(hypot(north, east, down), LEAST_SENSED_MPS)
    path = asin(max(-1.0, min(1.0, -down / speed)))
    return State(*state.position_ned_m, speed, atan2(east, north), path)
