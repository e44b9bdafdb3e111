"""The simulation's ear: what it hears is a participant's message, its own word, or somebody else's.

Nobody but the participants and the simulation itself may speak in a run. What comes under a strange
name is refused, counted and logged, and changes nothing. What comes in the name of a participant or
of the simulation and is not theirs makes the run invalid, and the message says which topic it was
on.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Sequence

from fleet.errors import FleetStoppedError
from fleet.model.words import UNMANNED
from fleet.node.gate import HARMLESS, REFUSAL_TEXTS, Gate, RefusedError
from fleet.protocol.account import Account
from fleet.protocol.attendance import Attendance
from fleet.protocol.messages import Clock, Done, Outage, Truth
from fleet.protocol.sample import SEVERAL, Sample
from fleet.protocol.topics import ABORT, SIMULATION, issuer_of
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage


class OwnMessages:
    """What the simulation has said and not heard yet: it hears all that is said, itself too."""

    def __init__(self) -> None:
        self._said: Counter[tuple[str, bytes]] = Counter()
        self._lock = threading.Lock()

    def say(self, topic: str, payload: bytes) -> None:
        """Say something that will be heard once."""
        with self._lock:
            self._said[topic, payload] += 1

    def heard(self, topic: str, payload: bytes) -> bool:
        """Whether it was said, and not heard before."""
        with self._lock:
            left = self._said.pop((topic, payload), 0)
            if left > 1:
                self._said[topic, payload] = left - 1
            return left > 0


class Listener:
    """Hears for the simulation of one run, and keeps account of who has sent what."""

    def __init__(
        self, gate: Gate, run_recorder: RunRecorder, words: OwnMessages, tick_ns: int
    ) -> None:
        self._gate = gate
        self._run_recorder = run_recorder
        self._words = words
        self._attendance = Attendance(tick_ns)
        self._accounts: dict[tuple[str, int], Account] = {}
        self._closed: set[str] = set()

    def hear(self, arrival: Sample, latest_ns: int) -> ReceivedMessage | None:
        """A participant's message, sent at `latest_ns` or before; None for what is none.

        Raises:
            FleetStoppedError: it is an abort, or somebody speaks in another's name.

        """
        topic, payload = arrival.topic, arrival.payload
        if issuer_of(topic) == SIMULATION and arrival.flaw != SEVERAL:
            if arrival.flaw or not self._words.heard(topic, payload):
                raise self.intrusion(topic, "not the simulation")
            if topic == ABORT:
                raise FleetStoppedError(payload.decode(errors="replace"))
            return None
        self._gate.latest_ns = latest_ns
        try:
            message = self._gate.admit(arrival)
        except RefusedError as refused:
            if refused.why not in HARMLESS:
                raise self.intrusion(topic, refused.why) from refused
            self._run_recorder.refuse(topic, refused.why)
            return None
        if arrival.round_ns and isinstance(message, Truth):
            self._run_recorder.tell_round(message.t_ns, message.id, arrival.round_ns)
        return topic, payload, message

    def intrusion(self, topic: str, why: str) -> FleetStoppedError:
        """What ends the run because of a message on a topic; it is on record."""
        return FleetStoppedError(
            f"a message on {self._run_recorder.refuse(topic, why)}: {REFUSAL_TEXTS[why]}"
        )

    def audit(self, items: Sequence[ReceivedMessage]) -> None:
        """Hold all messages of a lockstep tick against what their issuers say that they sent.

        Raises:
            FleetStoppedError: there is one that its issuer does not know of.

        """
        came: dict[str, Account] = {}
        told: dict[str, Done] = {}
        for topic, payload, message in items:
            name = issuer_of(topic)
            account = came.get(name)
            if account is None:
                account = came[name] = Account()
            if isinstance(message, Done):
                told[name] = message
            else:
                account.add(topic, payload)
        strange = [self._strange(name, account, told.get(name)) for name, account in came.items()]
        for _, topic in sorted(filter(None, strange)):
            raise self.intrusion(topic, "unaccounted")

    def know(self, clock: Clock, said_ns: int) -> None:
        """In realtime: who is stopped or dead, as has been carried out by a time of the run."""
        self._attendance.hear(clock, said_ns)

    def excuse(self, outage: Outage) -> None:
        """In realtime: what a participant sent may be missing, or it is another process now."""
        self._attendance.outage(outage)

    def enter(self, item: ReceivedMessage, arrived_ns: int) -> None:
        """Keep account of a realtime message; the last one of a participant tells what it sent.

        Raises:
            FleetStoppedError: its issuer cannot have sent it, or does not know of one that came.

        """
        topic, payload, message = item
        name = issuer_of(topic)
        if isinstance(message, Truth) and message.mode in UNMANNED:
            raise self.intrusion(topic, "not the simulation")
        if name in self._closed:
            raise self.intrusion(topic, "unaccounted")
        of = message.id, message.kind, message.seq, message.t_ns
        incarnation, why = (
            self._attendance.incarnation_of(*of),
            self._attendance.refusal(*of, arrived_ns),
        )
        if why:
            raise self.intrusion(topic, why)
        account = self._accounts.setdefault((name, incarnation), Account())
        if not isinstance(message, Done):
            account.add(topic, payload)
            return
        self._closed.add(name)
        if self._attendance.was_cut(message.id, incarnation):
            surplus = account.exceeds(message.sent)
            strange = (0, f"{name}/{surplus}") if surplus else None
        else:
            strange = self._strange(name, account, message)
        if strange:
            raise self.intrusion(strange[1], "unaccounted")

    @staticmethod
    def _strange(name: str, came: Account, told: Done | None) -> tuple[int, str] | None:
        """Rank and topic of a message that its issuer does not know of; a surplus first."""
        suffix = came.differs(told.sent if told else {}, told.digests if told else {})
        if not suffix:
            return None
        surplus = came.counts.get(suffix, 0) > (told.sent.get(suffix, 0) if told else 0)
        return int(not surplus), f"{name}/{suffix}"
