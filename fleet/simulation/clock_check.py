"""The simulation's own wall clock beside those of the participants, as NTP asks for the time."""

from __future__ import annotations

from collections.abc import Collection

from fleet.analysis.clock_offsets import ClockOffsets
from fleet.node.progress import read_progress
from fleet.protocol.topics import issuer_name, issuer_of, progress_of
from fleet.transport.zenoh_bus import Bus

TIME_ANSWER_S = 1.0


def compare_clocks(bus: Bus, clocks: ClockOffsets, numbers: Collection[int], t_ns: int) -> None:
    """Ask these participants for their time, at a time of the run; who is silent is left out.

    Messages do not tell: what the simulation says in realtime is little, and nobody reports it.
    """
    names = {issuer_name(number): number for number in numbers}
    asked_ns = bus.now_unix_ns()
    for topic, answer, came_ns in bus.answers(progress_of("*"), TIME_ANSWER_S):
        report, number = read_progress(answer), names.get(issuer_of(topic))
        if report is not None and report.unix_ns and number is not None:
            clocks.add_answer(number, t_ns, asked_ns, report.unix_ns, came_ns)
