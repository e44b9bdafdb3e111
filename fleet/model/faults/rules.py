"""The rules of a fault plan, one table each: `[[fault]]` in a scenario.

Every rule says which messages it is for: `src` and `dst` (`*`, `uav`, `coordinator`, or UAV numbers
as "1" or "1,2"), `class` (`*` or adsb, election, cmd, ack, or several as "cmd,ack"), and the window
[start_s, end_s) of simulated time of sending.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from fleet.model.faults.draws import Hop

Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
Delay = Annotated[float, Meta(ge=0.0, le=3600.0)]
Moment = Annotated[float, Meta(ge=0.0)]
Who = Annotated[str, Meta(pattern=r"^(\*|uav|coordinator|\d+(,\d+)*)$")]
Classes = Annotated[str, Meta(pattern=r"^(\*|(adsb|election|cmd|ack)(,(adsb|election|cmd|ack))*)$")]

COORDINATOR = 0


class Rule(Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """What all rules have: whom and when they concern."""

    src: Who = "*"
    dst: Who = "*"
    classes: Classes = field(default="*", name="class")
    start_s: Moment = 0.0
    end_s: Moment = math.inf

    def concerns(self, hop: Hop) -> bool:
        """Whether a message on a link falls under this rule."""
        return (
            self.start_s <= hop.t_ns / 1e9 < self.end_s
            and (self.classes == "*" or hop.kind in self.classes.split(","))
            and names(self.src, hop.src)
            and names(self.dst, hop.dst)
        )

    @property
    def name(self) -> str:
        """Its kind, as in the scenario."""
        return str(self.__struct_config__.tag)


class Latency(Rule, frozen=True, tag="latency", kw_only=True):
    """A delay of `base_s` plus a random part of scale `jitter_s`, at most `cap_s`.

    constant: no random part. uniform: over [-jitter, jitter]. exponential: of mean jitter.
    lognormal: jitter exp(Z), Z standard normal.
    """

    base_s: Delay = 0.0
    jitter_s: Delay = 0.0
    distribution: Literal["constant", "uniform", "exponential", "lognormal"] = "uniform"
    cap_s: Delay = 3600.0


class Loss(Rule, frozen=True, tag="loss", kw_only=True):
    """Each message is lost with `probability`, independently on every link."""

    probability: Probability


class Burst(Rule, frozen=True, tag="burst", kw_only=True):
    """Gilbert-Elliott: a link is good or bad from tick to tick; a bad one loses everything.

    Given as the mean loss L and the mean length b of a burst in ticks: r = 1/b, p = L r / (1 - L).
    """

    loss: Annotated[float, Meta(ge=0.0, lt=1.0)]
    mean_ticks: Annotated[float, Meta(ge=1.0, le=1e6)] = 5.0

    @property
    def leave(self) -> float:
        """Probability r that a bad link becomes good in a tick."""
        return 1.0 / self.mean_ticks

    @property
    def enter(self) -> float:
        """Probability p that a good link becomes bad in a tick."""
        return self.loss * self.leave / (1.0 - self.loss)


class Partition(Rule, frozen=True, tag="partition", kw_only=True):
    """No message passes between the groups, "1,2/3,4"; who is in none of them hears everybody."""

    groups: Annotated[
        str,
        Meta(
            pattern=r"^(coordinator|\d+)(,(coordinator|\d+))*(/(coordinator|\d+)(,(coordinator|\d+))*)+$"
        ),
    ]

    def parts(self, hop: Hop) -> bool:
        """Whether source and receiver are in different groups."""
        sides = [
            {COORDINATOR if m == "coordinator" else int(m) for m in group.split(",")}
            for group in self.groups.split("/")
        ]
        of_src = [n for n, side in enumerate(sides) if hop.src in side]
        of_dst = [n for n, side in enumerate(sides) if hop.dst in side]
        return bool(of_src and of_dst and not set(of_src) & set(of_dst))


class Duplicate(Rule, frozen=True, tag="duplicate", kw_only=True):
    """With `probability` a message is delivered once more, `delay_s` later."""

    probability: Probability
    delay_s: Delay = 0.0


class Corrupt(Rule, frozen=True, tag="corrupt", kw_only=True):
    """With `probability` `bits` bits of a message, chosen at random, are flipped."""

    probability: Probability
    bits: Annotated[int, Meta(ge=1, le=64)] = 1


FaultRule = Latency | Loss | Burst | Partition | Duplicate | Corrupt
FAULT_KINDS = ("latency", "loss", "burst", "partition", "duplicate", "corrupt")


def names(who: str, number: int) -> bool:
    """Whether `*`, `uav`, `coordinator` or a list of numbers names this participant."""
    if who == "*":
        return True
    if who == "uav":
        return number != COORDINATOR
    if who == "coordinator":
        return number == COORDINATOR
    return str(number) in who.split(",")
