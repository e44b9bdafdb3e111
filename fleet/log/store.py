"""An opened log: what is in it, as columns and as messages."""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np
from mcap.records import Channel

from fleet.arguments import path_of, require
from fleet.config.scenario import Scenario
from fleet.errors import LogError
from fleet.html_tables import table_html_of
from fleet.log.batches import CHANNELS, CLASS_BY_KIND, Batches, decode_logged
from fleet.log.chunk import HEAD, Messages
from fleet.log.columns import Columns
from fleet.log.container import DamagedError, open_file
from fleet.log.contents import contents_of, unread_is_whole
from fleet.log.foreign import ForeignMessage, foreign_topics
from fleet.log.run_metadata import run_metadata_of
from fleet.log.scan import Damage, chunk_damaged
from fleet.log.topics import chosen
from fleet.log.unknown import is_unknown, unknown_classes
from fleet.model.units import to_ns
from fleet.protocol.codec import kind_of
from fleet.protocol.messages import Logged

_NEVER_NS = 1 << 64


class LogWarning(UserWarning):
    """A log is damaged or incomplete; the message says what is missing."""


@dataclass
class LogTotals:
    """What can be read of a log: messages by topic, bytes, times of the first and latest record."""

    messages: Counter[str]
    payload_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0


class Log:
    """A log, of which nothing but the summary is read until it is asked for.

    `topics` has the number of messages by topic, `metadata` the records `run` and `result`;
    `foreign` are the topics that another program has added, which `all_messages` alone gives;
    `unknown` are classes that are not known here, of which nothing is read.
    `start_ns` and `end_ns` are the times of the first and the last record. `warnings` say what is
    wrong with the file and what is missing because of it. What is damaged is left out; damage
    within a chunk comes to light when that chunk is read, or by `verify`.
    """

    def __init__(self, path: str | Path, warn: Callable[[str], None] | None = None) -> None:
        """Warnings go to `warn`, or to Python's own as LogWarning; raises LogError if it is no log.

        A log of a run that was killed, or of one that is still going on, is read through once.
        All methods that take key expressions raise ValueError for what is none.
        """
        self.path = path_of(path, "Log", "the path of a log")
        self.warnings: list[str] = []
        self._warn = warn or _python_warning
        with self._open() as file:
            self._contents = contents_of(self.path, file)
        self.metadata = {note.name: note.values for note in self._contents.notes}
        foreign = [c for c in self._contents.channels.values() if c.id in self._contents.foreign]
        self._foreign = {channel.id: channel for channel in foreign}
        self._topics = _known(self._contents.channels.values(), self._foreign)
        counts = self._contents.counts
        self.topics = {topic: counts[id_] for id_, topic in sorted(self._topics.items())}
        self.foreign = foreign_topics(foreign, self._contents.schemas, counts)
        channels = self._contents.channels.values()
        others = [c for c in channels if c.id not in self._foreign and is_unknown(c.topic)]
        self.unknown = unknown_classes({c.topic: counts[c.id] for c in others})
        spans = self._contents.spans
        self.start_ns = min((span.first_ns for span in spans), default=0)
        self.end_ns = max((span.last_ns for span in spans), default=0)
        self._kept: dict[str, Columns] = {}
        for damage in self._contents.damage:
            self._complain(self._contents.describe(damage))

    @property
    def complete(self) -> bool:
        """Whether the file is whole, as far as it has been read."""
        return not self.warnings

    @property
    def scenario(self) -> Scenario:
        """The scenario that was flown; raises LogError if it is not there or not understood."""
        return run_metadata_of(self.path, self.metadata).scenario

    def __repr__(self) -> str:
        state = "complete" if self.complete else "damaged or incomplete"
        return f"<log {self.path}: {self._contents.counts.total():,} messages, {state}>"

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        counts = sorted(self.topics.items())
        return table_html_of(("topic", "messages"), [(name, f"{n:,}") for name, n in counts])

    def __getitem__(self, topic: str) -> Columns:
        """All messages of a topic, as `columns` gives them; they are kept for the next time."""
        if topic not in self._kept:
            self._kept[topic] = self.columns(topic)
        return self._kept[topic]

    def columns(
        self, topics: str, start_s: float | None = None, end_s: float | None = None
    ) -> Columns:
        """The messages of a topic recorded at start_s <= t < end_s, as arrays.

        A key expression (`*/truth`) gives those of all its topics together, in the order of the
        log; they must be of one class.

        Raises:
            LogError: there is no such topic, or there are several classes of messages.

        """
        require(topics, str, "topics", "a topic or key expression, as 1/truth")
        ids = self._channels([topics])
        kinds = sorted({kind_of(self._topics[id_]) for id_ in ids})
        if not ids:
            raise LogError(f"{self.path}: no topic is '{topics}'; there are {_some(self.topics)}")
        if len(kinds) > 1:
            raise LogError(f"{self.path}: '{topics}' are messages of several classes: {kinds}")
        (batches,) = self._load(ids, start_s, end_s, apart=False)
        return batches.columns()

    def load(
        self, *topics: str, start_s: float | None = None, end_s: float | None = None
    ) -> dict[str, Columns]:
        """Columns by topic, of those that any of the key expressions includes; none: of all.

        The log is read once. Times as for `columns`.
        """
        ids = self._channels(topics)
        loaded = {b.kind: b for b in self._load(ids, start_s, end_s, apart=True)}
        topics_of = {id_: self._topics[id_] for id_ in ids}
        return {t: loaded[kind_of(t)].columns(id_) for id_, t in topics_of.items()}

    def messages(
        self,
        topics: str | Sequence[str] = (),
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Iterator[tuple[str, Logged, int]]:
        """Topic, message and time of recording in ns, in the order of the log.

        Of all topics, or of those that one of the key expressions includes; times as for `columns`.
        """
        ids = self._channels([topics] if isinstance(topics, str) else topics)
        for topic, message, log_ns in self._decoded(ids, start_s, end_s):
            if not isinstance(message, ForeignMessage):
                yield topic, message, log_ns

    def all_messages(
        self,
        topics: Sequence[str] = (),
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Iterator[tuple[str, Logged | ForeignMessage, int]]:
        """The same with those that another program has added, in the order of the log."""
        return self._decoded(self._channels(topics, with_foreign=True), start_s, end_s)

    def _decoded(
        self, ids: list[int], start_s: float | None, end_s: float | None
    ) -> Iterator[tuple[str, Logged | ForeignMessage, int]]:
        """The messages of channels, ours decoded; those that cannot be are told of at the end."""
        undecodable: Counter[int] = Counter()
        why = ""
        for messages in self._messages(ids, start_s, end_s):
            heads = messages.heads
            for id_, log_ns, record in zip(
                heads["channel"].tolist(), heads["log_ns"].tolist(), messages.bodies(), strict=True
            ):
                payload = record[HEAD.itemsize :]
                if id_ in self._foreign:
                    channel = self._foreign[id_]
                    yield channel.topic, ForeignMessage(channel.message_encoding, payload), log_ns
                    continue
                topic = self._topics[id_]
                try:
                    message = decode_logged(kind_of(topic), payload)
                except ValueError as error:
                    why = why or f"{topic}: {error}"
                    undecodable[id_] += 1
                else:
                    yield topic, message, log_ns
        if undecodable:
            hit = [self._topics[id_] for id_ in undecodable]
            which = hit[0] if len(hit) == 1 else f"{len(hit)} topics"
            self._complain(
                f"{undecodable.total():,} messages of {which} are left out, "
                f"because they cannot be decoded, the first of {why}"
            )

    def verify(self) -> LogTotals:
        """Read everything: `warnings` and `topics` then tell all that can be known and read."""
        totals, foreign = LogTotals(Counter(dict.fromkeys(self.topics, 0))), Counter[int]()
        is_ours = np.zeros(CHANNELS, bool)
        is_ours[[*self._topics]] = True
        for every in self._messages(self._channels((), with_foreign=True)):
            ours = is_ours[every.heads["channel"]]
            foreign.update(every.heads["channel"][~ours].tolist())
            if not ours.any():
                continue
            messages = every.rows(ours)
            heads = messages.heads
            if not totals.payload_bytes:
                totals.first_ns = int(heads["log_ns"][0])
            totals.last_ns = max(totals.last_ns, int(heads["log_ns"].max()))
            for id_, count in enumerate(np.bincount(heads["channel"]).tolist()):
                if count:
                    totals.messages[self._topics[id_]] += count
            totals.payload_bytes += int((messages.ends - messages.begins - HEAD.itemsize).sum())
        self.topics = dict(totals.messages)
        schemas = self._contents.schemas
        self.foreign = foreign_topics(self._foreign.values(), schemas, foreign)
        if self.complete:
            with self._open() as file:
                if not unread_is_whole(file, file.seek(0, 2)):
                    self._complain(
                        "all messages are there, but not all else is unchanged: other programs may "
                        "fail to read the file ('fleet recover' writes it anew)"
                    )
        return totals

    def _channels(self, topics: Sequence[str], *, with_foreign: bool = False) -> list[int]:
        """The channels of the topics that any of the key expressions includes; none: all."""
        names = dict(self._topics)
        if with_foreign:
            names |= {id_: channel.topic for id_, channel in self._foreign.items()}
        known = set(names.values())
        exact = known.intersection(topics)
        others = [topic for topic in topics if topic not in exact]
        wanted = exact | set(chosen([*known], others) if others or not topics else ())
        return [id_ for id_, topic in names.items() if topic in wanted]

    def _load(
        self, ids: list[int], start_s: float | None, end_s: float | None, *, apart: bool
    ) -> list[Batches]:
        """All messages of channels and times, by class."""
        by_kind: dict[str, dict[int, int]] = {}
        for id_ in ids:
            counts = by_kind.setdefault(kind_of(self._topics[id_]), {})
            counts[id_] = self._contents.counts[id_]
        loaded = [Batches(kind, counts, apart=apart) for kind, counts in by_kind.items()]
        place = np.zeros(CHANNELS, np.intp)
        for n, counts in enumerate(by_kind.values()):
            place[[*counts]] = n
        for messages in self._messages(ids, start_s, end_s):
            places = place[messages.heads["channel"]]
            for n, batches in enumerate(loaded):
                own = np.flatnonzero(places == n)
                if len(own):
                    batches.add(messages.rows(own))
        for batches in loaded:
            batches.finish()
            if batches.bad:
                self._complain(
                    f"{len(batches.bad):,} messages of class {batches.kind} are left out, because "
                    f"they cannot be decoded: {next(iter(batches.bad.values()))}"
                )
        return loaded

    def _messages(
        self, ids: list[int], start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[Messages]:
        """The messages of channels and times, chunk by chunk, from the chunks that have any."""
        first_ns = 0 if start_s is None else max(to_ns(start_s), 0)
        end_ns = _NEVER_NS if end_s is None else max(to_ns(end_s), 0)
        wanted, is_wanted = frozenset(ids), np.zeros(CHANNELS, bool)
        is_wanted[ids] = True
        with self._open() as file:
            for span in self._contents.readable:
                if span.first_ns >= end_ns or span.last_ns < first_ns or not wanted & span.channels:
                    continue
                try:
                    messages = self._contents.read(file, span)
                except DamagedError as error:
                    damage = Damage(span.offset, chunk_damaged(span.offset, error))
                    self._contents.damage.append(damage)
                    self._complain(self._contents.describe(damage))
                    continue
                log_ns = messages.heads["log_ns"]
                within = is_wanted[messages.heads["channel"]]
                within &= (log_ns >= first_ns) & (log_ns < end_ns)
                if within.any():
                    yield messages if within.all() else messages.rows(np.flatnonzero(within))

    def _complain(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)
            self._warn(f"{self.path}: {text}")

    def _open(self) -> IO[bytes]:
        try:
            return open_file(self.path)
        except OSError as error:
            raise LogError(f"cannot read {self.path}: {error.strerror}") from error


def _known(channels: Iterable[Channel], foreign: Container[int]) -> dict[int, str]:
    """Topics by channel, of the classes that there are."""
    return {
        c.id: c.topic for c in channels if kind_of(c.topic) in CLASS_BY_KIND and c.id not in foreign
    }


def _python_warning(text: str) -> None:
    """Warn as if from the line that called into this package."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals["__name__"].startswith("fleet.log"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, LogWarning, stacklevel=level)


def _some(topics: Iterable[str]) -> str:
    names = sorted(topics)
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
