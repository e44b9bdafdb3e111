"""Who was within radio range of whom in each tick of a run, from the true states on record."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

from fleet.config.scenario import Scenario
from fleet.config.traffic import participants, uavs_of
from fleet.model.radio import Ear, Earshot, RadioRange
from fleet.model.types import COORDINATOR, Position
from fleet.model.words import UNMANNED, Mode
from fleet.protocol.messages import Truth

RadioPlaces = Mapping[int, Position]


class EarTracker:
    """From where everybody listens, brought from tick to tick by the true states."""

    def __init__(self, scenario: Scenario) -> None:
        self._margin_m = scenario.radio().margin_m
        self._ears = {u.id: Ear(u.position_ned_m) for u in uavs_of(scenario)}
        self._here = dict[int, Position]()
        if COORDINATOR in participants(scenario):
            place = scenario.coordination.position_ned_m
            self._ears[COORDINATOR], self._here = Ear(place), {COORDINATOR: place}

    def step(self, states: Iterable[Truth]) -> tuple[RadioPlaces, RadioPlaces]:
        """Take the true states of a tick; returns the places of senders, and of ears, by number.

        A stopped process listens from where it was stopped, one that is started again from where
        its aircraft has been flown to.
        """
        sending = dict(self._here)
        for truth in states:
            ear = self._ears.get(truth.id)
            if ear is None or truth.mode == Mode.HELD:
                continue
            if truth.mode in UNMANNED:
                self._ears[truth.id] = Ear(truth.position_ned_m)
            else:
                ear.move(truth.position_ned_m, self._margin_m)
                sending[truth.id] = truth.position_ned_m
        return sending, {number: ear.place for number, ear in self._ears.items()}


class Earshots:
    """All ticks of a run; `radio` is as the scenario has it, unless another one is given."""

    def __init__(
        self, scenario: Scenario, truths: Iterable[Truth], radio: RadioRange | None = None
    ) -> None:
        self._radio = radio or scenario.radio()
        self._tick_ns = scenario.tick_ns
        states: defaultdict[int, list[Truth]] = defaultdict(list)
        for truth in truths:
            states[truth.t_ns].append(truth)
        tracker = EarTracker(scenario)
        self._places = {t_ns: tracker.step(states[t_ns]) for t_ns in sorted(states)}
        self._last: tuple[int, Earshot | None] = -1, None

    def step_ns(self, t_ns: int) -> int:
        """The tick in which that was sent which has this time: answers come between two."""
        return -(-t_ns // self._tick_ns) * self._tick_ns

    def hears(self, src: int, dst: int, t_ns: int) -> bool:
        """Whether one is within range of the other's message of a time."""
        sending, ears = self._places.get(self.step_ns(t_ns), ({}, {}))
        here = ears.get(dst)
        return here is not None and self._radio.reaches(src, dst, sending.get(src), here)

    def hearers(self, src: int, t_ns: int) -> Sequence[int]:
        """Who is within range of a message to all; sooner where times are asked for in order."""
        step_ns = self.step_ns(t_ns)
        if step_ns not in self._places:
            return ()
        if self._last[0] != step_ns:
            self._last = step_ns, Earshot(self._radio, *self._places[step_ns])
        earshot = self._last[1]
        assert earshot is not None
        return earshot.hearers(src)
