"""Recovery: once no fault is left, who is in conflict has a computing UAV within a stated time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import chain

from fleet.analysis.invariants.index import ARRIVED_FATES, Index
from fleet.analysis.invariants.verdict import Examination, Violation, witness
from fleet.analysis.invariants.views import HeardElection, View
from fleet.config.scenario import Scenario
from fleet.faults.lifecycle import ProcessRule, Severity
from fleet.faults.rules import Rule
from fleet.model.conflict.contact import STRETCH
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.groups import connected
from fleet.model.equipment import computes, hears
from fleet.model.types import COORDINATOR, Pair
from fleet.model.units import to_ns, to_s
from fleet.model.words import OutageEnd
from fleet.protocol.messages import StateBroadcast
from fleet.protocol.surveillance import report_of


def recovery_limit_s(scenario: Scenario, plan: Sequence[Rule] = ()) -> float:
    """How long a pair can be in conflict without a computing UAV while no fault is in force.

    The silence of whoever is gone has to be noticed, which can take longer where messages were lost
    before, or somebody was out of radio range, and its last mandate to run out; then it takes a
    broadcast that says so, two updates, and four messages or steps on the way.
    """
    c, s = scenario.coordination, scenario.surveillance
    lossy = scenario.radio().limited or not all(map(_kills, plan))
    settled_s = c.silence_limit_s * (STRETCH if lossy else 1) + c.election_valid_s
    return settled_s + 2.0 * c.update_s + s.broadcast_s + 4.0 * scenario.tick_s


def leader_again(index: Index, views: Sequence[View]) -> Examination:
    """After the last fault, who is in conflict for longer than the limit has one computing UAV.

    In conflict by what both broadcast, at every update since. Each that hears anything holds a
    mandate of that UAV to be in force, and it is not dead. The update before counts too, since a
    new election does not reach both at once. Pairs that nobody of their group can lead are left
    out, and so are such as hear nothing. With a radio range it is those whose whole group hears
    each other, and of whom the coordinator hears all or none.
    """
    examination = Examination()
    healed_ns = _healed_ns(index)
    if healed_ns is None:
        examination.unknown = "a fault lasts to the end"
        return examination
    watch = _Watch(index, views, healed_ns)
    for first in watch.firsts():
        for pair in watch.at_risk(first):
            examination.examined += 1
            last = _forsaken(watch, pair, first)
            if last is not None:
                examination.violations.append(watch.proof(pair, last))
    return examination


def _forsaken(watch: _Watch, pair: Pair, first: int) -> int | None:
    """The first update from this one on at which a pair is at risk too long with nobody to compute.

    Only updates are looked at whose time limit includes the first: those after are for the next.
    """
    for last in range(first, min(first + watch.window + 1, len(watch.times_ns))):
        span = range(last, last - watch.window - 1, -1)
        led = watch.led(pair, last) or watch.led(pair, last - 1)
        if not led and all(pair in watch.at_risk(n) for n in span):
            return last
    return None


def _healed_ns(index: Index) -> int | None:
    """When the last fault was over and what it delayed had come; None if one lasts to the end.

    A process that is killed and not started again is a fault that is over at once. An outage is a
    fault that nobody planned.
    """
    if any(outage.end == OutageEnd.LOST for outage in index.absences.outages):
        return None
    healed_ns = max((outage.t_ns for outage in index.absences.outages), default=0)
    for rule in index.run.plan:
        if to_ns(rule.start_s) > index.absences.end_ns:
            continue
        end_s = rule.end_s
        if end_s is None:
            if not _kills(rule):
                return None
            end_s = rule.start_s
        if to_ns(end_s) > index.absences.end_ns:
            return None
        healed_ns = max(healed_ns, to_ns(end_s))
    delayed = (
        receipt.at_ns
        for _, _, receipt in index.receipts()
        if receipt.fate in ARRIVED_FATES and receipt.sent_ns < healed_ns
    )
    return max(healed_ns, max(delayed, default=0)) if healed_ns else 0


def _kills(rule: Rule) -> bool:
    return isinstance(rule, ProcessRule) and rule.severity >= Severity.PROCESS


class _Watch:
    """All updates after the last fault: who was at risk at each, and who was led by whom."""

    def __init__(self, index: Index, views: Sequence[View], healed_ns: int) -> None:
        c = index.scenario.coordination
        update_ns = to_ns(c.update_s)
        self.window = -(-to_ns(recovery_limit_s(index.scenario, index.run.plan)) // update_ns)
        first = -(-healed_ns // update_ns)
        self.times_ns = range(first * update_ns, index.absences.end_ns + 1, update_ns)
        self._index = index
        self._views = {v.uav: v for v in views}
        self._heard_ns = {v.uav: [t.at_ns for t in v.mandates] for v in views}
        self._said: dict[int, list[StateBroadcast]] = {u: [] for u in index.uavs}
        for sent in index.sent.values():
            if isinstance(sent.message, StateBroadcast) and sent.message.id in self._said:
                self._said[sent.message.id].append(sent.message)
        self._said_ns = {u: [m.t_ns for m in said] for u, said in self._said.items()}
        self._old_ns = to_ns(index.scenario.surveillance.broadcast_s) + 2 * index.tick_ns
        self._outlook = index.scenario.outlook()
        self._at_risk: dict[int, frozenset[Pair]] = {}
        self._hear = {u for u in index.uavs if hears(index.equipped(u))}
        self._lead = {u for u in index.uavs if computes(index.equipped(u))}

    def firsts(self) -> list[int]:
        """Of the updates to begin with, one after each window, those at which anybody is heard of.

        However late the last message claims to be, there are no more than broadcasts.
        """
        spacing, out = self.window + 1, set[int]()
        for t_ns in chain(*self._said_ns.values()):
            since = max(0, -(-(t_ns - self.times_ns.start) // self.times_ns.step) - self.window)
            first = self.window + -(-since // spacing) * spacing
            while first < len(self.times_ns) and self.times_ns[first] - t_ns < self._old_ns:
                out.add(first)
                first += spacing
        return sorted(out)

    def at_risk(self, update: int) -> frozenset[Pair]:
        """Pairs of live UAVs in conflict at an update, by their last broadcasts."""
        if update not in self._at_risk:
            now_ns = self.times_ns[update]
            reports = [report_of(m) for m in self._last_said(now_ns)]
            examination = sorted(conflicts(reports, now_ns, self._outlook))
            led = {
                m
                for group in connected(examination)
                if self._lead & {*group} and self._whole(group, now_ns)
                for m in group
            }
            self._at_risk[update] = frozenset(
                p for p in examination if p[0] in led and self._hear & {*p}
            )
        return self._at_risk[update]

    def _whole(self, group: Sequence[int], now_ns: int) -> bool:
        """Whether radio range is in nobody's way to lead a group."""
        receivers = self._index.receivers
        if not receivers.limited:
            return True
        if not receivers.within_range(group, now_ns):
            return False
        with_coordinator = [receivers.within_range((COORDINATOR, m), now_ns) for m in group]
        return all(with_coordinator) or not any(with_coordinator)

    def led(self, pair: Pair, update: int) -> bool:
        """Whether both, and the computing UAV itself, hold a mandate of that UAV to be in force.

        The terms may differ: a newer one does not reach all at once.
        """
        now_ns = self.times_ns[update]
        hearing = [uav for uav in pair if uav in self._hear]
        told = self._mandate(hearing[0], now_ns)
        if told is None:
            return False
        others = (self._mandate(u, now_ns) for u in (*hearing[1:], told.election.computing))
        computing = told.election.computing
        return all(o is not None and o.election.computing == computing for o in others)

    def proof(self, pair: Pair, last: int) -> Violation:
        """What is wrong, and the broadcasts and mandates that show it."""
        since_ns, now_ns = self.times_ns[last - self.window], self.times_ns[last]
        what = (
            f"UAVs {pair[0]} and {pair[1]} are in conflict from {to_s(since_ns):.1f} s "
            f"to {to_s(now_ns):.1f} s, and then without a computing UAV"
        )
        shown = [witness(m, "seq", "position_ned_m") for m in self._last_said(since_ns, pair)]
        shown += [witness(m, "seq", "position_ned_m") for m in self._last_said(now_ns, pair)]
        for uav in pair:
            told = self._told(uav, now_ns)
            if told:
                more = {"heard_by": uav, "heard_ns": told.at_ns, "until_ns": told.until_ns}
                shown.append(witness(told.election, "term", "members", "computing", **more))
        return Violation(what, tuple(shown))

    def _last_said(self, now_ns: int, uavs: Sequence[int] = ()) -> list[StateBroadcast]:
        """The last broadcast of each UAV that lives."""
        out = []
        for uav in uavs or self._index.uavs:
            place = bisect_right(self._said_ns[uav], now_ns)
            if place and now_ns - self._said_ns[uav][place - 1] < self._old_ns:
                out.append(self._said[uav][place - 1])
        return out

    def _told(self, uav: int, now_ns: int) -> HeardElection | None:
        """The election that a UAV went by."""
        place = bisect_right(self._heard_ns.get(uav, []), now_ns)
        return self._views[uav].mandates[place - 1] if place else None

    def _mandate(self, uav: int, now_ns: int) -> HeardElection | None:
        """The same, if it is in force."""
        told = self._told(uav, now_ns)
        if told is None or told.at_ns < self._index.absences.incarnation_of(uav, now_ns)[0]:
            return None
        in_force = told.from_ns <= self._index.local_ns(uav, now_ns) <= told.until_ns
        return told if in_force else None
