"""The radio of one participant over zenoh: where it is, what it subscribes to, what it hears."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config.scenario import Scenario
from fleet.model.radio import Ear
from fleet.model.types import Position
from fleet.node.runner import NodeRunner
from fleet.protocol.cells import CellBlock, names_in
from fleet.protocol.messages import Message
from fleet.protocol.topics import subscribed


class OwnRadio:
    """Goes with its node runner: `move` after each step.

    `cell` is the one that it is in, empty if the run has none; `suffixes` is what it subscribes to
    there, of each issuer, in delivery order.
    """

    def __init__(self, scenario: Scenario, runner: NodeRunner) -> None:
        self._radio, self._cells = scenario.radio(), scenario.cells()
        self._runner = runner
        here = runner.node.position_ned_m
        self._ear = Ear(here)
        self._block: CellBlock | None = None
        self.cell = self._cells.name(here) if self._cells else ""
        self.suffixes: Sequence[str] = ()
        self._look_round(here)

    @property
    def place(self) -> Position | None:
        """Where it is, to be told with each message; None if nobody needs to know."""
        return self._runner.node.position_ned_m if self._radio.limited else self._runner.place

    def hears(self, message: Message, there: Position | None) -> bool:
        """Whether a message that was sent there is within range."""
        if not self._radio.limited:
            return True
        return self._radio.reaches(message.id, self._runner.node.id, there, self._ear.place)

    def move(self) -> None:
        """Its node has made a step."""
        here = self._runner.node.position_ned_m
        self._ear.move(here, self._radio.margin_m)
        if self._cells:
            self.cell = self._cells.name(here)
            self._look_round(here)

    def _look_round(self, here: Position) -> None:
        """Subscribe to what is within reach of here, if that has changed."""
        node = self._runner.node
        if self._cells is None:
            self.suffixes = subscribed(node.id, node.hears, None)
            return
        block = self._cells.block(here)
        if block != self._block:
            self._block = block
            self.suffixes = subscribed(node.id, node.hears, names_in(block))
