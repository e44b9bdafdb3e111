"""Rules of a fault plan that are possible, but can do nothing in a run, and why.

A rule acts on somebody at some time: one about links on a message of some class, from one to
another; one about participants on a process that is up. Nothing is said of what only chance or the
flight decide, as how far away anybody comes.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.faults.lifecycle import UP, ProcessRule, Severity
from fleet.faults.links import LinkRule
from fleet.faults.rules import NodeRule, Rule
from fleet.faults.whom import names
from fleet.model.equipment import broadcasts, computes, hears
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns, to_s
from fleet.protocol.classes import DELIVERY_ORDER, hears_class
from fleet.protocol.messages import Ack, Command, Election, Heartbeat, StateBroadcast


def idle_rules(s: Scenario, *, realtime: bool = False) -> list[str]:
    """Rules that do nothing in this run; a line each, with the reason.

    Of several that do the same, the last ones do nothing.
    """
    if not s.fault:
        return []
    run, found = _Run(s, realtime=realtime), dict[int, str]()
    for n in reversed(range(len(s.fault))):
        why = run.why(n)
        if why:
            found[n] = why
            run.drop(n)
    return [f"fault[{n}] ({s.fault[n].name}) does nothing: {found[n]}" for n in sorted(found)]


class _Run:
    """Who takes part, who can send what to whom, and who is up when."""

    def __init__(self, scenario: Scenario, *, realtime: bool) -> None:
        self._scenario, self._plan = scenario, scenario.fault
        self._traffic = Traffic(scenario)
        self._delays_s = {
            n: r.longest_s() for n, r in enumerate(self._plan) if isinstance(r, LinkRule)
        }
        self._realtime = realtime
        self._patterns: dict[str, frozenset[int]] = {}
        self._hit = {
            n: [x for x in self._traffic.present if rule.hits(x)]
            for n, rule in enumerate(self._plan)
            if isinstance(rule, NodeRule)
        }
        self._stops: defaultdict[int, list[int]] = defaultdict(list)
        for n, nodes in self._hit.items():
            if isinstance(self._plan[n], ProcessRule):
                for node in nodes:
                    self._stops[node].append(n)

    def drop(self, n: int) -> None:
        """Look at the other rules without this one."""
        for node in self._hit.get(n, ()):
            if n in self._stops[node]:
                self._stops[node].remove(n)

    def why(self, n: int) -> str:
        """Why a rule does nothing; empty if it may."""
        rule = self._plan[n]
        why = self._when(rule) or rule.idle(self._slack_s(n))
        if why:
            return why
        if isinstance(rule, LinkRule):
            return self._link(rule)
        return self._node(n, rule) if isinstance(rule, NodeRule) else ""

    def _when(self, rule: Rule) -> str:
        """Why its window is empty."""
        s = self._scenario
        if -(-to_ns(rule.start_s) // s.tick_ns) >= s.ticks:
            return f"it begins at {rule.start_s:g} s, and the run ends at {s.duration_s:g} s"
        if rule.end_s is None or self._ticks(rule):
            return ""
        found = "no tick" if to_ns(rule.start_s) else "no tick but the first, which all take,"
        return f"there is {found} in its window from {rule.start_s:g} s to {rule.end_s:g} s"

    def _slack_s(self, n: int) -> float:
        """What a rule can add to a delay unnoticed, in view of what the others may add."""
        if self._realtime:
            return 0.0
        others_s = math.fsum(d for m, d in self._delays_s.items() if m != n)
        return max(0.0, to_s(self._scenario.tick_ns) - others_s)

    def _ticks(self, rule: Rule) -> range:
        """The ticks in which it may act.

        Nobody is stopped in tick 0, or slow in the first tick of a rule. What is sent in the last
        tick is not received any more. Commands that come between two ticks are answered with the
        time at which they came, but in the tick after that.
        """
        s = self._scenario
        end = s.ticks + isinstance(rule, NodeRule)
        first = -(-to_ns(rule.start_s) // s.tick_ns)
        if rule.end_s is not None:
            end = min(end, -(-to_ns(rule.end_s) // s.tick_ns) + self._answers_later(rule))
        if isinstance(rule, ProcessRule):
            first = max(1, first + (rule.presence(0) == UP))
        return range(first, end)

    def _answers_later(self, rule: Rule) -> bool:
        """Whether it may concern answers of a time between two ticks."""
        between = self._realtime or any(self._delays_s.values())
        window = rule.end_s is None or rule.start_s < rule.end_s
        return between and window and isinstance(rule, LinkRule) and Ack.kind in _wanted(rule)

    def _node(self, n: int, rule: NodeRule) -> str:
        """Why it does nothing to any process."""
        nodes, ticks = self._hit[n], self._ticks(rule)
        if not nodes:
            return "this run has no coordinator"
        if isinstance(rule, ProcessRule):
            if all(not _left(ticks, self._off(x, n)) for x in nodes):
                return "other rules have stopped whom it concerns already"
            return ""
        nodes = [x for x in nodes if self._traffic.is_heard(x)]
        if not nodes:
            return "nobody hears of whom it concerns"
        if all(not _left(ticks, self._off(x)) for x in nodes):
            return "whom it concerns is stopped by other rules then"
        return ""

    def _off(self, node: int, but: int | None = None) -> list[range]:
        """When a process is stopped by rules; of one of these, by those that do as much."""
        found = []
        for m in self._stops[node]:
            if m == but:
                continue
            rule = self._plan[m]
            if self._throughout(rule) if but is None else self._outdoes(rule, self._plan[but]):
                found.append(self._ticks(rule))
        return found

    def _throughout(self, rule: Rule) -> bool:
        """Whether nobody whom it concerns takes a step while it is in force."""
        return isinstance(rule, ProcessRule) and rule.severity > Severity.SOME_STEPS

    def _outdoes(self, one: Rule, other: Rule) -> bool:
        """Whether while `one` is in force it makes no difference that `other` is."""
        if not (isinstance(one, ProcessRule) and isinstance(other, ProcessRule)):
            return False
        return one.outdoes(other, self._ticks(one).start - self._ticks(other).start)

    def _link(self, rule: LinkRule) -> str:
        """Why it does nothing to any message."""
        alike = self._alike(rule)
        link_messages = [
            (a, b)
            for a in alike
            for b in alike
            if a != b and a in self._named(rule.src) and b in self._named(rule.dst)
            if any(self._traffic.sends(kind, a, b) for kind in _wanted(rule))
        ]
        if not link_messages:
            return "in this run nobody sends such messages to such a receiver"
        link_messages = [(a, b) for a, b in link_messages if rule.between(a, b)]
        if not link_messages:
            return "in this run it is between none of those whom such messages would reach"
        ticks = self._ticks(rule)
        after = range(ticks.start, self._scenario.ticks + 1)
        if not any(
            _left(ticks, self._off(a)) and _left(after, self._off(b)) for a, b in link_messages
        ):
            return "other rules have stopped senders or receivers then"
        return ""

    def _named(self, who: str) -> frozenset[int]:
        """The participants whom a pattern names."""
        if who not in self._patterns:
            found = (x for x in self._traffic.present if names(who, x))
            self._patterns[who] = frozenset(found)
        return self._patterns[who]

    def _alike(self, rule: LinkRule) -> list[int]:
        """Of participants that nothing tells apart here, two."""
        seen: Counter[object] = Counter()
        out = []
        for x in self._traffic.present:
            named = x in self._named(rule.src), x in self._named(rule.dst)
            key = (self._traffic.equipment.get(x), named, rule.trait(x), tuple(self._stops[x]))
            seen[key] += 1
            if seen[key] <= 2:
                out.append(x)
        return out


class Traffic:
    """Who can send what to whom, by equipment; who hears it is as in `Agent` and `Coordinator`."""

    def __init__(self, scenario: Scenario) -> None:
        self.present = participants(scenario)
        self.equipment = {u.id: str(u.equipment) for u in uavs_of(scenario)}
        known = [e for e in self.equipment.values() if broadcasts(e)]
        self._elects = len(known) > 1 and any(map(computes, known))
        self._commands = self._elects and scenario.resolver != "none"

    def is_heard(self, node: int) -> bool:
        """Whether anybody hears of a participant what it takes its time and place to be."""
        return node == COORDINATOR or broadcasts(self.equipment[node])

    def sends(self, kind: str, src: int, dst: int) -> bool:
        """Whether one may send messages of a class that reach the other."""
        own, its = self.equipment.get(src), self.equipment.get(dst)  # None: the coordinator
        if its is not None and not hears(its):
            return False
        match kind:
            case StateBroadcast.kind:
                return own is not None and broadcasts(own)
            case Heartbeat.kind:
                return own is None and its is not None
            case Election.kind:
                return self._elects and its is not None and (own is None or computes(own))
            case Command.kind:
                return self._commands and _leads(own) and _follows(its)
            case Ack.kind:
                return self._commands and _follows(own) and _leads(its)
        return hears_class(dst, kind)  # nothing is known of who sends others


def _leads(equipment: str | None) -> bool:
    return equipment is not None and computes(equipment)


def _follows(equipment: str | None) -> bool:
    """Whether it can be commanded: it hears, and others know of it."""
    return equipment is not None and hears(equipment) and broadcasts(equipment)


def _left(ticks: range, taken: Iterable[range]) -> bool:
    """Whether some of these ticks are in none of the others."""
    at = ticks.start
    for other in sorted(taken, key=lambda r: r.start):
        if other.start > at:
            break
        at = max(at, other.stop)
    return at < ticks.stop


def _wanted(rule: LinkRule) -> tuple[str, ...]:
    """The classes of messages that it concerns."""
    return DELIVERY_ORDER if rule.classes == "*" else tuple(rule.classes.split(","))
