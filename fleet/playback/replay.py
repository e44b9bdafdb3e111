"""`fleet.LogReplay`: a log published on zenoh again, from a program or by the command."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Self

from fleet.analysis.recorded_run import RecordedRun
from fleet.arguments import path_of, require, require_each
from fleet.errors import BusError, LogError
from fleet.log.reader import Record, Summary, read
from fleet.playback.flush import flush
from fleet.playback.player import READ_AHEAD, Player, PlayerInput, ReplayReport
from fleet.playback.player_input import TimeOnly
from fleet.playback.schedule import (
    MAX_RATE,
    MIN_RATE,
    ReplayMessage,
    ReplayTimeline,
    Window,
    replay_messages,
)
from fleet.playback.topics import Selection, foreign_key
from fleet.transport.zenoh_bus import Bus, open_client_bus
from fleet.transport.zenoh_session import SessionOptions, open_router

MOST_UNFIT = 3
"""So many topics that cannot be replayed are named."""
PATIENCE_S = 10.0
"""A subscriber that takes nothing for so long is given up."""

_NAME = re.compile(r"[\w.-]+")


class LogReplay:
    """A log on its way to zenoh: use it as a context manager, and `play` it once.

    Within the context the bus is open: whoever subscribes to `fleet/RUN/**` at `endpoint` hears
    what is played. `report` tells how it went, also while it goes on.
    """

    def __init__(  # noqa: PLR0913 (a name has to be given with each but the first)
        self,
        log: str | PathLike[str] | RecordedRun,
        *,
        rate: float = 1.0,
        start_s: float = 0.0,
        duration_s: float | None = None,
        topics: str | Sequence[str] = (),
        exclude: str | Sequence[str] = (),
        remap: str | Sequence[str] = (),
        loop: bool = False,
        run: str = "",
        connect: str = "",
        listen: str = "tcp/127.0.0.1:0",
        wait_s: float = 10.0,
        force_live: bool = False,
        foreign: bool = False,
        zenoh_config: str = "",
    ) -> None:
        """`log` is a path or a run; `rate` is in log seconds a second.

        `start_s` and `duration_s` choose a part of the log, as do `topics` and `exclude`: key
        expressions without `fleet/RUN/`; `remap` is an `OLD:=NEW`; one of each, or several. `run`
        is the name in the keys (default: the log's). Messages go through the router at `connect`,
        waited for `wait_s` seconds, or else through one of its own at `listen`. `force_live`
        replays also under the name of a run that is on there, `foreign` also what other programs
        have added to the log. `zenoh_config` is a file of zenoh's own configuration.

        Raises:
            ValueError: a number out of range; a name, an expression or a renaming that is none.
            LogError: the run is in memory alone. ArgumentError: an argument is nothing of the kind.

        """
        path = _path(log)
        for number, name in ((rate, "rate"), (start_s, "start_s"), (duration_s or 0, "duration_s")):
            require(number, Real, name, "a number")
        require(run, str, "run", "the name of a run")
        if not MIN_RATE <= rate <= MAX_RATE:
            raise ValueError(f"rate {rate:g}: it must be from {MIN_RATE:g} to {MAX_RATE:g}")
        if not 0.0 <= start_s < float("inf") or not 0.0 <= (duration_s or 0.0) < float("inf"):
            raise ValueError(f"start_s={start_s:g}, duration_s={duration_s}: finite, from 0 on")
        self.rate = rate
        self.report = ReplayReport()
        self.endpoint = connect
        self._selection = Selection(*map(_several, (topics, exclude, remap)))
        length_ns = None if duration_s is None else round(1e9 * duration_s)
        self._window = Window(round(1e9 * start_s), length_ns)
        self._source = _Source(path, foreign=foreign)
        self._loop = loop
        self.run = _checked(run)
        self._connect, self._listen, self._wait_s = connect, listen, wait_s
        self._force_live, self._zenoh_config = force_live, zenoh_config
        self._open = ExitStack()
        self._bus: Bus | None = None
        self._schedule: Iterator[ReplayMessage] = iter(())

    def __repr__(self) -> str:
        """What is replayed, how fast, and how far it has come."""
        return (
            f"<replay of {self._source.summary.path} at rate {self.rate:g}: {self.report.words()}>"
        )

    def __enter__(self) -> Self:
        """Open the bus; what is wrong with the log shows before.

        Raises:
            LogError: the log cannot be read, or does not name its run.
            BusError: the router is not there, or a run of this name is on there.

        """
        source = replay_messages(
            self._source.records, self._window, self._selection, loop=self._loop
        )
        # read ahead, so that reading does not delay the first ones
        begun = list(itertools.islice(source, READ_AHEAD))
        self._schedule = itertools.chain(begun, source)
        self.run = self.run or _name(self._source.summary)
        with ExitStack() as opened:
            self._bus = opened.enter_context(self._opened_bus())
            if self._connect and not self._force_live and self._bus.is_alive("sim"):
                raise BusError(
                    f"run {self.run} is on at {self._connect}, and a replay in its name would "
                    "spoil it; give another with --run, or insist with --force-live"
                )
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bus."""
        self._bus = None
        self._open.close()

    def play(
        self,
        *,
        player_input: PlayerInput | None = None,
        delay_s: float = 0.0,
        paused: bool = False,
        clock_hz: float = 0.0,
        tell: Callable[[str], None] = lambda _: None,
    ) -> ReplayReport:
        """Publish it all in its timing, until subscribers have it; returns how it went.

        The first message goes out after `delay_s`, which gives subscribers time. `player_input` is
        a clock with keys in place of the real clock (`paused`: nothing is sent until a key says
        so), `clock_hz` how often the replay's own clock is published (0: never), `tell` takes words
        for the user.

        Raises:
            ValueError: it has been played, or its context has not been entered.
            BusError: the router of `connect` has gone.

        """
        if self._bus is None or self.report.rounds:
            raise ValueError("a replay is played once, within its context")
        bus, at = self._bus, player_input or TimeOnly()
        timeline = ReplayTimeline(at.now_ns() + round(1e9 * delay_s), self.rate, paused=paused)
        player = Player(timeline, at, bus.put, clock_hz=clock_hz, check=self._check, tell=tell)
        self.report = player.report
        player.play(self._schedule)
        if not flush(PATIENCE_S):
            tell("a subscriber does not take what is left for it; giving it up")
        self._check()
        return self.report

    def left_out(self) -> list[str]:
        """After playing: what was not replayed that might have been meant to be, in words."""
        source = self._source
        cut = source.to_the_end and not source.summary.complete
        words = f"{source.summary.path} is cut short or damaged: that was all up to there"
        unused = [f"no message was concerned by '{u}'" for u in self._selection.unused()]
        return [*([words] if cut else ()), *source.left_out(), *unused]

    def _opened_bus(self) -> Bus:
        """The bus, with a router of its own unless there is one to connect to."""
        if self._connect:
            options = SessionOptions(zenoh_config=self._zenoh_config)
            return open_client_bus(self.run, "replay", self._connect, self._wait_s, options)
        session, self.endpoint = open_router(
            self._listen, PATIENCE_S, zenoh_config=self._zenoh_config
        )
        return Bus(session, self.run, "replay")

    def _check(self) -> None:
        """Notice when a router of others has gone; raises BusError then."""
        if self._bus is not None and not self._bus.has_router():
            raise BusError(
                f"the zenoh router at {self._connect} has gone; what was replayed since is lost"
            )


class _Source:
    """The log, read from its beginning as often as asked."""

    def __init__(self, path: Path, *, foreign: bool) -> None:
        self.summary = Summary(path)
        self.to_the_end = False
        self._with_foreign = foreign
        self._keys: dict[str, str | None] = {}

    def records(self) -> Iterator[Record]:
        """All messages; those of other programs if they are asked for, by topics that can be."""
        summary = self.summary
        for record in read(summary.path, summary, foreign=self._with_foreign):
            if not record.foreign:
                yield record
                continue
            topic = self._key(record.topic)
            if topic is not None:
                yield replace(record, topic=topic)
        self.to_the_end = True
        if summary.foreign and not summary.messages and not self._with_foreign:
            raise LogError(f"{summary.path} has foreign messages alone; replay them with --foreign")

    def left_out(self) -> list[str]:
        """What is not replayed of other programs, in words."""
        unfit = sorted(topic for topic, key in self._keys.items() if key is None)
        if unfit:
            words = "which no key can have, or which is one of a run"
            return [f"not replayed: topic '{topic}', {words}" for topic in unfit[:MOST_UNFIT]]
        if self._with_foreign or not self.summary.foreign:
            return []
        count = sum(topic.messages for topic in self.summary.foreign)
        return [f"not replayed: {count} messages of foreign topics; --foreign does"]

    def _key(self, topic: str) -> str | None:
        if topic not in self._keys:
            self._keys[topic] = foreign_key(topic)
        return self._keys[topic]


def _several(texts: str | Sequence[str]) -> Sequence[str]:
    """One text as a list of it."""
    if isinstance(texts, str):
        return (texts,)
    require_each(texts, str, "topics, exclude or remap", "a text or a list of text")
    return texts


def _path(log: str | PathLike[str] | RecordedRun) -> Path:
    """The file of a log; raises LogError if a run has none."""
    if not isinstance(log, RecordedRun):
        return path_of(log, "LogReplay", "a run, or the path of its log")
    if log.path is None:
        raise LogError("this run has no log to replay: it is in memory alone")
    return log.path


def _checked(run: str) -> str:
    """The name of a run, if it is one, or empty; else raises ValueError."""
    if run and not _NAME.fullmatch(run):
        raise ValueError(f"'{run}' cannot be part of a key; give another with --run")
    return run


def _name(summary: Summary) -> str:
    """The run's name in the keys, once the log has been looked into."""
    name = str(summary.metadata.get("run", {}).get("run", ""))
    if not _NAME.fullmatch(name):
        what = f"names its run '{name}', which no key can have" if name else "names no run"
        raise LogError(f"{summary.path} {what}; give a name with --run")
    return name
