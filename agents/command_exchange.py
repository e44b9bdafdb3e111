"""What a computing UAV has commanded one UAV, and what of it has arrived, as answers tell."""

from __future__ import annotations

from fleet.agents.obedience import FINAL
from fleet.model.conflict.tracks import CommandId
from fleet.protocol.messages import Ack, Command


class CommandExchange:
    """The commands to one UAV: the last that it is known to have, and those sent since."""

    __slots__ = ("_again_ns", "_received", "_retransmit_ns", "_sent", "waits")

    def __init__(self, retransmit_ns: int) -> None:
        self._received: Command | None = None
        self._sent: list[Command] = []
        self._retransmit_ns = retransmit_ns
        self._again_ns = 0
        self.waits = False
        """Whether the last command has neither been answered nor expired."""

    @property
    def last(self) -> Command | None:
        """The last command that the UAV has, or that is on its way.

        One that expired without an answer may never have arrived: then it is the one before.
        """
        return self._sent[-1] if self.waits else self._received

    def send(self, command: Command) -> None:
        """A new command is sent."""
        self._sent.append(command)
        self.waits = True
        self._again_ns = command.issued_ns + self._retransmit_ns

    def repetition(self, now_ns: int) -> Command | None:
        """The command to send again now, if there is one; one that expired is given up."""
        if self.waits and now_ns > self._sent[-1].expiry_ns:
            self.waits = False
        if not self.waits or now_ns < self._again_ns:
            return None
        self._again_ns = now_ns + self._retransmit_ns
        return self._sent[-1]

    def on_ack(self, ack: Ack) -> None:
        """An answer, unless it is a refusal which a repetition may mend."""
        index = self._index(ack.term, ack.number)
        if index is None or not (ack.accepted or ack.reason in FINAL):
            return
        if ack.accepted or ack.reason == "duplicate":
            self._arrived(index)
        else:
            self.waits &= index < len(self._sent) - 1
            del self._sent[index]

    def on_flown(self, command_id: CommandId) -> None:
        """A broadcast that tells which command is flown: an answer, too."""
        index = self._index(command_id.term, command_id.number)
        if index is not None:
            self._arrived(index)

    def _arrived(self, index: int) -> None:
        """The UAV has that command; those sent before it are of no interest any more."""
        self._received = self._sent[index]
        del self._sent[: index + 1]
        self.waits &= bool(self._sent)

    def _index(self, term: int, number: int) -> int | None:
        numbers = [(command.term, command.number) for command in self._sent]
        return numbers.index((term, number)) if (term, number) in numbers else None
