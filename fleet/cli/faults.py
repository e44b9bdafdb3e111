"""The options for faults that commands share: one for each shorthand."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from fleet.faults.presets import PRESETS
from fleet.faults.shorthand import SHORTHANDS, rules_of

Given = dict[str, list[str]]
"""What was given on the command line, by shorthand."""

_HELP: dict[str, tuple[str, str]] = {
    "preset": ("NAME", f"Links as specified or measured: {', '.join(PRESETS)}."),
    "latency": ("TIME", "Delay every message, as 300ms or 2s."),
    "jitter": ("TIME", "Vary that delay uniformly by so much."),
    "loss": ("P", "Lose messages, as 20% or 0.2, on each link by itself."),
    "burst": ("TICKS", "Lose them in bursts of this mean length."),
    "range": ("LENGTH", "Lose what is sent from further away than 500m, 5km or 3NM."),
    "partition": ("GROUPS", "Cut the network between groups, as 1-2/3,4,coordinator."),
    "duplicate": ("P", "Deliver messages twice with this probability."),
    "replay": ("P", "Deliver messages again 5 s later with this probability."),
    "reorder": ("P", "Hold messages back for 1 s with this probability."),
    "corrupt": ("P", "Flip a bit with this probability; links reject what is corrupted."),
    "rate": ("RATE", "Send only 9600bit, 100kbit or 1Mbit a second on each link."),
    "kill": ("WHO@TIME", "Kill a process, as 1@40s; 1@40s+20s: start it again after 20 s."),
    "pause": ("WHO@TIME", "Stop a process for a while, as 3@50s+5s."),
    "slow": ("WHO:N", "Let a process step only every N-th tick, as 2:4@50s+10s."),
    "gps-noise": ("[WHO:]LENGTH", "Noise of the UAVs' own positions, as 10m or 2:10m."),
    "gps-freeze": ("WHO", "UAVs take their positions not to change, as 2@30s+10s."),
    "gps-dropout": ("WHO", "UAVs do not know where they are, as 2@30s+10s."),
    "clock-offset": ("WHO:TIME", "Set a clock ahead, as 2:500ms, or back, as 2:-500ms."),
}


def with_fault_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command an option for every shorthand; it gets all as its argument `faults`."""
    signature = inspect.signature(command, eval_str=True)
    names = {shorthand.replace("-", "_"): shorthand for shorthand in SHORTHANDS}

    @functools.wraps(command)
    def wrapped(**arguments: Any) -> int:
        faults = {names[n]: arguments.pop(n) or [] for n in names}
        return command(**arguments, faults=faults)

    own = [p for p in signature.parameters.values() if p.name != "faults"]
    options = [_option(name, shorthand) for name, shorthand in names.items()]
    annotations = {p.name: p.annotation for p in (*own, *options)}
    vars(wrapped).update(
        __signature__=signature.replace(parameters=[*own, *options]), __annotations__=annotations
    )
    return wrapped


def fault_tables(faults: Given, broadcast_s: float) -> list[dict[str, Any]]:
    """The `[[fault]]` tables that the options stand for; wrong ones are wrong usage."""
    try:
        return rules_of(faults, broadcast_s)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def _option(name: str, shorthand: str) -> inspect.Parameter:
    metavar, words = _HELP[shorthand]
    option = typer.Option(f"--{shorthand}", metavar=metavar, help=words)
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[list[str] | None, option],
    )
