"""What was dropped in a run for lack of room, told with its result: that a bound was hit."""

from __future__ import annotations

from collections.abc import Callable, Collection

from fleet.node.progress import read_progress
from fleet.protocol.topics import issuer_of, progress_of
from fleet.transport.zenoh_bus import Bus

ANSWER_TIMEOUT_S = 1.0


class Shortages:
    """Counts by where there was no room: a question to the simulation, or a participant."""

    def __init__(self) -> None:
        self._counters: dict[str, Callable[[], int]] = {}
        self._told: dict[str, int] = {}

    def watch(self, place: str, counter: Callable[[], int]) -> None:
        """Go by a counter of this process."""
        self._counters[place] = counter

    def ask(self, bus: Bus, names: Collection[str]) -> None:
        """Ask the participants of these names, who count for themselves, while they are there."""
        answers = bus.ask_all(progress_of("*"), ANSWER_TIMEOUT_S)
        for topic, answer in answers.items():
            report, name = read_progress(answer), issuer_of(topic)
            if report is not None and name in names:
                self._told[name] = report.lacked_room

    def counts(self) -> dict[str, int]:
        """How much was dropped, by place; only where anything was."""
        found = {place: counter() for place, counter in self._counters.items()} | self._told
        return {place: count for place, count in sorted(found.items()) if count}
