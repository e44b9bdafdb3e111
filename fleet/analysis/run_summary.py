"""What a run comes to, message by message: separation, arrivals, commands, elections, delivery."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from fleet.analysis.arrival import ArrivalMonitor
from fleet.analysis.common_times import CommonTimes
from fleet.analysis.recorded_run import RecordedRun
from fleet.analysis.separation import SeparationMonitor
from fleet.analysis.tally import run_tally
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.model.conflict.risk import Required
from fleet.model.types import Array
from fleet.protocol.messages import Clock, Message, Truth


class RunSummary:
    """The one account of a run, of one that is on and of one on record.

    `messages` counts them by class; `vanished` are UAVs that nothing more will be heard of, and
    `others` the separation of pairs as other distances than the scenario's are required.
    """

    def __init__(self, scenario: Scenario, *others: Required) -> None:
        self._ids = [u.id for u in uavs_of(scenario)]
        self._moments = CommonTimes(self._ids)
        self.vanished: frozenset[int] = frozenset()
        required, zones = scenario.required(), scenario.zone_ratios()
        self.separation = SeparationMonitor(self._ids, required, zones)
        self.others = [SeparationMonitor(self._ids, required) for required in others]
        self.tally = run_tally(scenario)
        self.arrivals = ArrivalMonitor(scenario)
        self.messages: Counter[str] = Counter()

    def add(self, message: Message) -> None:
        """Count and measure one message."""
        self.messages[message.kind] += 1
        if isinstance(message, Truth):
            self._moments.add(message.id, message.t_ns, message.position_ned_m)
            self.tally.add_truth(message)
            if self.messages[Truth.kind] % max(1, len(self._ids)) == 0:
                self._measure(self._moments.until(self._moments.settled_ns(self.vanished)))
        else:
            self.tally.add(message)
        self.arrivals.add(message)

    def settle(self, t_ns: int) -> None:
        """Nothing more comes of times up to this one."""
        self._measure(self._moments.until(t_ns))

    def finish(self) -> None:
        """The run is over: measure what was waited for (nothing, in lockstep)."""
        self._measure(self._moments.rest())

    def _measure(self, moments: Iterable[tuple[int, Array]]) -> None:
        for t_ns, positions in moments:
            for monitor in (self.separation, *self.others):
                monitor.update(t_ns, positions)
            self.tally.settle(t_ns)


def summary_of(run: RecordedRun) -> RunSummary:
    """The same of a run on record; what cannot be of the run is left out."""
    summary = RunSummary(run.scenario)
    for message in run.messages():
        if not isinstance(message, Clock):
            summary.add(message)
    summary.finish()
    return summary
