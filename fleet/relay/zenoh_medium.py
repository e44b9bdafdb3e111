"""A relay asks over zenoh: `fleet/{run}/{number}/step`, MessagePack both ways."""

from __future__ import annotations

import sys
from contextlib import suppress

import msgspec

from fleet.errors import FleetError, ProgramError
from fleet.protocol.topics import key, step_of
from fleet.relay.medium import LONGEST_ANSWER_BYTES, STOP_S, TOO_LONG, AnswerLimits
from fleet.relay.questions import RelayQuestion
from fleet.transport.zenoh_bus import Bus, NoReplyError


class ZenohMedium:
    """The program declares a queryable; that of another run, or several at once, is not heard."""

    def __init__(self) -> None:
        self._bus: Bus | None = None

    def begin(self, bus: Bus, question: RelayQuestion, wait_s: float) -> None:
        """Ask the first question, again until there is somebody who answers."""
        self._bus = bus
        where = key(bus.run, step_of(bus.name))
        payload = msgspec.msgpack.encode(question)
        try:
            answer = bus.question(step_of(bus.name), payload, wait_s)
            if answer is None:
                sys.stderr.write(f"fleet: UAV {bus.name} waits for its program at {where}\n")
                sys.stderr.flush()
                answer = bus.question(step_of(bus.name), payload, wait_s, wait_s=wait_s)
        except NoReplyError as error:
            raise ProgramError(f"UAV {bus.name}: its program {error}") from error
        if answer is None:
            raise ProgramError(
                f"UAV {bus.name}: no program answers at {where} within {wait_s:g} s; start it, "
                "or have the relay start it: -- PROGRAM"
            )

    def ask(self, question: RelayQuestion, limits: AnswerLimits) -> object:
        """The answer of the one program there is."""
        bus, payload = self._bus, msgspec.msgpack.encode(question)
        assert bus is not None
        try:
            answer = bus.question(
                step_of(bus.name), payload, limits.timeout_s, wait_s=limits.return_s
            )
        except NoReplyError as error:
            raise ProgramError(f"UAV {bus.name}: its program {error}") from error
        if answer is None:
            raise ProgramError(
                f"UAV {bus.name}: its program has gone: nobody answers at "
                f"{key(bus.run, step_of(bus.name))} any more"
            )
        if len(answer) > LONGEST_ANSWER_BYTES:
            raise ProgramError(f"UAV {bus.name}: {TOO_LONG}")
        try:
            return msgspec.msgpack.decode(answer)
        except (ValueError, RecursionError) as error:
            raise ProgramError(
                f"UAV {bus.name}: what its program answers is no MessagePack: {error}"
            ) from error

    def end(self, question: RelayQuestion) -> None:
        """Tell it to stop; it may leave without a word."""
        bus = self._bus
        if bus is not None:
            with suppress(FleetError, NoReplyError):
                bus.question(step_of(bus.name), msgspec.msgpack.encode(question), STOP_S)

    def abandon(self) -> None:
        """It sees the relay's token vanish."""
        self._bus = None
