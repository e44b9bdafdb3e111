"""`fleet replay`."""

from __future__ import annotations

import gc
import itertools
import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from fleet.errors import BusError, LogError
from fleet.log.reader import Record, Summary, read
from fleet.log.topics import expressions
from fleet.replay.flush import flush
from fleet.replay.player import READ_AHEAD, Player, ReplayReport
from fleet.replay.player_input import TerminalKeys, TimeOnly, has_keys, player_input
from fleet.replay.schedule import (
    MAX_RATE,
    MIN_RATE,
    ReplayMessage,
    ReplayTimeline,
    Window,
    replay_messages,
)
from fleet.replay.topics import Selection
from fleet.transport.zenoh_bus import Bus, open_client_bus, open_router

CLOCK_HZ = 40.0
LONGEST_S = 1e6
CONNECT_TIMEOUT_S = 10.0
"""A subscriber that takes nothing for so long is given up."""
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
    try:
        selection = Selection(expressions(topics), expressions(exclude_topics), remap or ())
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if start_paused and not has_keys():
        raise typer.BadParameter("--start-paused needs a terminal, for the space key")
    length_ns = None if playback_duration is None else round(1e9 * playback_duration)
    window = Window(round(1e9 * start_offset), length_ns)
    where = _Where(run, connect, listen, wait, force_live)
    try:
        with (
            _opened(log, window, selection, where, loop) as (source, schedule, bus),
            player_input() as at,
        ):
            begin_ns = at.now_ns() + round(1e9 * delay)
            timeline = ReplayTimeline(begin_ns, rate, paused=start_paused)
            player = Player(
                timeline,
                at,
                bus.put,
                clock_hz=clock or 0.0,
                check=lambda: where.check(bus),
                tell=_tell,
            )
            _explain_keys(at, start_paused)
            status = _play(player, schedule)
            if status == "complete":
                _see_off(bus, where)
                _warn(source, selection)
    except KeyboardInterrupt:  # before anything was sent, or after everything
        _tell("interrupted")
        return 130
    return _finish(player.report, status, log, as_json)


class _Source:
    """The log, read from its beginning as often as asked."""

    def __init__(self, path: Path) -> None:
        self.summary = Summary(path)
        self.to_the_end = False

    def records(self) -> Iterator[Record]:
        """All messages."""
        yield from read(self.summary.path, self.summary)
        self.to_the_end = True


@dataclass(frozen=True)
class _Where:
    """Where to publish: which run's keys, and whose router."""

    run: str
    connect: str
    listen: str
    wait_s: float
    force_live: bool = False

    def begin(self, bus: Bus) -> None:
        """Keep out of a run that is on; raises BusError then."""
        if self.connect and not self.force_live and bus.is_alive("sim"):
            raise BusError(
                f"run {bus.run} is on at {self.connect}, and a replay in its name would spoil it; "
                "give another with --run, or insist with --force-live"
            )

    def check(self, bus: Bus) -> None:
        """Notice when a router of others has gone; raises BusError then."""
        if not bus.has_router():
            raise BusError(
                f"the zenoh router at {self.connect} has gone; what was replayed since is lost"
            )


@contextmanager
def _opened(
    log: Path, window: Window, selection: Selection, where: _Where, loop: bool
) -> Iterator[tuple[_Source, Iterator[ReplayMessage], Bus]]:
    """The log as a tape, and the bus; what is wrong with the log shows before all else."""
    source = _Source(log)
    schedule = replay_messages(source.records, window, selection, loop=loop)
    begun = list(
        itertools.islice(schedule, READ_AHEAD)
    )  # so that reading does not delay the first ones
    gc.freeze()  # all this stays: a collection that looks through it would take its time
    schedule = itertools.chain(begun, schedule)
    with _bus(_name(where.run, source.summary), where) as bus:
        yield source, schedule, bus


def _name(run: str, summary: Summary) -> str:
    """The run's name in the keys."""
    name = run or summary.metadata.get("run", {}).get("run", "")
    if not name:
        raise LogError(f"{summary.path} does not say the name of its run; give one with --run")
    if not re.fullmatch(r"[\w.-]+", name):
        raise typer.BadParameter(f"'{name}' cannot be part of a key; give another with --run")
    return name


@contextmanager
def _bus(name: str, where: _Where) -> Iterator[Bus]:
    """The bus, with a router of its own unless there is one to connect to."""
    endpoint = where.connect
    if endpoint:
        bus = open_client_bus(name, "replay", endpoint, where.wait_s)
    else:
        session, endpoint = open_router(where.listen, CONNECT_TIMEOUT_S)
        bus = Bus(session, name, "replay")
    with bus:
        where.begin(bus)
        _tell(f"replaying as run {name} on {endpoint}: subscribe to fleet/{name}/**")
        yield bus


def _explain_keys(at: TimeOnly, paused: bool) -> None:
    if isinstance(at, TerminalKeys):
        _tell(f"{'paused; ' if paused else ''}{KEY_HELP}")


def _see_off(bus: Bus, where: _Where) -> None:
    """Stay until subscribers have what is queued for them."""
    if not flush(CONNECT_TIMEOUT_S):
        _tell("a subscriber does not take what is left for it; giving it up")
    where.check(bus)


def _play(player: Player, schedule: Iterator[ReplayMessage]) -> str:
    try:
        player.play(schedule)
    except KeyboardInterrupt:
        return "interrupted"
    return "complete"


def _tell(words: str) -> None:
    sys.stderr.write(f"fleet: {words}\n")
    sys.stderr.flush()


def _warn(source: _Source, selection: Selection) -> None:
    """Say what was not replayed that might have been meant to be."""
    if source.to_the_end and not source.summary.complete:
        _tell(f"{source.summary.path} is cut short or damaged: that was all up to there")
    for unused in selection.unused():
        _tell(f"no message was concerned by '{unused}'")


def _finish(report: ReplayReport, status: str, log: Path, as_json: bool) -> int:
    """Print how it went."""
    errors_s = report.errors_s()
    if as_json:
        told = {
            "log": str(log),
            "status": status,
            "messages": report.messages,
            "payload_bytes": report.payload_bytes,
            "rounds": report.rounds,
            "duration_s": report.duration_s,
            "timing_error_s": errors_s,
        }
        print(json.dumps(told))
    words = f"{report.messages} messages in {report.duration_s:.3f} s"
    if errors_s:
        spread = ", ".join(f"{name} {1e3 * value:.2f} ms" for name, value in errors_s.items())
        words += f"; timing error {spread}"
    if status == "interrupted":
        _tell(f"interrupted after {words}")
        return 130
    if not as_json:
        print(words)
    return 0
