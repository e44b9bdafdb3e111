"""Where the messages of a chunk are, as arrays.

A chunk is a chain of records, each of which tells where the next begins. The message index beside
it lists the same places, so that one need not go along the chain record by record. It has no
checksum: so it is believed only if the records that it names form that chain.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from fleet.log.container import MESSAGE, RECORD, DamagedError, records_in
from fleet.log.fields import FieldArray

HEAD = np.dtype([("channel", "<u2"), ("seq", "<u4"), ("log_ns", "<u8"), ("sent_ns", "<u8")])
"""How the body of a message record begins."""

_MESSAGE = int(Opcode.MESSAGE)
_INDEX_HEAD = 6


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of a chunk in their order: `data[begins[k]:ends[k]]` is the body of record k.

    `heads` are the beginnings of these bodies, as HEAD.
    """

    data: bytes
    begins: FieldArray
    ends: FieldArray
    heads: FieldArray

    def rows(self, which: FieldArray) -> Messages:
        """Some of them, chosen as numpy does."""
        return Messages(self.data, self.begins[which], self.ends[which], self.heads[which])

    def bodies(self) -> list[bytes]:
        """The bodies of their records."""
        places = zip(self.begins.tolist(), self.ends.tolist(), strict=True)
        return [self.data[begin:end] for begin, end in places]


def at_each(data: bytes, places: FieldArray, form: np.dtype[np.void] | str) -> FieldArray:
    """What stands at places of the data, read as `form`; all must be within it."""
    form = np.dtype(form)
    if not len(places):
        return np.empty(0, form)
    every: FieldArray = np.ndarray(len(data) - form.itemsize + 1, form, data, 0, (1,))
    return every[places]


def messages_in(data: bytes, index: bytes = b"") -> Messages:
    """The messages of a chunk, with the help of the index that stands beside it.

    Raises:
        DamagedError: the data do not consist of records.

    """
    return _by_index(data, index) or _along_the_chain(data)


def _along_the_chain(data: bytes) -> Messages:
    places = [(begin, end) for op, _, begin, end in records_in(data) if op == _MESSAGE]
    begins, ends = np.array(places, np.int64).reshape(-1, 2).T
    return Messages(data, begins, ends, at_each(data, begins, HEAD))


def _by_index(data: bytes, index: bytes) -> Messages | None:
    """The messages that an index names; None if they are not exactly those of the chunk."""
    try:
        offsets = np.sort(np.concatenate(list(_offsets(index))))
        least = RECORD.size + MESSAGE.size
        if not len(offsets) or offsets[-1] > len(data) - least:
            return None
        offsets = offsets.astype(np.int64)
        sizes = at_each(data, offsets + 1, "<u8")
        if sizes.max() > len(data) or sizes.min() < MESSAGE.size:
            return None
        begins = offsets + RECORD.size
        ends = begins + sizes.astype(np.int64)
        if (at_each(data, offsets, "u1") != _MESSAGE).any() or _has_others(data, offsets, ends):
            return None
    except (DamagedError, ValueError):
        return None
    return Messages(data, begins, ends, at_each(data, begins, HEAD))


def _offsets(index: bytes) -> Iterable[FieldArray]:
    for opcode, _, begin, end in records_in(index):
        if opcode != Opcode.MESSAGE_INDEX:
            raise DamagedError("it is no index")
        pairs = np.frombuffer(index[begin + _INDEX_HEAD : end], "<u8")
        yield pairs.reshape(-1, 2)[:, 1]


def _has_others(data: bytes, offsets: FieldArray, ends: FieldArray) -> bool:
    """Whether what lies between these records is anything but records that are no messages."""
    starts, stops = np.append(0, ends), np.append(offsets, len(data))
    if (starts > stops).any():
        return True
    gaps = np.flatnonzero(starts < stops)
    return any(
        opcode == _MESSAGE
        for gap in gaps
        for opcode, *_ in records_in(data[starts[gap] : stops[gap]])
    )
