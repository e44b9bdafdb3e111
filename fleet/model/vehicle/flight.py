"""Flight of one UAV: the 3-DOF point mass of eq. 1 to 3 and the controller that steers it.

Frames: L is local North-East-Down, V the velocity frame (x along the velocity, y to the right and
level, z completing the set). Eq. 1 resolved for the rates, under specific force (f_x, f_y, f_z):

    dV/dt     = f_x - g sin(gamma)
    dpsi/dt   = f_y / (V cos(gamma))
    dgamma/dt = -(f_z + g cos(gamma)) / V

Eq. 2 carries the velocity into L. The controller is ideal between two ticks: it holds the commanded
rates and trims gravity all the time, so that a turn is an exact arc and a climb an exact ramp;
`fleet.model.vehicle.models.point_mass` predicts the same curves. What bends is integrated by RK4,
with the controller at every stage; what is straight, as nearly always, needs no integration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from fleet.model.elementary import asin, sin, sincos, tan
from fleet.model.units import GRAVITY_MPS2, wrap_angle
from fleet.model.vehicle.limits import Limits

NO_ARC_RAD = 1e-8
"""Over an arc of this angle the chord is shorter by less than 1 part in 10^17."""

Vector = tuple[float, ...]
Force = tuple[float, float, float]


class State(Struct, frozen=True, gc=False):
    """{V, psi, gamma, P_NED} of one UAV; the NED velocity follows from the first three.

    `heading_rad` is clockwise from north, `flight_path_rad` positive in a climb, `down_m` positive
    below the origin.
    """

    north_m: float
    east_m: float
    down_m: float
    speed_mps: float
    heading_rad: float
    flight_path_rad: float = 0.0

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """Position in L."""
        return (self.north_m, self.east_m, self.down_m)

    @property
    def velocity_ned_mps(self) -> tuple[float, float, float]:
        """Velocity in L (eq. 2)."""
        return _velocity(self.speed_mps, self.heading_rad, self.flight_path_rad)

    @property
    def climb_mps(self) -> float:
        """Vertical speed, positive up."""
        return self.speed_mps * sin(self.flight_path_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class BankLimits(Limits):
    """What the flight controller may ask of the aircraft: above all a bank."""

    bank_rad: float
    flight_path_rad: float
    flight_path_rate_radps: float
    grip_mps2: float = field(init=False)
    """Horizontal acceleration of a turn at the bank limit, g tan(bank)."""

    def __post_init__(self) -> None:
        """Reckon it once: it is asked for all the time."""
        object.__setattr__(self, "grip_mps2", GRAVITY_MPS2 * tan(self.bank_rad))

    def turn_radius_m(self, speed_mps: float) -> float:
        """Radius of that turn."""
        return speed_mps / (self.grip_mps2 / speed_mps)

    def turn_rate_radps(self, speed_mps: float) -> float:
        """Rate of the level coordinated turn at the bank limit, g tan(bank) / V."""
        return self.grip_mps2 / speed_mps

    def steepest_rad(self, speed_mps: float) -> float:
        """The same at each speed."""
        return self.flight_path_rad

    def pitch_rate_radps(self, speed_mps: float) -> float:
        """The same at each speed."""
        return self.flight_path_rate_radps


class Setpoint(Struct, frozen=True, gc=False):
    """What the flight controller is told: speed, heading and climb (paper: Vrel, psi, Hc)."""

    heading_rad: float
    climb_mps: float
    speed_mps: float


class Rates(Struct, frozen=True, gc=False):
    """dV/dt, dpsi/dt and dgamma/dt that the controller holds over one interval."""

    acceleration_mps2: float
    turn_radps: float
    flight_path_radps: float


def velocity_from_local(heading_rad: float, flight_path_rad: float) -> NDArray[np.float64]:
    """T^VL of eq. 3, shape (3, 3): turns a vector given in L into V.

    `derivative` has its gravity column written out, for speed; a test holds the two together.
    """
    (sg, cg), (sp, cp) = sincos(flight_path_rad), sincos(heading_rad)
    return np.array([[cg * cp, cg * sp, -sg], [-sp, cp, 0.0], [sg * cp, sg * sp, cg]])


def derivative(y: Vector, force: Force) -> Vector:
    """d/dt of (north, east, down, V, psi, gamma) under a specific force in V (eq. 1 and 2)."""
    _, _, _, speed, heading, path = y
    (sin_path, cos_path), (sin_heading, cos_heading) = sincos(path), sincos(heading)
    level = speed * cos_path
    return (
        level * cos_heading,
        level * sin_heading,
        -speed * sin_path,
        force[0] - GRAVITY_MPS2 * sin_path,
        force[1] / level,
        -(force[2] + GRAVITY_MPS2 * cos_path) / speed,
    )


def rk4(y: Vector, force: Callable[[Vector], Force], dt_s: float) -> Vector:
    """One classical Runge-Kutta step of `derivative`; the force may depend on the state."""
    k1 = derivative(y, force(y))
    y2 = _along(y, k1, 0.5 * dt_s)
    k2 = derivative(y2, force(y2))
    y3 = _along(y, k2, 0.5 * dt_s)
    k3 = derivative(y3, force(y3))
    y4 = _along(y, k3, dt_s)
    k4 = derivative(y4, force(y4))
    slopes = zip(k1, k2, k3, k4, strict=True)
    return _along(y, [a + 2.0 * b + 2.0 * c + d for a, b, c, d in slopes], dt_s / 6.0)


def _along(y: Vector, slope: Sequence[float], dt_s: float) -> Vector:
    """Further on a straight line; written out, for speed."""
    north, east, down, speed, heading, path = y
    d_north, d_east, d_down, d_speed, d_heading, d_path = slope
    return (
        north + dt_s * d_north,
        east + dt_s * d_east,
        down + dt_s * d_down,
        speed + dt_s * d_speed,
        heading + dt_s * d_heading,
        path + dt_s * d_path,
    )


def controlled_rates(state: State, setpoint: Setpoint, limits: BankLimits, dt_s: float) -> Rates:
    """Rates that reach the command as fast as the limits allow, not passing it within `dt_s`."""
    turn_limit = limits.turn_rate_radps(state.speed_mps)
    climb_angle = asin(_clip(setpoint.climb_mps / state.speed_mps, 1.0))
    path_error = _clip(climb_angle, limits.flight_path_rad) - state.flight_path_rad
    return Rates(
        _clip((setpoint.speed_mps - state.speed_mps) / dt_s, limits.acceleration_mps2),
        _clip(wrap_angle(setpoint.heading_rad - state.heading_rad) / dt_s, turn_limit),
        _clip(path_error / dt_s, limits.flight_path_rate_radps),
    )


def specific_force(y: Vector, rates: Rates) -> Force:
    """The specific force in V that gives `rates` at this state: eq. 1 solved for F/m."""
    _, _, _, speed, _, path = y
    sine, cosine = sincos(path)
    return (
        rates.acceleration_mps2 + GRAVITY_MPS2 * sine,
        rates.turn_radps * speed * cosine,
        -(GRAVITY_MPS2 * cosine + speed * rates.flight_path_radps),
    )


def fly(state: State, setpoint: Setpoint, limits: BankLimits, dt_s: float) -> State:
    """The state `dt_s` later (dt_s > 0, one tick or less) under a command."""
    if _steady(state, setpoint):
        return _cruise(state, dt_s)
    rates = controlled_rates(state, setpoint, limits, dt_s)
    turned, tilted = dt_s * rates.turn_radps, dt_s * rates.flight_path_radps
    if abs(turned) < NO_ARC_RAD and abs(tilted) < NO_ARC_RAD:
        return _straight_on(state, dt_s * rates.acceleration_mps2, turned, tilted, dt_s)
    y = (
        state.north_m,
        state.east_m,
        state.down_m,
        state.speed_mps,
        state.heading_rad,
        state.flight_path_rad,
    )
    north, east, down, speed, heading, path = rk4(y, lambda v: specific_force(v, rates), dt_s)
    return State(north, east, down, speed, wrap_angle(heading), path)


def _steady(state: State, setpoint: Setpoint) -> bool:
    """Whether a level flight goes on as it is, as nearly always."""
    return (
        setpoint.heading_rad == state.heading_rad
        and setpoint.speed_mps == state.speed_mps
        and setpoint.climb_mps == 0.0
        and state.flight_path_rad == 0.0
    )


def _cruise(state: State, dt_s: float) -> State:
    """What `_straight_on` comes to where all rates are 0, with the same bits."""
    heading, speed = state.heading_rad + 0.0, state.speed_mps
    sine, cosine = sincos(heading)
    return State(
        state.north_m + dt_s * (speed * cosine),
        state.east_m + dt_s * (speed * sine),
        state.down_m,
        speed,
        wrap_angle(heading),
    )


def _straight_on(
    state: State, faster_mps: float, turned_rad: float, tilted_rad: float, dt_s: float
) -> State:
    """The state after a chord, so near to the arc that no float lies between."""
    heading, path = state.heading_rad + turned_rad, state.flight_path_rad + tilted_rad
    mean_mps = state.speed_mps + 0.5 * faster_mps
    middle = (state.heading_rad + 0.5 * turned_rad, state.flight_path_rad + 0.5 * tilted_rad)
    north, east, down = _velocity(mean_mps, *middle)
    return State(
        state.north_m + dt_s * north,
        state.east_m + dt_s * east,
        state.down_m + dt_s * down,
        state.speed_mps + faster_mps,
        wrap_angle(heading),
        path,
    )


def _velocity(
    speed_mps: float, heading_rad: float, flight_path_rad: float
) -> tuple[float, float, float]:
    """The velocity in L (eq. 2)."""
    sine, cosine = sincos(heading_rad)
    if flight_path_rad == 0.0:
        return speed_mps * cosine, speed_mps * sine, -speed_mps * flight_path_rad
    climbing, level = sincos(flight_path_rad)
    return (
        speed_mps * level * cosine,
        speed_mps * level * sine,
        -speed_mps * climbing,
    )


def _clip(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))
