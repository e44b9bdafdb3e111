"""What is said in a run, as a line for people."""

from __future__ import annotations

import math

from fleet.model.types import COORDINATOR
from fleet.protocol.messages import Ack, Command, Election, Message


def said(message: Message) -> tuple[str, str]:
    """What kind of event a message is, and the event in words; of others than these nothing."""
    match message:
        case Election():
            members = ", ".join(map(str, message.members))
            elector = "itself" if message.id == message.computing else process_words(message.id)
            words = f"term {message.term}: UAV {message.computing} computes for {members}"
            return "election", f"{words}, elected by {elector}"
        case Command():
            command = f"UAV {message.id} to UAV {message.target}: {_manoeuvre(message)}"
            return "command", f"{command} (term {message.term})"
        case Ack() if message.accepted:
            return "accepted", f"UAV {message.id} accepts what UAV {message.target} commands"
        case Ack():
            reason = message.reason.replace("_", " ")
            return (
                "refused",
                f"UAV {message.id} refuses what UAV {message.target} commands: {reason}",
            )
        case _:
            return "", ""


def process_words(process: int) -> str:
    """How a process is called."""
    return "the coordinator" if process == COORDINATOR else f"UAV {process}"


def _manoeuvre(command: Command) -> str:
    parts = [command.manoeuvre.replace("_", " and ")]
    if command.turn_rad:
        side = "right" if command.turn_rad > 0.0 else "left"
        parts.append(f"{abs(math.degrees(command.turn_rad)):.0f}° {side}")
    if command.climb_mps:
        parts.append(f"{command.climb_mps:+.1f} m/s")
    if command.speed_mps:
        parts.append(f"{command.speed_mps:.1f} m/s")
    return " ".join(parts)
