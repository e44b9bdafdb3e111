"""The command line `fleet`.

Whatever goes wrong becomes one line on standard error (what, where, what to do) and an exit code:
0 done, 1 the run failed or is invalid, 2 wrong usage or scenario, 3 recovered, but not everything,
4 a role started by hand lost its simulation, 130 interrupted.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from fleet.errors import FailedError, FleetError
from fleet.printing import printable_streams
from fleet.simulation.interrupts import end_command, take_over
from fleet.version import __version__

COMMANDS = {
    "run": ("run", "scenarios"),
    "fault": ("fault",),
    "live": ("live",),
    "fuzz": ("fuzz",),
    "info": ("info",),
    "cat": ("cat",),
    "recover": ("recover",),
    "check": ("check",),
    "metrics": ("metrics", "compare"),
    "export": ("export", "view"),
    "import_": ("import",),
    "report": ("report",),
    "replay": ("replay",),
    "repeat": ("repeat",),
    "roles": ("uav", "coordinator", "router"),
    "relay": ("relay",),
    "hosts": ("hosts",),
    "secure": ("certs",),
    "conformance": ("conformance",),
    "study": ("study",),
}
"""The commands by the module that registers them, in the order of the help."""

USAGE, FAILED, INTERRUPTED = 2, 1, 130
NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Why a file, as standard output may be one, does not take what is written."""
TOO_MANY = (errno.EMFILE, errno.ENFILE)
"""Why no further file can be opened."""


class InterruptedCommandError(Exception):
    """Ctrl-C ended a command that had nothing more to say."""


class CommandGroup(TyperGroup):
    """The commands; typer itself would end without a word on Ctrl-C."""

    def make_context(self, *given: Any, **more: Any) -> Any:
        """Understand the command line; raises InterruptedCommandError on Ctrl-C."""
        with _not_silently():
            return super().make_context(*given, **more)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; raises InterruptedCommandError on Ctrl-C."""
        with _not_silently():
            return super().invoke(ctx)


@contextmanager
def _not_silently() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt as error:
        raise InterruptedCommandError from error


def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version and end.")] = False,
) -> None:
    """Fly fleets of UAV processes over zenoh and study how they keep apart."""
    if version:
        sys.stdout.write(f"fleet {__version__}\n")
        raise typer.Exit


def application(arguments: Sequence[str]) -> typer.Typer:
    """The command line, with the one command that it begins with, or else with all of them.

    To import what every command needs would take twice as long.
    """
    app = typer.Typer(
        name="fleet",
        cls=CommandGroup,
        epilog="Start with: fleet run four_way",
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_options)
    modules = [name for name, commands in COMMANDS.items() if {*arguments[:1]} & {*commands}]
    for module in modules or COMMANDS:
        import_module(f"fleet.cli.{module}").register(app)
    return app


def main() -> None:
    """Entry point of the command `fleet`."""
    with printable_streams():
        _main()


def _main() -> None:
    take_over(end_command)
    try:
        arguments = sys.argv[1:] or ["--help"]
        command = typer.main.get_command(application(arguments))
        code = command.main(arguments, prog_name="fleet", standalone_mode=False)
        sys.stdout.flush()
    except FleetError as error:
        code = _complain(str(error), FAILED if isinstance(error, FailedError) else USAGE)
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        where = context.command_path if context else "fleet"
        code = _complain(f"{error.format_message()} (see '{where} --help')", USAGE)
    except (KeyboardInterrupt, typer.Abort, InterruptedCommandError):
        code = _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader of a pipe has gone, as in `fleet info LOG | head`.
        sys.stderr.close()
        code = FAILED
    except OSError as error:
        if error.errno in TOO_MANY:
            why = f"{error.strerror}: raise the limit, as with 'ulimit -n 1024'"
        elif error.errno in NO_SPACE:
            why = f"cannot write the output: {error.strerror}"
            # Or the interpreter would try, and fail, once more.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        else:
            raise
        code = _complain(why, FAILED)
    sys.exit(code)


def _complain(message: str, code: int) -> int:
    sys.stderr.write(f"fleet: {' '.join(message.split())}\n")
    return code
