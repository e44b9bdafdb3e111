"""The radio of one participant over zenoh: what of all that arrives is within its range."""

from __future__ import annotations

from fleet.model.radio import Ear, RadioRange
from fleet.model.types import Position
from fleet.node.runner import NodeRunner
from fleet.protocol.messages import Message


class OwnRadio:
    """Goes with its node runner: `move` after each step."""

    def __init__(self, radio: RadioRange, runner: NodeRunner) -> None:
        self._radio = radio
        self._runner = runner
        self._ear = Ear(runner.node.position_ned_m)

    @property
    def place(self) -> Position | None:
        """Where it is, to be told with each message; None if nobody needs to know."""
        return self._runner.node.position_ned_m if self._radio.limited else self._runner.place

    def hears(self, message: Message, there: Position | None) -> bool:
        """Whether a message that was sent there is within range."""
        return self._radio.reaches(message.id, self._runner.node.id, there, self._ear.place)

    def move(self) -> None:
        """Its node has made a step."""
        self._ear.move(self._runner.node.position_ned_m, self._radio.margin_m)
