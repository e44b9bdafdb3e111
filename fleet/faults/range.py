"""Range: what is received depends on how far apart sender and receiver are."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta

from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.rules import Act, Effect, LinkRule
from fleet.model.units import NS_PER_S

Distance = Annotated[float, Meta(gt=0.0, le=1e8)]
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


class Range(LinkRule, frozen=True, tag="range", kw_only=True):
    """Loss by the distance d of sender and receiver; beyond `max_m` nothing is received.

    cutoff: no other loss. log_distance: path loss, shadowing and bit errors, see `_bit_errors`.
    rayleigh: received with probability exp(-(d / scale)^2). polynomial: lost with probability
    quadratic d^2 + linear d, at most 1.
    """

    model: Literal["cutoff", "log_distance", "rayleigh", "polynomial"] = "cutoff"
    max_m: Distance | None = None
    power_dbm: Decibels = 20.0
    reference_loss_db: Decibels = 40.0
    exponent: Annotated[float, Meta(gt=0.0, le=10.0)] = 2.0
    shadowing_db: Annotated[float, Meta(ge=0.0, le=50.0)] = 0.0
    noise_dbm: Decibels = -95.0
    floor_dbm: Decibels = -90.0
    scale_m: Distance = 1000.0
    quadratic_per_m2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    linear_per_m: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop by distance; one draw a message, so that less loss never drops another one."""

        def reaches(link_message: LinkMessage, _: Effect) -> bool:
            if link_message.distance_m is None:
                return False  # who does not tell where it is cannot be said to be within range
            loss = self.loss(
                link_message.distance_m, link_message.bits, self._shadow_db(draws, link_message)
            )
            return loss == 0.0 or draws.of_message("range", link_message) >= loss

        return reaches

    def loss(self, distance_m: float, bits: int = 0, shadow_db: float = 0.0) -> float:
        """Probability that a message of so many bits is lost at this distance."""
        if self.max_m is not None and distance_m > self.max_m:
            return 1.0
        match self.model:
            case "cutoff":
                return 0.0
            case "log_distance":
                bit_errors = self._bit_errors(distance_m, shadow_db)
                return -math.expm1(bits * math.log1p(-bit_errors)) if bit_errors < 1.0 else 1.0
            case "rayleigh":
                return -math.expm1(-((distance_m / self.scale_m) ** 2))
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
        path_loss_db = self.reference_loss_db + 10.0 * self.exponent * math.log10(
            max(1.0, distance_m)
        )
        received_dbm = self.power_dbm - path_loss_db + shadow_db
        if received_dbm < self.floor_dbm:
            return 1.0
        snr = 10.0 ** ((received_dbm - self.noise_dbm) / 10.0)
        return 0.5 * math.erfc(math.sqrt(snr))

    def _shadow_db(self, draws: Draws, link_message: LinkMessage) -> float:
        """Log-normal shadowing, the same both ways and for a second."""
        if self.model != "log_distance" or self.shadowing_db == 0.0:
            return 0.0
        pair = min(link_message.src, link_message.dst), max(link_message.src, link_message.dst)
        return self.shadowing_db * draws.normal("shadow", *pair, link_message.t_ns // NS_PER_S)
