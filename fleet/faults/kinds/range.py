"""Range: what is received depends on how far apart sender and receiver are."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Harm, LinkRule
from fleet.faults.options import RuleTable, Shorthand, what
from fleet.faults.quantities import metres
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice
from fleet.model.elementary import erfc, exp, expm1, log1p, log10
from fleet.model.units import NS_PER_S

Distance = Annotated[float, Meta(ge=1e-3, le=1e8)]
Decibels = Annotated[float, Meta(ge=-300.0, le=300.0)]

MODELS: dict[str, tuple[str, ...]] = {
    "cutoff": (),
    "log_distance": (
        "power_dbm",
        "reference_loss_db",
        "exponent",
        "shadowing_db",
        "noise_dbm",
        "floor_dbm",
    ),
    "rayleigh": ("scale_m",),
    "polynomial": ("quadratic_per_m2", "linear_per_m"),
}
"""The models, and the keys that each alone has."""


LN10 = 2.302585092994046
"""The natural logarithm of 10: decibels are tenths of powers of 10."""


@fault_kind
class Range(LinkRule, frozen=True, tag="range", kw_only=True):
    """Loses messages by the true distance d of sender and receiver when they are sent.

    The coordinator is at `coordination.position_ned_m`. A radio range (`surveillance.range_m`,
    `coordination.range_m`) is no fault: what is beyond it is not lost, and concerns no rule.

    `log_distance`: the power received is `power_dbm` - (`reference_loss_db` + 10 n log10(d / 1 m))
    plus the shadowing (Rappaport, Wireless Communications, 2nd ed., 4.9). With the signal-to-noise
    ratio SNR that this makes with `noise_dbm` a bit is wrong with probability
    e = erfc(sqrt(SNR)) / 2 (BPSK in white noise, SNR taken as that of a bit), and a message of k
    bits is lost with probability 1 - (1 - e)^k. `rayleigh`: a message is received with probability
    exp(-(d / R)^2). `polynomial`: it is lost with probability a d^2 + b d, at most 1.
    """

    model: Annotated[
        Literal["cutoff", "log_distance", "rayleigh", "polynomial"],
        Meta(
            description="`cutoff`: no loss but by `max_m`; `log_distance`, `rayleigh`, "
            "`polynomial`: see above"
        ),
    ] = "cutoff"
    max_m: Annotated[
        Distance | None,
        Meta(description="beyond it nothing is received, whatever the model; `cutoff` needs it"),
    ] = None
    power_dbm: Annotated[
        Decibels, Meta(description="`log_distance`: power sent, antennas included")
    ] = 20.0
    reference_loss_db: Annotated[
        Decibels,
        Meta(description="`log_distance`: path loss at 1 m; 40 dB is free space at 2.4 GHz"),
    ] = 40.0
    exponent: Annotated[
        float,
        Meta(
            ge=0.01,
            le=10.0,
            description="`log_distance`: path loss exponent n; 2 is free space",
        ),
    ] = 2.0
    shadowing_db: Annotated[
        float,
        Meta(
            ge=0.0,
            le=50.0,
            description="`log_distance`: standard deviation of the shadowing, drawn for each pair "
            "and second, the same both ways",
        ),
    ] = 0.0
    noise_dbm: Annotated[
        Decibels,
        Meta(
            description="`log_distance`: noise; -95 dBm is thermal noise over 20 MHz and a noise "
            "figure of 6 dB"
        ),
    ] = -95.0
    floor_dbm: Annotated[
        Decibels, Meta(description="`log_distance`: below it nothing is received")
    ] = -90.0
    scale_m: Annotated[
        Distance, Meta(description="`rayleigh`: R, where exp(-1) = 37 % is received")
    ] = 1000.0
    quadratic_per_m2: Annotated[float, Meta(ge=0.0, le=1.0, description="`polynomial`: a")] = 0.0
    linear_per_m: Annotated[float, Meta(ge=0.0, le=1.0, description="`polynomial`: b")] = 0.0

    harms = Harm.DROP
    by_distance = True
    by_size = True
    shorthands = (
        Shorthand(
            option="range",
            metavar="LENGTH",
            help="Lose what is sent from further away than 500m, 5km or 3NM.",
            example="5km",
            make=what("max_m", metres),
        ),
    )

    def problems(self, _everybody: Sequence[int]) -> Iterator[tuple[str, str]]:
        """Keys that its model needs, and such as it does not have."""
        if self.model == "cutoff" and self.max_m is None:
            yield "max_m", "missing; add it, since model 'cutoff' goes by it"
        if self.model == "polynomial" and not (self.quadratic_per_m2 or self.linear_per_m):
            yield "quadratic_per_m2", "missing, and so is linear_per_m; add one of them"
        defaults = Range()
        for model, keys in MODELS.items():
            for other in keys:
                if model != self.model and getattr(self, other) != getattr(defaults, other):
                    yield other, f"model '{self.model}' does not have it; leave it out"

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Drop by distance; one draw a message, so that less loss never drops another one."""

        def reaches(link_message: LinkMessage, _: Effect) -> bool:
            if link_message.distance_m is None:
                return False  # who does not tell where it is cannot be said to be within range
            loss = self.loss(
                link_message.distance_m, link_message.bits, self._shadow_db(draws, link_message)
            )
            return loss == 0.0 or draws.of_message("range", link_message) >= loss

        return reaches

    def passes(self, link: LinkMessage) -> float | None:
        """1 - loss(d), d the true distance at sending; none with shadowing."""
        shadowed = self.model == "log_distance" and self.shadowing_db > 0.0
        if shadowed or link.distance_m is None:
            return None
        return 1.0 - self.loss(link.distance_m, link.bits)

    def loss(self, distance_m: float, bits: int = 0, shadow_db: float = 0.0) -> float:
        """Probability that a message of so many bits is lost at this distance."""
        if self.max_m is not None and distance_m > self.max_m:
            return 1.0
        match self.model:
            case "cutoff":
                return 0.0
            case "log_distance":
                bit_errors = self._bit_errors(distance_m, shadow_db)
                return -expm1(bits * log1p(-bit_errors)) if bit_errors < 1.0 else 1.0
            case "rayleigh":
                part = distance_m / self.scale_m
                return -expm1(-part * part)
            case "polynomial":
                return min(
                    1.0, (self.quadratic_per_m2 * distance_m + self.linear_per_m) * distance_m
                )

    def _bit_errors(self, distance_m: float, shadow_db: float) -> float:
        """Probability that a bit is wrong; 1 where the signal is too weak to be received at all.

        Path loss: reference + 10 n log10(d / 1 m) (Rappaport, Wireless Communications, 2nd ed.,
        4.9). Bit errors: BPSK in white noise, erfc(sqrt(SNR)) / 2 (Proakis, Digital
        Communications, 4th ed., 5.2), the SNR taken as that of a bit.
        """
        path_loss_db = self.reference_loss_db + 10.0 * self.exponent * log10(max(1.0, distance_m))
        received_dbm = self.power_dbm - path_loss_db + shadow_db
        if received_dbm < self.floor_dbm:
            return 1.0
        snr = exp((received_dbm - self.noise_dbm) * (LN10 / 10.0))
        return 0.5 * erfc(math.sqrt(snr))

    def _shadow_db(self, draws: Draws, link_message: LinkMessage) -> float:
        """Log-normal shadowing, the same both ways and for a second."""
        if self.model != "log_distance" or self.shadowing_db == 0.0:
            return 0.0
        pair = min(link_message.src, link_message.dst), max(link_message.src, link_message.dst)
        return self.shadowing_db * draws.normal("shadow", *pair, link_message.t_ns // NS_PER_S)

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Each model."""
        return dice.choice(
            (
                {"model": "cutoff", "max_m": 300.0},
                {"model": "rayleigh", "scale_m": 400.0},
                {"model": "log_distance", "shadowing_db": 6.0, "exponent": 3.0},
                {"model": "polynomial", "quadratic_per_m2": 5.335e-7, "linear_per_m": 3.395e-5},
            )
        )
