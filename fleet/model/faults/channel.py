"""What a fault plan does to one message on one link: when it arrives, how often, in what state."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec import Struct

from fleet.model.faults.draws import Draws, Hop
from fleet.model.faults.rules import Burst, Corrupt, Duplicate, FaultRule, Latency, Loss, Partition


class Passage(Struct, frozen=True):
    """One delivery: how much later than sent, and which bits are flipped (places in [0, 1))."""

    delay_ns: int
    flips: tuple[float, ...] = ()


class Fate(Struct, frozen=True):
    """Every delivery of a message; none, and the rule that dropped it."""

    passages: tuple[Passage, ...]
    dropped_by: str = ""


class Channel:
    """All links into one receiver, under one plan; pure but for its memory of burst states."""

    def __init__(self, plan: Sequence[FaultRule], seed: int, tick_ns: int) -> None:
        self._plan = tuple(enumerate(plan))
        self._draws = Draws(seed)
        self._tick_ns = tick_ns
        self._bursts: dict[tuple[int, int, int], bytearray] = {}

    @property
    def clean(self) -> bool:
        """Whether the plan is empty: every message is delivered once, as it is."""
        return not self._plan

    def fate(self, hop: Hop) -> Fate:
        """What becomes of a message: rules in the order of the plan, the first drop wins."""
        delay_s, extra, flips = 0.0, list[float](), tuple[float, ...]()
        for n, rule in self._plan:
            if not rule.concerns(hop):
                continue
            match rule:
                case Latency():
                    delay_s += self._latency_s(n, rule, hop)
                case Duplicate() if self._draws.of_hop("duplicate", n, hop) < rule.probability:
                    extra.append(rule.delay_s)
                case Corrupt() if self._draws.of_hop("corrupt", n, hop) < rule.probability:
                    flips += tuple(self._draws.of_hop("bit", n, hop, b) for b in range(rule.bits))
                case Loss() | Burst() | Partition() if self._drops(n, rule, hop):
                    return Fate((), rule.name)
        first = round(delay_s * 1e9)
        copies = [Passage(first + round(d * 1e9), flips) for d in extra]
        return Fate((Passage(first, flips), *copies))

    def _drops(self, n: int, rule: Loss | Burst | Partition, hop: Hop) -> bool:
        match rule:
            case Loss():
                return self._draws.of_hop("loss", n, hop) < rule.probability
            case Burst():
                return self._bad(n, rule, hop)
            case Partition():
                return rule.parts(hop)

    def _latency_s(self, n: int, rule: Latency, hop: Hop) -> float:
        uniform = self._draws.of_hop("latency", n, hop)
        match rule.distribution:
            case "constant":
                random = 0.0
            case "uniform":
                random = rule.jitter_s * (2.0 * uniform - 1.0)
            case "exponential":
                random = -rule.jitter_s * math.log(uniform)
            case "lognormal":
                random = rule.jitter_s * math.exp(self._draws.normal("latency", n, hop))
        return min(max(0.0, rule.base_s + random), rule.cap_s)

    def _bad(self, n: int, rule: Burst, hop: Hop) -> bool:
        """State of a directed link in the tick of sending; its chain is a function of the seed."""
        states = self._bursts.setdefault((n, hop.src, hop.dst), bytearray())
        tick = hop.t_ns // self._tick_ns
        while len(states) <= tick:
            uniform = self._draws.uniform("burst", n, hop.src, hop.dst, len(states))
            if not states:
                states.append(uniform < rule.loss)  # the chain starts in its stationary state
            elif states[-1]:
                states.append(uniform >= rule.leave)
            else:
                states.append(uniform < rule.enter)
        return bool(states[tick])
