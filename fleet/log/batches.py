"""Messages of one class gathered and decoded batch by batch."""

from __future__ import annotations

import msgspec
import numpy as np

from fleet.errors import LogError
from fleet.log.chunk import HEAD, Messages
from fleet.log.columns import Columns
from fleet.log.fields import FieldArray
from fleet.log.layout import Decoder, RawRecords
from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.messages import Logged

BATCH_BYTES = 2 << 20
"""So many bytes of messages are decoded at once: more is no faster, as the caches are used up."""

CLASS_BY_KIND = {cls.kind: cls for cls in LOGGED_CLASSES}
"""The classes by their names in topics."""
CHANNELS = 1 << 16
"""The number of channel IDs."""

_ALL_CHANNELS = 0
_DECODERS = {kind: msgspec.msgpack.Decoder(cls) for kind, cls in CLASS_BY_KIND.items()}


def decode_logged(kind: str, payload: bytes) -> Logged:
    """One message of a class; raises ValueError if it is none."""
    message: Logged = _DECODERS[kind].decode(payload)
    return message


class Batches:
    """Gathers messages of one class and makes columns of them.

    The columns are there from the start, with room for as many messages of each channel as there
    can be; what is gathered is decoded into them batch by batch. With `apart` the rows of each
    channel are by themselves, else all are in the order of adding.
    """

    def __init__(self, kind: str, counts: dict[int, int], *, apart: bool) -> None:
        """`counts`: the channels, and how many messages of each there are at most."""
        self.kind = kind
        self.bad: dict[int, str] = {}
        """Rows that could not be decoded, and why not."""
        self._decoder = Decoder(CLASS_BY_KIND[kind], HEAD.itemsize)
        self._records = RawRecords()
        total = sum(counts.values())
        out = self._decoder.columns(total)
        self._numbered = "seq" in out
        self._out = {
            "t_ns": out.pop("t_ns"),
            "log_ns": np.empty(total, np.int64),
            "seq": out.pop("seq") if self._numbered else np.empty(total, np.int64),
            **out,
        }
        rooms = counts if apart else {_ALL_CHANNELS: total}
        ends = np.cumsum([*rooms.values()]).tolist()
        self._first = {room: end - rooms[room] for room, end in zip(rooms, ends, strict=True)}
        self._end, self._next = np.zeros((2, CHANNELS), np.int64)
        self._end[[*rooms]] = ends
        self._next[[*rooms]] = [*self._first.values()]

    def add(self, messages: Messages) -> None:
        """Take messages of these channels; raises LogError if there are more than told."""
        rows = self._rows(messages.heads["channel"])
        self._out["log_ns"][rows] = messages.heads["log_ns"]
        if not self._numbered:
            self._out["seq"][rows] = messages.heads["seq"]
        self._records.add(messages.data, messages.begins, messages.ends, rows)
        if self._records.bytes > BATCH_BYTES:
            self._decode()

    def finish(self) -> None:
        """Decode what is left; `bad` and the columns are complete then."""
        self._decode()

    def columns(self, channel: int | None = None) -> Columns:
        """What was added of a channel, if they are apart; else all."""
        room = _ALL_CHANNELS if channel is None else channel
        first, end = self._first[room], int(self._next[room])
        part = {name: array[first:end] for name, array in self._out.items()}
        wrong = [row - first for row in self.bad if first <= row < end]
        if wrong:
            part = {name: np.delete(array, wrong, axis=0) for name, array in part.items()}
        return Columns(self.kind, part)

    def _rows(self, channels: FieldArray) -> FieldArray:
        """The rows for messages of these channels, which are taken then."""
        if len(self._first) == 1:
            channels = np.full(len(channels), next(iter(self._first)))
        order = np.argsort(channels, kind="stable")
        rooms, begins, counts = np.unique(channels[order], return_index=True, return_counts=True)
        rows = np.empty(len(channels), np.int64)
        rows[order] = np.repeat(self._next[rooms] - begins, counts) + np.arange(len(channels))
        self._next[rooms] += counts
        if (self._next > self._end).any():
            raise LogError("the log has more messages than its summary tells")
        return rows

    def _decode(self) -> None:
        self.bad |= self._decoder.decode(self._records, self._out)
        self._records = RawRecords()
