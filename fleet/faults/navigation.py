"""Navigation: a UAV is wrong about its own position and velocity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws
from fleet.faults.rules import NodeRule, Probability, Rule
from fleet.model.units import to_ns, to_s
from fleet.model.vehicle.flight import State

OffsetVector = tuple[float, float, float]
OffsetMetres = Annotated[float, Meta(ge=-1e5, le=1e5)]
MetresPerSecond = Annotated[float, Meta(ge=-1e3, le=1e3)]
Noise = Annotated[float, Meta(ge=0.0, le=1e4)]
SpeedNoise = Annotated[float, Meta(ge=0.0, le=100.0)]

LEAST_SENSED_MPS = 1.0
"""A UAV never takes itself to be slower, whatever the noise: courses need a direction."""


class Navigation(NodeRule, frozen=True, tag="navigation", kw_only=True):
    """What the UAV senses of itself is wrong.

    `noise_m` is the standard deviation of north and of east, `vertical_noise_m` of down,
    `velocity_noise_mps` of each component of the velocity: white, from one moment to the next.
    `bias_ned_m` is a constant error of the position, which grows by `drift_ned_mps` from the start
    of the window on. With `freeze` the position stays what it was when first sensed in the window.
    With probability `dropout` nothing is sensed at all.
    """

    noise_m: Noise = 0.0
    vertical_noise_m: Noise = 0.0
    velocity_noise_mps: SpeedNoise = 0.0
    bias_ned_m: tuple[OffsetMetres, OffsetMetres, OffsetMetres] = (0.0, 0.0, 0.0)
    drift_ned_mps: tuple[MetresPerSecond, MetresPerSecond, MetresPerSecond] = (0.0, 0.0, 0.0)
    freeze: bool = False
    dropout: Probability = 0.0

    def idle(self, slack_s: float) -> str:
        """Why it senses what is true."""
        place = self.noise_m, self.vertical_noise_m, *self.bias_ned_m, *self.drift_ned_mps
        wrong = any(place) or self.velocity_noise_mps or self.freeze or self.dropout
        return "" if wrong else "none of its keys makes anything wrong, as noise_m or freeze would"


class Sensors:
    """What one UAV senses of its own state, under one plan; pure but for frozen positions."""

    def __init__(self, plan: Sequence[Rule], seed: int, uav: int) -> None:
        self._seed = seed
        self._uav = uav
        self._frozen: dict[int, OffsetVector] = {}
        self.replan(plan)

    def replan(self, plan: Sequence[Rule]) -> None:
        """Go by another plan from now on, of the same rules and further ones."""
        self._rules = [
            (n, rule, Draws(self._seed, n))
            for n, rule in enumerate(plan)
            if isinstance(rule, Navigation) and rule.hits(self._uav)
        ]

    @property
    def clean(self) -> bool:
        """Whether it always senses the truth."""
        return not self._rules

    def sense(self, state: State, now_ns: int) -> State | None:
        """The state that it takes for its own; None: it does not know where it is."""
        for n, rule, draws in self._rules:
            if not rule.during(now_ns):
                continue
            if draws.uniform("dropout", self._uav, now_ns) < rule.dropout:
                return None
            position = self._position(rule, draws, state, now_ns)
            if rule.freeze:
                position = self._frozen.setdefault(n, position)
            state = _moved(state, position)
            if rule.velocity_noise_mps:
                state = _with_velocity(state, self._velocity(rule, draws, state, now_ns))
        return state

    def _position(self, rule: Navigation, draws: Draws, state: State, now_ns: int) -> OffsetVector:
        since_s = to_s(now_ns - to_ns(rule.start_s))
        sigmas_m = (rule.noise_m, rule.noise_m, rule.vertical_noise_m)
        noise = self._noise("position", sigmas_m, draws, now_ns)
        north, east, down = (
            p + b + d * since_s + e
            for p, b, d, e in zip(
                state.position_ned_m, rule.bias_ned_m, rule.drift_ned_mps, noise, strict=True
            )
        )
        return north, east, down

    def _velocity(self, rule: Navigation, draws: Draws, state: State, now_ns: int) -> OffsetVector:
        noise = self._noise("velocity", (rule.velocity_noise_mps,) * 3, draws, now_ns)
        north, east, down = (v + e for v, e in zip(state.velocity_ned_mps, noise, strict=True))
        return north, east, down

    def _noise(self, purpose: str, sigmas: OffsetVector, draws: Draws, now_ns: int) -> list[float]:
        return [
            sigma * draws.normal(purpose, self._uav, now_ns, axis) if sigma else 0.0
            for axis, sigma in enumerate(sigmas)
        ]


def _moved(state: State, position_ned_m: OffsetVector) -> State:
    return State(*position_ned_m, state.speed_mps, state.heading_rad, state.flight_path_rad)


def _with_velocity(state: State, velocity_ned_mps: OffsetVector) -> State:
    north, east, down = velocity_ned_mps
    speed = max(math.hypot(north, east, down), LEAST_SENSED_MPS)
    path = math.asin(max(-1.0, min(1.0, -down / speed)))
    return State(*state.position_ned_m, speed, math.atan2(east, north), path)
