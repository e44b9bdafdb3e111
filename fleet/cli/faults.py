"""The options for faults that commands share: one for each shorthand."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from fleet.faults.options import OptionRule
from fleet.faults.presets import PRESETS
from fleet.faults.registry import options
from fleet.faults.shorthand import PRESET, rules_of, shorthands

Given = dict[str, list[str]]
"""What was given on the command line, by shorthand."""


def with_fault_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command an option for every shorthand; it gets all as its argument `faults`."""
    signature = inspect.signature(command, eval_str=True)
    names = {shorthand.replace("-", "_"): shorthand for shorthand in shorthands()}

    @functools.wraps(command)
    def wrapped(**arguments: Any) -> int:
        faults = {names[n]: arguments.pop(n) or [] for n in names}
        return command(**arguments, faults=faults)

    own = [p for p in signature.parameters.values() if p.name != "faults"]
    given = [_parameter(name, *_help(shorthand)) for name, shorthand in names.items()]
    annotations = {p.name: p.annotation for p in (*own, *given)}
    vars(wrapped).update(
        __signature__=signature.replace(parameters=[*own, *given]), __annotations__=annotations
    )
    return wrapped


def fault_tables(faults: Given, broadcast_s: float) -> list[OptionRule]:
    """The `[[fault]]` tables that the options stand for; wrong ones are wrong usage."""
    try:
        return rules_of(faults, broadcast_s)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


def _help(shorthand: str) -> tuple[str, str, str]:
    """An option as `--help` shows it: its name, what it takes and what it does."""
    if shorthand == PRESET:
        return "--preset", "NAME", f"Links as specified or measured: {', '.join(PRESETS)}."
    (option,) = [option for _, option in options() if option.option == shorthand]
    return f"--{option.option}", option.metavar, option.help


def _parameter(name: str, option: str, metavar: str, words: str) -> inspect.Parameter:
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=None,
        annotation=Annotated[list[str] | None, typer.Option(option, metavar=metavar, help=words)],
    )
