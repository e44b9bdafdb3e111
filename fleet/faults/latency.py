"""Latency: messages come later."""

from __future__ import annotations

import math
from typing import Literal

from fleet.faults.draws import LEAST, Draws, LinkMessage
from fleet.faults.rules import Act, Delay, Effect, LinkRule, too_short


class Latency(LinkRule, frozen=True, tag="latency", kw_only=True):
    """A delay of `base_s` plus a random part of scale `jitter_s`, in all at most `cap_s`.

    constant: no random part. uniform: over [-jitter, jitter]. exponential: of mean jitter.
    lognormal: jitter exp(Z), Z standard normal.
    """

    base_s: Delay = 0.0
    jitter_s: Delay = 0.0
    distribution: Literal["constant", "uniform", "exponential", "lognormal"] = "uniform"
    cap_s: Delay = 3600.0

    @property
    def longest_s(self) -> float:
        """With the greatest draw that there is."""
        match self.distribution:
            case "constant":
                most = 0.0
            case "uniform":
                most = 1.0
            case "exponential":
                most = -math.log(LEAST)
            case "lognormal":
                most = math.exp(math.sqrt(-2.0 * math.log(LEAST)))
        return min(self.base_s + most * self.jitter_s, self.cap_s)

    def idle(self, slack_s: float) -> str:
        """Why nothing comes later."""
        return too_short(self.longest_s, slack_s)

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Add to the delay."""

        def delay(link_message: LinkMessage, course: Effect) -> bool:
            course.delay_s += min(
                max(0.0, self.base_s + self._random_s(draws, link_message)), self.cap_s
            )
            return True

        return delay

    def _random_s(self, draws: Draws, link_message: LinkMessage) -> float:
        match self.distribution:
            case "constant":
                return 0.0
            case "uniform":
                return self.jitter_s * (2.0 * draws.of_message("latency", link_message) - 1.0)
            case "exponential":
                return -self.jitter_s * math.log(draws.of_message("latency", link_message))
            case "lognormal":
                return self.jitter_s * math.exp(draws.normal_of_message("latency", link_message))
