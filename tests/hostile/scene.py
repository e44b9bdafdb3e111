"""A participant in the middle of an encounter, to which hostile messages are delivered.

Its fleet is flown for a while; what all others say from then on is known, so that the victim can be
stepped on by itself, with what it really hears and what is put in beside it. Every so many steps
everything begins anew from the same moment: a finding is repeated from its last inputs.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import cached_property
from typing import Any

from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.node.broadcasts import Reception
from fleet.node.clock_words import FOREVER_NS
from fleet.node.gate import FUTURE_TOLERANCE_NS, Gate, RefusedError
from fleet.node.holding import RealtimeTiming, SortedQueue
from fleet.node.participant import channel_of
from fleet.node.runner import NodeRunner
from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.messages import Message
from fleet.protocol.sample import Sample
from fleet.protocol.topics import (
    is_broadcast,
    issuer_name,
    issuer_of,
    suffix_of,
    topic_of,
    topics_for,
)
from fleet.simulation.in_memory import MemoryRunContext
from fleet.simulation.lockstep import conduct_lockstep
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage

STEPS = 128
"""After so many steps a scene begins anew."""


class OwnMessageError(Exception):
    """What a participant sends is no message of the run: the fault is its own."""


class KeptTicks(RunRecorder):
    """A run recorder that keeps what was said, tick by tick."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario, None)
        self.ticks: list[list[ReceivedMessage]] = [[]]

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        self.ticks[-1].append(item)
        super().note(item, log_ns)

    def close(self, tick: int, t_ns: int, items: Sequence[ReceivedMessage]) -> None:
        super().close(tick, t_ns, items)
        self.ticks.append([])


class Moment:
    """A moment of a run: who is there, and what was said from then on."""

    def __init__(
        self, name: str, begin_s: float, settings: dict[str, Any] | None = None, **faults: Any
    ) -> None:
        self._of = name, settings, faults
        self._begin_s = begin_s

    @cached_property
    def scenario(self) -> Scenario:
        """What is flown."""
        name, settings, faults = self._of
        end_s = self._begin_s + 0.1 * (STEPS + 2)
        return load_scenario(name, {"duration_s": end_s, **(settings or {})}, faults)

    @property
    def begin(self) -> int:
        """The tick that was stepped last."""
        return round(self._begin_s / self.scenario.tick_s)

    @cached_property
    def flown(self) -> tuple[list[list[ReceivedMessage]], dict[int, NodeRunner]]:
        """What was said in each tick, and who is there."""
        recorder = KeptTicks(self.scenario)
        run = MemoryRunContext(self.scenario, recorder, None)
        there: dict[int, NodeRunner] = {}
        for tick, _ in enumerate(conduct_lockstep(run)):
            if tick == self.begin - 1:  # the next one has been collected already when this is told
                there = copy.deepcopy(run.transport.runners)
            if tick == self.begin + STEPS + 1:
                break
        return recorder.ticks, there


class Scene:
    """One victim at a moment; it steps when it is told to."""

    def __init__(self, moment: Moment, victim: int, *, realtime: bool = False) -> None:
        self.moment, self.victim = moment, victim
        self._realtime = realtime
        self._suffixes = topics_for(victim)
        self._steps, self._delivered = STEPS, 0
        self.now_ns = 0

    @property
    def exhausted(self) -> bool:
        """Whether there is nothing more to hear."""
        return self._steps >= STEPS

    def begin_anew(self) -> None:
        """From the same moment as ever."""
        scenario = self.moment.scenario
        self._ticks, there = self.moment.flown
        self._steps = 0
        self.now_ns = self.moment.begin * scenario.tick_ns
        self.gate = Gate(scenario, rising=self._realtime)
        self.gate.latest_ns = FOREVER_NS
        self.runner = copy.deepcopy(there[self.victim])
        if self._realtime:
            queue, believed = SortedQueue(), self.gate.credible
            links = channel_of(scenario)
            self.runner = NodeRunner(
                self.runner.node, RealtimeTiming(), links, queue, credible=believed
            )

    def abandon(self) -> None:
        """It is not to be used any more as it is."""
        self._steps = STEPS

    def due(self) -> list[ReceivedMessage]:
        """What was said in the tick that was stepped last."""
        return self._ticks[self.moment.begin + self._steps]

    def number_due(self, topic: str) -> int | None:
        """The number of a message of that topic which is due now."""
        return next((m.seq for other, _, m in self.due() if other == topic), None)

    def hears(self, topic: str) -> bool:
        """Whether the victim hears a topic."""
        own = issuer_of(topic) == issuer_name(self.victim) and is_broadcast(suffix_of(topic))
        return suffix_of(topic) in self._suffixes and not own

    def take(self, sample: Sample, together: int = 1) -> bool:
        """Step with a message, if it is one, once there are so many; whether it is."""
        if self._realtime:
            self.gate.latest_ns = self.now_ns + FUTURE_TOLERANCE_NS
        try:
            message = self.gate.admit(sample)
        except RefusedError:
            return False
        self.deliver(sample, message)
        self._delivered += 1
        if self._delivered % together == 0:
            self.step()
        return True

    def deliver(self, sample: Sample, message: Message) -> None:
        """Hand it a message that it hears."""
        put_ns, arrived_ns = sample.put_unix_ns, sample.arrived_unix_ns
        transit_ns = arrived_ns - put_ns if put_ns and self._realtime else 0
        arrived = self.now_ns, transit_ns, sample.place
        self.runner.accept(Reception(sample.topic, sample.payload, message, *arrived))

    def step(self) -> None:
        """Let it hear what is due, and step it.

        Raises:
            OwnMessageError: what it says cannot be read.

        """
        for topic, payload, message in self.due():
            if message.kind in AUDIBLE and self.hears(topic):
                self.deliver(Sample(topic, payload), message)
        self._steps += 1
        self.now_ns += self.moment.scenario.tick_ns
        for message in self.runner.step(self.now_ns):
            check_own(message, self.now_ns)


def check_own(message: Message, now_ns: int) -> None:
    """Raises OwnMessageError for a message that its receivers would refuse."""
    topic, payload = codec.on_wire(message)
    try:
        again = codec.decode(topic, payload)
    except ValueError as error:
        raise OwnMessageError(f"{topic}: {error}: {message}") from error
    if topic_of(again) != topic or message.t_ns > now_ns:
        raise OwnMessageError(f"{topic} at {now_ns}: {message}")


ENCOUNTER = Moment("four_way", 28.0)
_ALONE = Moment("four_way", 28.0, {"coordination.electors": "local"})
_MANY = Moment("crossing", 5.0, {"generate.count": 14})
_FAULTY = Moment(
    "four_way",
    31.0,
    latency="100ms",
    corrupt="20%",
    duplicate="20%",
    loss="10%",
    rate="100kbit",
    reorder="10%",
)


def scenes() -> list[Scene]:
    """Computing and commanded UAVs, coordinators; few and many, with faults and without."""
    return [
        Scene(ENCOUNTER, 1),
        Scene(ENCOUNTER, 2),
        Scene(ENCOUNTER, 0),
        Scene(_ALONE, 1),
        Scene(_MANY, 2),
        Scene(_MANY, 0),
        Scene(_FAULTY, 2),
        Scene(_FAULTY, 1, realtime=True),
    ]
