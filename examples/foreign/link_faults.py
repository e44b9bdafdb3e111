"""What the fault plan of a run does to messages on their way to one receiver.

Written from docs/protocol/faults.md alone, with nothing but the standard library.
"""

from __future__ import annotations

import hashlib
import math
from collections import deque
from dataclasses import dataclass
from typing import Any

Rule = dict[str, Any]
MASK = 2**64 - 1


def mixed(word: int, label: int) -> int:
    """The number at place `label` of the SplitMix64 stream that `word` seeds."""
    word = (word + (label + 1) * 0x9E3779B97F4A7C15) & MASK
    word = ((word ^ (word >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    word = ((word ^ (word >> 27)) * 0x94D049BB133111EB) & MASK
    return word ^ (word >> 31)


def uniform(seed: int, place: int, purpose: str, *labels: int) -> float:
    """A number in (0, 1) of the rule at a place of the plan: the same for the same labels."""
    text, key = f"{purpose}|{place}".encode(), seed.to_bytes(8, "little")
    word = int.from_bytes(hashlib.blake2b(text, digest_size=8, key=key).digest(), "little")
    for label in labels:
        word = mixed(word, label)
    return ((word >> 12) + 0.5) * 2.0**-52


def normal(one: float, two: float) -> float:
    """Standard normal, of two uniform numbers."""
    return math.sqrt(-2.0 * math.log(one)) * math.cos(math.tau * two)


def names(pattern: str, number: int) -> bool:
    """Whether `*`, `uav`, `coordinator` or a list as `1-4,7` names a participant."""
    words = {"*": (0, MASK), "uav": (1, MASK), "coordinator": (0, 0)}
    for part in pattern.split(","):
        first, _, last = part.partition("-")
        low, high = words.get(part) or (int(first), int(last or first))
        if low <= number <= high:
            return True
    return False


@dataclass
class OnLink:
    """A message on the way to a receiver, and what rules have made of it so far."""

    kind: str
    src: int
    dst: int
    seq: int
    t_ns: int
    bits: int
    distance_m: float | None = None
    delay_s: float = 0.0
    copies_s: tuple[float, ...] = ()


class Links:
    """All links to one receiver; a rule is known by its place in the plan."""

    def __init__(self, plan: list[Rule], seed: int, tick_ns: int) -> None:
        self.plan, self.seed, self.tick_ns = plan, seed, tick_ns
        self.bursts: dict[tuple[int, int], list[bool]] = {}
        self.queues: dict[tuple[int, int], deque[int]] = {}

    def able(self) -> set[str]:
        """Kinds about links that this receiver can apply."""
        return {name[4:] for name in dir(self) if name.startswith("act_")}

    def unable(self) -> list[str]:
        """Kinds in the plan that it cannot apply: it has to leave then."""
        able = {"kill", "pause", "slow"} | self.able()
        bits = {"corrupt" for r in self.plan if r["kind"] == "corrupt" and not r["frame_check"]}
        return sorted({r["kind"] for r in self.plan} - able | bits)

    def fate(self, sent: OnLink) -> list[int] | str:
        """Delays of every delivery in ns, or the kind of the rule that drops the message."""
        for place, rule in enumerate(self.plan):
            act = getattr(self, f"act_{rule['kind']}", None)
            if act and self.concerns(rule, sent) and not act(rule, place, sent):
                return str(rule["kind"])
        first_ns = round(sent.delay_s * 1e9)
        return [first_ns, *(first_ns + round(later_s * 1e9) for later_s in sent.copies_s)]

    @staticmethod
    def concerns(rule: Rule, sent: OnLink) -> bool:
        """Whether a rule is about a message: by time of sending, class and ends of the link."""
        end_ns = MASK if rule["end_s"] is None else round(rule["end_s"] * 1e9)
        during = round(rule["start_s"] * 1e9) <= sent.t_ns < end_ns
        of_class = rule["class"] == "*" or sent.kind in rule["class"].split(",")
        ends = names(rule["src"], sent.src) and names(rule["dst"], sent.dst)
        return bool(during and of_class and ends and sent.src != sent.dst)

    def drawn(self, rule: Rule, place: int, purpose: str, *labels: int) -> float:
        """A number of a rule, whose seed may be its own."""
        seed = self.seed if rule["seed"] is None else rule["seed"]
        return uniform(seed, place, purpose, *labels)

    def draw(self, rule: Rule, place: int, sent: OnLink, purpose: str, count: int = 0) -> float:
        """The same for one message on one link."""
        labels = count, sent.dst, sent.src, sent.seq
        return self.drawn(rule, place, f"{purpose} of {sent.kind}", *labels)

    def happens(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Whether what has a probability happens to a message."""
        return bool(self.draw(rule, place, sent, rule["kind"]) < rule["probability"])

    def act_latency(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Delay by a fixed part and a random one, from 0 to `cap_s`."""
        part, distribution = 0.0, rule["distribution"]
        if distribution == "lognormal":
            one, two = (self.draw(rule, place, sent, "latency", n) for n in (1, 2))
            part = math.exp(rule["sigma"] * normal(one, two))
        elif distribution != "constant":
            u = self.draw(rule, place, sent, "latency")
            part = 2.0 * u - 1.0 if distribution == "uniform" else -math.log(u)
        delay_s = rule["base_s"] + rule["jitter_s"] * part
        sent.delay_s += min(max(0.0, delay_s), rule["cap_s"])
        return True

    def act_reorder(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Hold back."""
        sent.delay_s += rule["delay_s"] if self.happens(rule, place, sent) else 0.0
        return True

    def act_duplicate(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Deliver once more."""
        sent.copies_s += (rule["delay_s"],) if self.happens(rule, place, sent) else ()
        return True

    act_replay = act_duplicate

    def act_loss(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Drop."""
        return not self.happens(rule, place, sent)

    act_corrupt = act_loss  # with a frame check: the link drops what has flipped bits

    def act_partition(self, rule: Rule, _place: int, sent: OnLink) -> bool:
        """Drop what goes from group to group."""
        groups = rule["groups"].split("/")
        src, dst = ({g for g in groups if names(g, n)} for n in (sent.src, sent.dst))
        return not src or not dst or bool(src & dst)

    def act_burst(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Drop what is sent while the link is bad: a chain of two states, tick by tick."""
        leave = 1.0 / rule["mean_ticks"]
        enter = rule["loss"] * leave / (1.0 - rule["loss"])
        bad = self.bursts.setdefault((place, sent.src), [])
        while len(bad) <= sent.t_ns // self.tick_ns:
            u = self.drawn(rule, place, "burst", sent.src, sent.dst, len(bad))
            bad.append(u < rule["loss"] if not bad else u >= leave if bad[-1] else u < enter)
        return not bad[sent.t_ns // self.tick_ns]

    def act_rate(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Send one after the other; drop what finds the queue full."""
        ends_ns = self.queues.setdefault((place, sent.src), deque())
        while ends_ns and ends_ns[0] <= sent.t_ns:
            ends_ns.popleft()
        if len(ends_ns) > rule["queue"]:
            return False
        begin_ns = ends_ns[-1] if ends_ns else sent.t_ns
        ends_ns.append(begin_ns + round(sent.bits / rule["bits_per_s"] * 1e9))
        sent.delay_s += (ends_ns[-1] - sent.t_ns) / 1e9
        return True

    def act_range(self, rule: Rule, place: int, sent: OnLink) -> bool:
        """Drop by distance."""
        if sent.distance_m is None:
            return False
        loss = self.range_loss(rule, place, sent, sent.distance_m)
        return loss == 0.0 or self.draw(rule, place, sent, "range") >= loss

    def range_loss(self, rule: Rule, place: int, sent: OnLink, d_m: float) -> float:
        """The probability that a message is lost over a distance."""
        if rule["max_m"] is not None and d_m > rule["max_m"]:
            return 1.0
        if rule["model"] == "rayleigh":
            return -math.expm1(-((d_m / rule["scale_m"]) ** 2))
        if rule["model"] == "polynomial":
            return min(1.0, float(rule["quadratic_per_m2"] * d_m + rule["linear_per_m"]) * d_m)
        if rule["model"] == "cutoff":
            return 0.0
        pair_and_second = *sorted((sent.src, sent.dst)), sent.t_ns // 10**9
        one, two = (self.drawn(rule, place, "shadow", *pair_and_second, n) for n in (1, 2))
        power_dbm = rule["power_dbm"] - rule["reference_loss_db"]
        power_dbm -= 10.0 * rule["exponent"] * math.log10(max(1.0, d_m))
        power_dbm += rule["shadowing_db"] * normal(one, two)
        if power_dbm < rule["floor_dbm"]:
            return 1.0
        wrong = 0.5 * math.erfc(math.sqrt(10.0 ** ((power_dbm - rule["noise_dbm"]) / 10.0)))
        return -math.expm1(sent.bits * math.log1p(-wrong))
