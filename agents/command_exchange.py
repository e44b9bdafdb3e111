"""What a computing UAV has commanded one UAV, and what of it has arrived, as answers tell."""

from __future__ import annotations

from fleet.agents.command_states import COMMAND_STATES, CommandEvent, CommandState
from fleet.agents.obedience import FINAL
from fleet.model.conflict.contact import RARE
from fleet.model.conflict.tracks import CommandId
from fleet.protocol.messages import Ack, Command

_COUNTS = (CommandState.SENT, CommandState.UNANSWERED, CommandState.RECEIVED)


class CommandExchange:
    """The commands to one UAV that may still count, in the order in which they were sent.

    `begun` says whether it has been commanded at all.
    """

    __slots__ = ("_again_ns", "_attempts", "_commands", "_retransmit_ns", "_since_ns", "begun")

    def __init__(self, retransmit_ns: int) -> None:
        self._commands: list[tuple[Command, CommandState]] = []
        self._retransmit_ns = retransmit_ns
        self._again_ns = 0
        self.begun = False
        self._attempts = 0
        self._since_ns = 0

    @property
    def waits(self) -> bool:
        """Whether the last command has neither been answered nor given up."""
        return bool(self._commands) and self._commands[-1][1] is CommandState.SENT

    @property
    def last(self) -> Command | None:
        """The last command that the UAV has, or that is on its way.

        One that expired without an answer may never have arrived: then it is the one before.
        """
        counts = (CommandState.SENT, CommandState.RECEIVED)
        return next((c for c, state in reversed(self._commands) if state in counts), None)

    def send(self, command: Command) -> None:
        """A new command is sent."""
        self._all(CommandEvent.NEXT_SENT)
        self._commands.append((command, CommandState.SENT))
        self._again_ns = command.issued_ns + self._retransmit_ns
        self._attempt(command.issued_ns)

    def overdue(self, limit_ns: int, share: float, now_ns: int) -> bool:
        """Whether nothing of it has been answered for longer than the limit, and that means much.

        `share` is how much of what the UAV sends comes through: as much, so it is taken, of what is
        sent to it.
        """
        if not self._attempts or now_ns - self._since_ns <= limit_ns:
            return False
        chance = 1.0
        for _ in range(self._attempts):
            chance *= 1.0 - share * share
        return chance <= RARE

    def _attempt(self, now_ns: int) -> None:
        self.begun = True
        if not self._attempts:
            self._since_ns = now_ns
        self._attempts += 1

    def repetition(self, now_ns: int) -> Command | None:
        """The command to send again now, if there is one; one that expired is given up."""
        if self.waits and now_ns > self._commands[-1][0].expiry_ns:
            self._one(len(self._commands) - 1, CommandEvent.EXPIRED)
        if not self.waits or now_ns < self._again_ns:
            return None
        self._again_ns = now_ns + self._retransmit_ns
        self._attempt(now_ns)
        return self._commands[-1][0]

    def on_new_term(self) -> None:
        """What is still on its way is stale now."""
        self._all(CommandEvent.NEW_TERM)

    def on_ack(self, ack: Ack) -> None:
        """An answer; to a command that does not count any more it says that the UAV is there."""
        self._attempts = 0
        index = self._index(ack.term, ack.number)
        if index is None:
            return
        if ack.accepted or ack.reason == "duplicate":
            self._arrived(index)
        elif ack.reason in FINAL:
            self._one(index, CommandEvent.REFUSED)
        else:
            self._one(index, CommandEvent.REFUSED_FOR_NOW)

    def on_flown(self, command_id: CommandId) -> None:
        """A broadcast that tells which command is flown: an answer, too."""
        index = self._index(command_id.term, command_id.number)
        if index is not None:
            self._attempts = 0
            self._arrived(index)

    def _arrived(self, index: int) -> None:
        """The UAV has that command; those sent before it are of no interest any more."""
        self._one(index, CommandEvent.ACCEPTED)
        self._all(CommandEvent.LATER_RECEIVED, index)

    def _all(self, event: CommandEvent, before: int | None = None) -> None:
        """It happens to all commands, or to those before one."""
        for index in reversed(range(len(self._commands) if before is None else before)):
            self._one(index, event)

    def _one(self, index: int, event: CommandEvent) -> None:
        command, state = self._commands[index]
        after = COMMAND_STATES[state, event]
        if after in _COUNTS:
            self._commands[index] = (command, after)
        else:
            del self._commands[index]

    def _index(self, term: int, number: int) -> int | None:
        numbers = [(command.term, command.number) for command, _ in self._commands]
        return numbers.index((term, number)) if (term, number) in numbers else None
