"""Messages of one class as a target: through the gate, into participants and the simulation."""

from __future__ import annotations

import random
from itertools import chain, islice
from typing import Any

from fleet.protocol import codec
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.sample import Sample, sample_of
from tests.hostile import corpus
from tests.hostile.ear import Ear
from tests.hostile.hostile_input import (
    LISTED,
    SHIFTED,
    HostileInput,
    mutated_input,
    read_input,
)
from tests.hostile.mutation import packed, pick, unpacked
from tests.hostile.scene import ENCOUNTER, Scene, scenes

RUN = "hostile"
UNIX_NS = 1_800_000_000_000_000_000
"""When messages arrive, by the wall clock."""


ANY_SHARE, TRIES = 0.3, 8
"""So many inputs may be unreadable; of the others the first readable one of so many is taken."""


class MessageTarget:
    """Takes inputs (`HostileInput`) whose topic is most often one of the class."""

    limit_s = 2.0

    def __init__(self, kind: str) -> None:
        self.name = kind
        self.accepted, self.together = 0, 1
        ears = [Ear(ENCOUNTER), Ear(ENCOUNTER, realtime=True)]
        self._seeds = self.seeds()
        self._victims: list[Scene | Ear] = [*(scenes() if kind in AUDIBLE else ()), *ears]
        for victim in self._victims:
            victim.begin_anew()  # what is flown for it takes longer than an input may

    def seeds(self) -> list[bytes]:
        """What was really said."""
        return corpus.stored(self.name)

    def mutate(self, rng: random.Random, data: bytes) -> bytes:
        """Another input; most often one that a decoder takes, so that it goes further than that."""
        if rng.random() < ANY_SHARE:
            return mutated_input(rng, data)
        base = data if _readable(data) else pick(rng, self._seeds)
        made = base
        for _ in range(TRIES):
            made = mutated_input(rng, base)
            if _readable(made):
                break
        return made

    def __call__(self, data: bytes) -> None:
        """Put an input to the victim that it names, or to the next one that hears its topic."""
        given = read_input(data)
        first = (given.marks >> 2) % len(self._victims)
        in_turn = chain(islice(self._victims, first, None), self._victims)
        victim = next(victim for victim in in_turn if victim.hears(given.topic))
        if victim.exhausted:
            victim.begin_anew()
        try:
            self.accepted += victim.take(_sample(given, victim), self.together)
        except BaseException:
            victim.abandon()
            raise


def _readable(data: bytes) -> bool:
    """Whether it is a message of the class that its topic names."""
    given = read_input(data)
    try:
        codec.decode(given.topic, given.payload)
    except ValueError:
        return False
    return True


def _sample(given: HostileInput, victim: Scene | Ear) -> Sample:
    """What arrives of an input; its times and its number are made to fit where it says so."""
    payload = given.payload
    if given.marks & (SHIFTED | LISTED):
        payload = _fitted(payload, given, victim)
    key = f"fleet/{RUN}/{given.topic}"
    return sample_of(RUN, key, payload, given.attachment or None, UNIX_NS)


def _fitted(payload: bytes, given: HostileInput, victim: Scene | Ear) -> bytes:
    try:
        tree = unpacked(payload)
        if not isinstance(tree, dict):
            return payload
        if given.marks & SHIFTED:
            late_ns = victim.now_ns - tree.get("t_ns", 0)
            tree = {name: _shifted(name, value, late_ns) for name, value in tree.items()}
        number = victim.number_due(given.topic) if given.marks & LISTED else None
        if number is not None:
            tree["seq"] = number
        return packed(tree)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return payload


def _shifted(name: Any, value: Any, late_ns: int) -> Any:
    timed = isinstance(name, str) and name.endswith("_ns") and type(value) is int and value
    return value + late_ns if timed else value
