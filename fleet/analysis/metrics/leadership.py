"""Who was at risk, and who had a computing UAV then: the time for which elections left a gap.

Risk (eq. 9) is judged on true states at every update of the coordination, with the alert horizon;
each update stands for the time until the next, or until the end of the record. Mandates are those
that the UAVs had heard.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterator
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fleet.analysis.common_times import Ints
from fleet.analysis.metrics.data import SEQ, RunArrays
from fleet.config.scenario import Uav
from fleet.faults.clock import LocalClock
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.tracks import StateReport
from fleet.model.election import Mandate, Terms
from fleet.model.types import COORDINATOR, Pair
from fleet.model.units import to_ns, to_s
from fleet.model.vehicle.guidance import Pilot
from fleet.model.vehicle.intent import Intent
from fleet.model.words import AVOIDING, UNMANNED, ArrivalFate, Mode
from fleet.protocol.messages import Election, Truth
from fleet.protocol.surveillance import manoeuvre_of, state_of

NOBODY = -1


class RiskTimes(NamedTuple):
    """For how long there was a risk; of that, without a computing UAV; the longest such time."""

    at_risk_s: float
    without_computing_s: float
    longest_without_s: float


class Leadership:
    """Pairs at risk at every update, and whether each was led."""

    def __init__(self, data: RunArrays) -> None:
        update_ns = to_ns(data.scenario.coordination.update_s)
        self.times_ns = [int(t) for t in data.times_ns[:-1] if t % update_ns == 0]
        end_ns = int(data.times_ns[-1]) if len(data.times_ns) else 0
        self._lasts_ns = [min(update_ns, end_ns - t) for t in self.times_ns]
        outlook = data.scenario.outlook()
        pilots = {uav.id: data.scenario.pilot(uav.id, uav.speed_mps) for uav in data.uavs}
        self._risk = [_at_risk(data, t, outlook, pilots) for t in self.times_ns]
        manned, leader = _presence(data, self.times_ns), _leaders(data, self.times_ns)
        place = {uav: n for n, uav in enumerate(data.ids)}
        self._led = [
            {p: _is_led(manned[:, k], leader[:, k], place, p) for p in risk}
            for k, risk in enumerate(self._risk)
        ]

    def of_pair(self, pair: Pair) -> RiskTimes:
        """For how long a pair was at risk, and had no computing UAV then."""
        return self._times([[led[pair]] if pair in led else [] for led in self._led])

    def of_any(self) -> RiskTimes:
        """For how long any pair was at risk, and one of those had no computing UAV then."""
        return self._times([list(led.values()) for led in self._led])

    def _times(self, led: list[list[bool]]) -> RiskTimes:
        """By whether each of the pairs at risk has a computing UAV, at every update."""
        updates = list(zip(self._lasts_ns, led, strict=True))
        gaps_ns = [
            sum(lasts_ns for lasts_ns, _ in gap)
            for all_led, gap in groupby(updates, key=lambda update: all(update[1]))
            if not all_led
        ]
        at_risk_ns = sum(lasts_ns for lasts_ns, pairs in updates if pairs)
        return RiskTimes(to_s(at_risk_ns), to_s(sum(gaps_ns)), to_s(max(gaps_ns, default=0)))

    def time_to_violation_s(self, pair: Pair, t_ns: int) -> float | None:
        """How soon a pair would violate separation, by the true states at the update of a time."""
        update = int(np.searchsorted(self.times_ns, t_ns, side="right")) - 1
        return self._risk[update].get(pair) if update >= 0 else None


def _at_risk(
    data: RunArrays, t_ns: int, outlook: Outlook, pilots: dict[int, Pilot]
) -> dict[Pair, float]:
    """Pairs that would violate separation within the horizon, by their true states, and when."""
    told = [(uav, data.truths.get(uav.id, {}).get(t_ns)) for uav in data.uavs]
    reports = [_report(uav, m, pilots[uav.id]) for uav, m in told if m is not None]
    return conflicts(reports, t_ns, outlook)


def _report(uav: Uav, truth: Truth, pilot: Pilot) -> StateReport:
    """What a UAV would say of itself if it knew the truth; nobody releases an unmanned one."""
    plan = uav.plan(truth.waypoint_index)
    told = (truth.commanded_heading_rad, truth.commanded_climb_mps)
    level_down_m, speed_mps = truth.commanded_level_down_m, truth.commanded_speed_mps
    if truth.mode in UNMANNED:
        intent = Intent(*told, speed_mps=speed_mps or uav.speed_mps)
        return StateReport(uav.id, truth.t_ns, state_of(truth), intent, plan)
    escaping = truth.mode in AVOIDING
    manoeuvre = manoeuvre_of(truth.mode, *told, level_down_m, speed_mps) if escaping else None
    state = state_of(truth)
    return StateReport(uav.id, truth.t_ns, state, pilot.intent(plan, state), plan, manoeuvre)


def _presence(data: RunArrays, times_ns: list[int]) -> NDArray[np.bool_]:
    """Whether the process of each UAV runs at these times, shape (UAVs, times)."""
    out = np.zeros((len(data.ids), len(times_ns)), dtype=np.bool_)
    for n, uav in enumerate(data.ids):
        truths = data.truths.get(uav, {})
        for k, t_ns in enumerate(times_ns):
            out[n, k] = t_ns in truths and truths[t_ns].mode not in UNMANNED
    return out


def _leaders(data: RunArrays, times_ns: list[int]) -> Ints:
    """The computing UAV of each UAV at these times, shape (UAVs, times).

    By what it had heard, and by its own clock, as docs/protocol (Mandates) has it.
    """
    out = np.full((len(data.ids), len(times_ns)), NOBODY, dtype=np.int64)
    longest_ns = to_ns(data.scenario.coordination.election_valid_s)
    sent = {(e.id, e.seq & SEQ): e for e in data.elections}
    for n, uav in enumerate(data.ids):
        clock = LocalClock(data.plan, uav)
        dead = sorted(t for t, m in data.truths.get(uav, {}).items() if m.mode == Mode.UNMANNED)
        heard = deque(sorted(_heard(data, uav, sent), key=lambda item: item[0]))
        held: Mandate | None = None
        since_ns = 0
        for k, t_ns in enumerate(times_ns):
            while heard and heard[0][0] <= t_ns:
                at_ns, election = heard.popleft()
                if held is not None and election.term < held.term:
                    continue
                until_ns = election.valid_until_ns
                if held is not None and election.term == held.term:
                    until_ns = max(until_ns, held.valid_until_ns)
                own_ns = at_ns + clock.shift_ns(at_ns)
                until_ns = min(until_ns, own_ns + longest_ns)
                held = Mandate(
                    election.term, election.members, election.computing, until_ns, own_ns
                )
                since_ns = at_ns
            died = bisect_right(dead, t_ns)  # a process that dies forgets
            if held is None or (died and dead[died - 1] >= since_ns):
                continue
            if held.in_force(t_ns + clock.shift_ns(t_ns)):
                out[n, k] = held.computing
    return out


def _heard(
    data: RunArrays, uav: int, sent: dict[tuple[int, int], Election]
) -> Iterator[tuple[int, Election]]:
    """The elections that name a UAV and are for it to hold, and when it acted on each."""
    terms = Terms(data.ids)
    receipts = data.receipts.get(uav)
    told = [(e.t_ns, e) for e in data.elections if e.id == uav]
    if receipts is not None:
        good = (receipts.kind == data.code(Election.kind)) & (
            receipts.fate == data.code(ArrivalFate.RECEIVED)
        )
        columns = (receipts.delivered_ns[good], receipts.src[good], receipts.seq[good])
        for t_ns, src, seq in zip(*(c.tolist() for c in columns), strict=True):
            if (src, seq) in sent:
                told.append((t_ns, sent[src, seq]))
    for t_ns, election in told:
        own = election.id in (COORDINATOR, election.computing)
        if own and uav in election.members and terms.elector_of(election.term) == election.id:
            yield t_ns, election


def _is_led(manned: NDArray[np.bool_], leader: Ints, place: dict[int, int], pair: Pair) -> bool:
    """Whether those of a pair whose processes run have one and the same computing UAV, that runs.

    `manned` and `leader` have shape (UAVs,); the computing UAV must take itself for that.
    """
    running = [place[uav] for uav in pair if manned[place[uav]]]
    found = {int(leader[n]) for n in running}
    if len(found) != 1:
        return False
    (computing,) = found
    n = place.get(computing)
    return n is not None and bool(manned[n]) and int(leader[n]) == computing
