"""Latency: messages come later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import Annotated, Literal, overload

import numpy as np
from msgspec import Meta

from fleet.faults.draws import LEAST, Draws, LinkMessage, LinkMessageColumns
from fleet.faults.links import Act, ActTogether, Effect, Floats, Harm, LinkRule, too_short
from fleet.faults.options import RuleTable, Shorthand, Variation, what
from fleet.faults.quantities import delay_s
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Delay, Dice
from fleet.model.elementary import exp, log, log1p
from fleet.model.types import Truths

Sigma = Annotated[float, Meta(ge=0.0, le=5.0)]


@fault_kind
class Latency(LinkRule, frozen=True, tag="latency", kw_only=True):
    """Delays: by `base_s` and a random part. Latencies of several rules add up.

    Less than a tick is a tick.
    """

    base_s: Annotated[Delay, Meta(description="the part that is always the same")] = 0.0
    jitter_s: Annotated[Delay, Meta(description="scale of the random part")] = 0.0
    distribution: Annotated[
        Literal["constant", "uniform", "exponential", "lognormal"],
        Meta(
            description="`uniform` over +-`jitter_s`; `exponential` of that mean; `lognormal`: "
            "`jitter_s` exp(`sigma` Z), Z standard normal; `constant`: no random part"
        ),
    ] = "uniform"
    sigma: Annotated[Sigma, Meta(description="how wide `lognormal` is")] = 1.0
    cap_s: Annotated[Delay, Meta(description="greatest delay by this rule; the least is 0")] = (
        3600.0
    )

    harms = Harm.DELAY
    shorthands = (
        Shorthand(
            option="latency",
            metavar="TIME",
            help="Delay every message, as 300ms or 2s.",
            example="300ms",
            make=what("base_s", delay_s),
        ),
        Variation(
            option="jitter",
            metavar="TIME",
            help="Vary that delay uniformly by so much.",
            example="50ms",
            of="latency",
            parse=delay_s,
            vary=lambda table, jitter_s: {**table, "jitter_s": jitter_s},
            alone="0s",
            note="alone: `latency` with nothing else",
        ),
    )

    def longest_s(self, _bits: float = math.inf) -> float:
        """With the greatest draw that there is."""
        match self.distribution:
            case "constant":
                most = 0.0
            case "uniform":
                most = 1.0
            case "exponential":
                most = -log(LEAST)
            case "lognormal":
                most = exp(self.sigma * math.sqrt(-2.0 * log(LEAST)))
        return min(self.base_s + most * self.jitter_s, self.cap_s)

    def idle(self, slack_s: float) -> str:
        """Why nothing comes later."""
        return too_short(self.longest_s(), slack_s)

    def act(self, draws: Draws, _tick_ns: int) -> Act:
        """Add to the delay."""

        def delay(link_message: LinkMessage, effect: Effect) -> bool:
            effect.delay_s += min(
                max(0.0, self.base_s + self._random_s(draws, link_message)), self.cap_s
            )
            return True

        return delay

    def act_together(self, _act: Act, draws: Draws) -> ActTogether:
        """The same to several."""

        def delay(sent: LinkMessageColumns) -> tuple[Floats, Truths]:
            delays_s = np.zeros(len(sent.src)) + (self.base_s + self._random_s(draws, sent))
            return np.clip(delays_s, 0.0, self.cap_s), np.ones(len(delays_s), dtype=np.bool_)

        return delay

    @overload
    def _random_s(self, draws: Draws, sent: LinkMessage) -> float: ...

    @overload
    def _random_s(self, draws: Draws, sent: LinkMessageColumns) -> float | Floats: ...

    def _random_s(self, draws: Draws, sent: LinkMessage | LinkMessageColumns) -> float | Floats:
        match self.distribution:
            case "constant":
                return 0.0
            case "uniform":
                return self.jitter_s * (2.0 * draws.of_message("latency", sent) - 1.0)
            case "exponential":
                return -self.jitter_s * log(draws.of_message("latency", sent))
            case "lognormal":
                return self.jitter_s * exp(self.sigma * draws.normal_of_message("latency", sent))

    def quantiles_s(self, parts: Floats) -> Floats:
        """The delay rises with the random part."""
        match self.distribution:
            case "constant":
                part = np.zeros(len(parts))
            case "uniform":
                part = self.jitter_s * (2.0 * parts - 1.0)
            case "exponential":
                part = -self.jitter_s * log1p(-parts)
            case "lognormal":
                normal = np.array([NormalDist().inv_cdf(p) for p in parts.tolist()])
                part = self.jitter_s * exp(self.sigma * normal)
        return np.clip(self.base_s + part, 0.0, self.cap_s)

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """From none to longer than an election is valid."""
        return {
            "base_s": dice.choice((0.0, 0.15, 0.5, 1.0, 2.5)),
            "jitter_s": dice.choice((0.0, 0.1, 0.6)),
            "distribution": dice.choice(("constant", "uniform", "exponential", "lognormal")),
            "cap_s": 8.0,
        }
