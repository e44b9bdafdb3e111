"""`fleet replay`."""

from __future__ import annotations

import gc
import itertools
import json
import re
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from fleet.cli.zenoh_config import ZenohConfig
from fleet.log.topics import expressions
from fleet.playback.player import ReplayReport
from fleet.playback.player_input import TerminalKeys, TimeOnly, has_keys, player_input
from fleet.playback.replay import LogReplay
from fleet.playback.schedule import MAX_RATE, MIN_RATE

CLOCK_HZ = 40.0
LONGEST_S = 1e6
KEY_HELP = (
    "keys: space pauses, right sends the next message while paused, up and down change the rate"
)


class ReplayCommand(TyperCommand):
    """Lets `--clock` stand without a number."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give it its default where none follows."""
        filled = []
        for arg, following in itertools.zip_longest(args, args[1:], fillvalue=""):
            filled.append(arg)
            if arg == "--clock" and not re.fullmatch(r"[0-9.]+", following):
                filled.append(f"{CLOCK_HZ:g}")
        return super().parse_args(ctx, filled)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("replay", cls=ReplayCommand)(replay)


def replay(
    log: Annotated[Path, typer.Argument(help="An MCAP log written by 'fleet run'.")],
    rate: Annotated[
        float,
        typer.Option("--rate", "-r", min=MIN_RATE, max=MAX_RATE, help="Times as fast as logged."),
    ] = 1.0,
    loop: Annotated[
        bool, typer.Option("--loop", "-l", help="Begin again at the end, until Ctrl-C.")
    ] = False,
    start_offset: Annotated[
        float, typer.Option(min=0.0, max=LONGEST_S, help="Begin this many seconds into the log.")
    ] = 0.0,
    playback_duration: Annotated[
        float | None,
        typer.Option(min=0.0, max=LONGEST_S, help="Replay this many seconds of the log."),
    ] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEYEXPR", help="Only these topics, as '*/adsb/**,*/cmd/*'. Several times too."
        ),
    ] = None,
    exclude_topics: Annotated[
        list[str] | None, typer.Option(metavar="KEYEXPR", help="Not these topics.")
    ] = None,
    remap: Annotated[
        list[str] | None,
        typer.Option(
            "--remap", "-m", metavar="OLD:=NEW", help="Rename a topic; 1/**:=9/** all below 1."
        ),
    ] = None,
    start_paused: Annotated[
        bool, typer.Option("--start-paused", "-p", help="Wait for the space key.")
    ] = False,
    delay: Annotated[
        float,
        typer.Option(
            "--delay", "-d", min=0.0, max=LONGEST_S, help="Wait so many seconds: for subscribers."
        ),
    ] = 0.0,
    clock: Annotated[
        float | None,
        typer.Option(
            metavar="[HZ]",
            min=0.001,
            max=10_000.0,
            help="Publish the replay's clock on replay/clock; 40 times a second if not said.",
        ),
    ] = None,
    run: Annotated[str, typer.Option(help="Name of the run in the keys; default: the log's.")] = "",
    connect: Annotated[
        str, typer.Option(metavar="ENDPOINT", help="Publish through the zenoh router there.")
    ] = "",
    listen: Annotated[
        str,
        typer.Option(metavar="ENDPOINT", help="Else be a router here; port 0 takes any free one."),
    ] = "tcp/127.0.0.1:0",
    wait: Annotated[
        float, typer.Option(min=0.1, max=3600.0, help="Seconds to wait for the router.")
    ] = 10.0,
    force_live: Annotated[
        bool,
        typer.Option("--force-live", help="Replay also under the name of a run that is on there."),
    ] = False,
    foreign: Annotated[
        bool,
        typer.Option("--foreign", help="Publish also what other programs have added to the log."),
    ] = False,
    zenoh_config: ZenohConfig = "",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object, nothing else.")
    ] = False,
) -> int:
    """Publish a log on zenoh again: same keys, same bytes, same order, in its own timing.

    \b
    Examples:
      fleet replay four_way.mcap --listen tcp/127.0.0.1:7447 --delay 5
      fleet replay four_way.mcap -r 10 --topics '*/truth,*/cmd/*'
      fleet replay four_way.mcap --loop --clock --connect tcp/127.0.0.1:7447
    """  # noqa: D301 (the \b keeps the lines apart)
    if start_paused and not has_keys():
        raise typer.BadParameter("--start-paused needs a terminal, for the space key")
    try:
        chosen = LogReplay(
            log,
            rate=rate,
            start_s=start_offset,
            duration_s=playback_duration,
            topics=expressions(topics),
            exclude=expressions(exclude_topics),
            remap=remap or (),
            loop=loop,
            run=run,
            connect=connect,
            listen=listen,
            wait_s=wait,
            force_live=force_live,
            foreign=foreign,
            zenoh_config=zenoh_config,
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    try:
        with chosen as opened, player_input() as at:
            _tell(
                f"replaying as run {opened.run} on {opened.endpoint}: "
                f"subscribe to fleet/{opened.run}/**"
            )
            _explain_keys(at, start_paused)
            gc.freeze()  # what is read ahead stays: a collection that looks through it takes time
            status = _play(opened, at, delay, start_paused, clock or 0.0)
            if status == "complete":
                for words in opened.left_out():
                    _tell(words)
    except KeyboardInterrupt:  # before anything was sent, or after everything
        _tell("interrupted")
        return 130
    return _finish(chosen.report, status, log, as_json)


def _explain_keys(at: TimeOnly, paused: bool) -> None:
    if isinstance(at, TerminalKeys):
        _tell(f"{'paused; ' if paused else ''}{KEY_HELP}")


def _play(opened: LogReplay, at: TimeOnly, delay_s: float, paused: bool, clock_hz: float) -> str:
    try:
        opened.play(player_input=at, delay_s=delay_s, paused=paused, clock_hz=clock_hz, tell=_tell)
    except KeyboardInterrupt:
        return "interrupted"
    return "complete"


def _tell(words: str) -> None:
    sys.stderr.write(f"fleet: {words}\n")
    sys.stderr.flush()


def _finish(report: ReplayReport, status: str, log: Path, as_json: bool) -> int:
    """Print how it went."""
    if as_json:
        told = {
            "log": str(log),
            "status": status,
            "messages": report.messages,
            "payload_bytes": report.payload_bytes,
            "rounds": report.rounds,
            "duration_s": report.duration_s,
            "timing_error_s": report.errors_s(),
        }
        print(json.dumps(told))
    if status == "interrupted":
        _tell(f"interrupted after {report.words()}")
        return 130
    if not as_json:
        print(report.words())
    return 0
