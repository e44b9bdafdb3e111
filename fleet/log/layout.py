"""Decoding many messages of one class at once into numpy columns.

Messages of a class are the same MessagePack map over and over: the same names, and numbers at the
same places. So one message is decoded by the checked decoder; where its names, text and type codes
are is a template, which all others are compared with, byte by byte; and the numbers of those that
fit are read as strided arrays. What fits no template, or has a number out of bounds, goes to the
checked decoder by itself: the result is always the same as if each message had been decoded so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from fleet.log.fields import Field, FieldArray, fields_of
from fleet.model.types import COORDINATOR

FEW_ROWS = 8
"""Fewer messages than this are decoded one by one."""
MAX_TEMPLATES = 64
"""So many templates are tried on messages of one length,"""
MAX_MISSES = 8
"""and so many that fit but few, as where each message has another text."""

_WORD = 8
_NUMBERS = {
    0xCA: ">f4",
    0xCB: ">f8",
    0xCC: "u1",
    0xCD: ">u2",
    0xCE: ">u4",
    0xCF: ">u8",
    0xD0: "i1",
    0xD1: ">i2",
    0xD2: ">i4",
    0xD3: ">i8",
}
"""MessagePack's type codes of numbers, which follow them."""


@dataclass(frozen=True)
class _Number:
    """Where a number of a template is: which column, component, place in the record, as what."""

    field: Field
    component: int
    at: int
    code: str


@dataclass(frozen=True)
class _Template:
    """`pattern`: a record of 8-byte words where `mask` is set, 0 elsewhere.

    `constants` are texts, and NaN for numbers that are left out.
    """

    mask: FieldArray
    pattern: FieldArray
    numbers: list[_Number]
    constants: dict[str, str | float]

    def fits(self, words: FieldArray) -> FieldArray:
        """Which of the records (n, w) are of this template."""
        fits = np.ones(len(words), bool)
        for n, (mask, value) in enumerate(zip(self.mask, self.pattern, strict=True)):
            fits &= (words[:, n] & mask) == value
        return fits


class MisfitError(Exception):
    """A message that no template can be made of."""


class RawRecords:
    """Records of any lengths; those of one length are rows of a matrix of 8-byte words.

    A record stands at the end of its words: before it, where in a file it has its head, are up to 7
    bytes that do not belong to it.
    """

    def __init__(self) -> None:
        self.bytes = 0
        self._found: dict[int, list[tuple[FieldArray, FieldArray]]] = {}

    def add(self, data: bytes, begins: FieldArray, ends: FieldArray, rows: FieldArray) -> None:
        """Take the records `data[begin:end]`, each for a row of the columns."""
        lengths = ends - begins
        for length in map(int, np.unique(lengths)):
            same = np.flatnonzero(lengths == length)
            size = length + pad_of(length)
            every: FieldArray = np.ndarray((len(data) - size + 1, size), np.uint8, data, 0, (1, 1))
            words = every[ends[same] - size].view(np.uint64)
            self._found.setdefault(length, []).append((rows[same], words))
        self.bytes += int(lengths.sum())

    def by_length(self) -> Iterator[tuple[int, FieldArray, FieldArray]]:
        """Length in bytes, rows, and words (n, w) of the records."""
        for length, parts in self._found.items():
            rows, words = (
                parts[0] if len(parts) == 1 else map(np.concatenate, zip(*parts, strict=True))
            )
            yield length, rows, words


class Decoder:
    """Decodes messages of one class. `head` bytes before each payload are passed over."""

    def __init__(self, cls: type[msgspec.Struct], head: int) -> None:
        self.fields = {field.name: field for field in fields_of(cls)}
        self.fixed = all(field.fixed for field in self.fields.values())
        self._head = head
        self._decode: Callable[[bytes], Any] = msgspec.msgpack.Decoder(cls).decode
        self._checks_issuer = hasattr(cls, "__post_init__")

    def columns(self, n: int) -> dict[str, FieldArray]:
        """Empty columns for n messages."""
        return {name: field.column(n) for name, field in self.fields.items()}

    def decode(self, records: RawRecords, out: dict[str, FieldArray]) -> dict[int, str]:
        """Decode records into their rows of columns.

        Returns:
            The rows of those that cannot be decoded, and why not; their values have no meaning.

        """
        bad: dict[int, str] = {}
        for length, rows, words in records.by_length():
            left = np.arange(len(rows))
            if self.fixed:
                left = self._by_templates(words, rows, length, out)
            self._one_by_one(words[left], rows[left], length, out, bad)
        return bad

    def _by_templates(
        self, words: FieldArray, rows: FieldArray, length: int, out: dict[str, FieldArray]
    ) -> FieldArray:
        """Decode records of one length into their rows of `out`; returns those left over."""
        left, over, misses = np.arange(len(rows)), list[FieldArray](), 0
        for _ in range(MAX_TEMPLATES):
            if len(left) < FEW_ROWS or misses > MAX_MISSES:
                break
            try:
                template = self._template(words[left[0]].tobytes(), pad_of(length))
            except (MisfitError, ValueError):
                over.append(left[:1])
                left, misses = left[1:], misses + 1
                continue
            candidates = words if len(left) == len(words) else words[left]
            fits = template.fits(candidates)
            found = candidates if fits.all() else candidates[fits]
            doubtful = self._read(template, found, rows[left[fits]], out)
            over.append(left[fits][doubtful])
            left, misses = left[~fits], misses + (len(found) < FEW_ROWS)
        return np.concatenate([*over, left])

    def _read(
        self, template: _Template, words: FieldArray, rows: FieldArray, out: dict[str, FieldArray]
    ) -> FieldArray:
        """Read the numbers of records that fit; returns where one is not as it has to be."""
        doubtful = np.zeros(len(words), bool)
        where: Any = rows
        if (np.diff(rows) == 1).all():  # a slice is faster
            where = slice(rows[0], rows[-1] + 1)
        for number in template.numbers:
            found = number.field
            raw: FieldArray = np.ndarray(
                len(words), number.code, words, number.at, (words.strides[0],)
            )
            if found.dtype is bool:
                raw = raw == 0xC3
            if raw.dtype == np.dtype(">u8"):
                doubtful |= raw > np.iinfo(np.int64).max
            values: FieldArray = raw.astype(found.dtype)
            if found.low is not None and not values.min() >= found.low:
                doubtful |= ~(values >= found.low)
            if found.high is not None and not values.max() <= found.high:
                doubtful |= ~(values <= found.high)
            if self._checks_issuer and found.name == "id":
                # What a class of fixed layout checks beyond its types is that a UAV has issued it.
                doubtful |= values == COORDINATOR
            column = out[found.name]
            if found.width:
                column[where, number.component] = values
            else:
                column[where] = values
        for name, value in template.constants.items():
            out[name][where] = value
        return doubtful

    def _one_by_one(
        self,
        words: FieldArray,
        rows: FieldArray,
        length: int,
        out: dict[str, FieldArray],
        bad: dict[int, str],
    ) -> None:
        for row, record in zip(rows.tolist(), words, strict=True):
            try:
                message = self._decode(record.tobytes()[-length:][self._head :])
            except ValueError as error:
                bad[row] = str(error)
                continue
            for name, field in self.fields.items():
                value = getattr(message, name)
                if field.optional and value is None:
                    value = math.nan
                out[name][row] = value if field.fixed else msgspec.to_builtins(value)

    def _template(self, record: bytes, pad: int) -> _Template:
        """The template of a padded record; raises MisfitError, or ValueError if it is none."""
        begin = pad + self._head
        message = self._decode(record[begin:])
        free = bytearray(bytes(begin) + b"\xff" * (len(record) - begin))  # the mask
        numbers: list[_Number] = []
        constants: dict[str, str | float] = {}
        missing = dict(self.fields)
        at, count = _count(record, begin, 0x80, 0xDE)
        for _ in range(count):
            size, at = _text(record, at)
            name = record[at : at + size].decode()
            if name not in missing:
                raise MisfitError
            field, at = missing.pop(name), at + size
            if field.text:
                constants[field.name] = getattr(message, field.name)
                size, at = _text(record, at)
                at += size
                continue
            if field.width:
                at, _ = _count(record, at, 0x90, 0xDC)
            for component in range(max(field.width, 1)):
                number, after = _number(record, at, field, component)
                free[at:after] = _mask(record[at], after - at, field)
                numbers.append(number)
                at = after
        for name, field in missing.items():
            if not field.optional:
                raise MisfitError
            constants[name] = math.nan
        mask = np.frombuffer(bytes(free), np.uint64)
        return _Template(mask, np.frombuffer(record, np.uint64) & mask, numbers, constants)


def pad_of(length: int) -> int:
    """How many bytes are before a record of this length, so that all is words."""
    return -length % _WORD


def _number(record: bytes, at: int, field: Field, component: int) -> tuple[_Number, int]:
    """The number or truth value at a place of a record, and where it ends."""
    code = record[at]
    if field.dtype is bool:
        return _Number(field, component, at, "u1"), at + 1
    if code < 0x80 or code >= 0xE0:  # the code is the number itself
        return _Number(field, component, at, "i1"), at + 1
    form = _NUMBERS.get(code)
    if form is None or (field.dtype is np.int64 and "f" in form):
        raise MisfitError
    return _Number(field, component, at + 1, form), at + 1 + np.dtype(form).itemsize


def _mask(code: int, size: int, field: Field) -> bytes:
    """Which bits of a number are the same in all records of a template: those of its type."""
    if field.dtype is bool:
        return b"\xfe"
    if code < 0x80:
        return b"\x80"
    if code >= 0xE0:
        return b"\xe0"
    return b"\xff" + bytes(size - 1)


def _text(record: bytes, at: int) -> tuple[int, int]:
    """Length and place of a text; those of more than 255 bytes are left to the decoder."""
    code = record[at]
    if code & 0xE0 == 0xA0:
        return code & 0x1F, at + 1
    if code == 0xD9:
        return record[at + 1], at + 2
    raise MisfitError


def _count(record: bytes, at: int, short: int, long: int) -> tuple[int, int]:
    """Where a map or array begins, and how many items it has."""
    code = record[at]
    if code & 0xF0 == short:
        return at + 1, code & 0x0F
    if code == long:
        return at + 3, int.from_bytes(record[at + 1 : at + 3], "big")
    raise MisfitError
