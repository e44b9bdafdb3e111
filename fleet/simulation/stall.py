"""A run in which nothing happens any more explains itself: what is missing, from whom, and where.

The participants are asked what they are about, the router what is declared, and the operating
system what state each process is in.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from fleet.node.progress import ProgressReport, read_progress
from fleet.protocol.messages import Done
from fleet.protocol.topics import CLOCK, alive, issuer_name, issuer_of, progress_of
from fleet.transport.interface import ReceivedMessage
from fleet.transport.zenoh_bus import Bus

PROGRESS_TIMEOUT_S = 2.0
SILENCE_TIMEOUT_S = 1.0
ITEMS_SHOWN = 3
"""So many things that are wrong go into one line; all of them into the log."""


@dataclass(frozen=True)
class Stall:
    """What was found when a run stood still; all by name of process.

    `waiting`: whom the simulation awaits. `owed`: topics on which it lacks messages that their
    issuers have sent. `told`: answers. `joined`: who has a token at the router. `hears`: what each
    is subscribed to there. `states`: of the processes that the simulation started.
    """

    waiting: tuple[str, ...]
    owed: Mapping[str, int] = field(default_factory=dict)
    told: Mapping[str, ProgressReport] = field(default_factory=dict)
    joined: frozenset[str] = frozenset()
    hears: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    states: Mapping[str, str] = field(default_factory=dict)

    def line(self) -> str:
        """What is missing from whom."""
        found = [self._about(name) for name in self.waiting]
        found += [f"the simulation lacks {n} on {topic}" for topic, n in sorted(self.owed.items())]
        more = f"; and {len(found) - ITEMS_SHOWN} more" if len(found) > ITEMS_SHOWN else ""
        return "; ".join(found[:ITEMS_SHOWN]) + more

    def record(self) -> dict[str, str]:
        """Everything, for the log: JSON by name."""
        answers = {name: _plain(answer) for name, answer in self.told.items()}
        return {
            "line": self.line(),
            "waiting": json.dumps(self.waiting),
            "owed": json.dumps(dict(self.owed)),
            "told": json.dumps(answers),
            "joined": json.dumps(sorted(self.joined)),
            "hears": json.dumps(dict(self.hears)),
            "states": json.dumps(dict(self.states)),
        }

    def _about(self, name: str) -> str:
        state = self.states.get(name, "no process of this simulation yet")
        if name not in self.joined and name not in self.states:
            return f"{name} is not at the router (its link is lost, or it has not joined)"
        if name not in self.joined:
            return f"{name} has not joined ({state})"
        answer = self.told.get(name)
        if answer is None and name not in self.states:
            return f"{name} does not answer (its link is silent, or it is stopped)"
        if answer is None:
            return f"{name} does not answer ({state})"
        if answer.lacking:
            lacking = ", ".join(
                f"number {seq} of {issuer_name(issuer)}/{suffix}"
                for suffix, missing in sorted(answer.lacking.items())
                for issuer, seq in missing[:ITEMS_SHOWN]
            )
            return f"{name} lacks {lacking} in tick {answer.tick}"
        if CLOCK not in self.hears.get(name, (CLOCK,)):
            return f"the router does not know that {name} hears {CLOCK}"
        return f"{name} is {answer.doing}, tick {answer.tick} ({state})"


def owed(items: Sequence[ReceivedMessage]) -> dict[str, int]:
    """By topic, how many messages the issuers say to have sent that are not among these."""
    came = Counter(topic for topic, _, _ in items)
    out: dict[str, int] = {}
    for topic, _, message in items:
        if isinstance(message, Done):
            for suffix, count in message.sent.items():
                missing = count - came[f"{issuer_of(topic)}/{suffix}"]
                if missing > 0:
                    out[f"{issuer_of(topic)}/{suffix}"] = missing
    return out


def examine(
    bus: Bus, waiting: Iterable[str], items: Sequence[ReceivedMessage], states: Mapping[str, str]
) -> Stall:
    """Ask everybody; takes a few seconds."""
    answers = bus.ask_all(progress_of("*"), PROGRESS_TIMEOUT_S)
    found = {issuer_of(topic): read_progress(answer) for topic, answer in answers.items()}
    tokens = bus.declared("token", PROGRESS_TIMEOUT_S)
    names = {zid: issuer_of(t) for t, zids in tokens.items() for zid in zids}
    hears: dict[str, list[str]] = {}
    for topic, zids in sorted(bus.declared("subscriber", PROGRESS_TIMEOUT_S).items()):
        for zid in zids:
            hears.setdefault(names.get(zid, zid), []).append(topic)
    return Stall(
        tuple(sorted(waiting)),
        owed(items),
        {name: answer for name, answer in found.items() if answer},
        frozenset(issuer_of(t) for t in tokens if t == alive(issuer_of(t))),
        {name: tuple(topics) for name, topics in hears.items()},
        states,
    )


def silent_among(bus: Bus, names: Iterable[str]) -> set[str]:
    """Of these processes those that do not answer a question at once."""
    answers = bus.ask_all(progress_of("*"), SILENCE_TIMEOUT_S)
    return set(names) - {issuer_of(topic) for topic in answers}


def _plain(answer: ProgressReport) -> dict[str, object]:
    return {n: getattr(answer, n) for n in answer.__struct_fields__}
