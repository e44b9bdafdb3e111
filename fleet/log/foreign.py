"""Foreign channels of a log, which another program has added: which those are, what they say.

A channel is foreign if neither its topic nor its schema is of ours. Nothing is known of the types
of its messages, so those are decoded without any, and within limits: they may be anything.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Schema

from fleet.errors import LogError
from fleet.log.recorder import ENCODING, PROFILE
from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.codec import kind_of
from fleet.protocol.topics import issuer_of

_msgpack: Any = importlib.import_module("msgpack")  # it has no type information

MAX_DECODED_BYTES = 1 << 20
"""A larger message is not decoded."""
MAX_DEPTH = 32
"""One with maps or lists deeper in each other than this is refused."""

INTEGERS = (-(1 << 63), (1 << 64) - 1)
"""The least and the greatest that stays a number; beyond them JSON has others become text."""

OUR_KINDS = frozenset(cls.kind for cls in LOGGED_CLASSES)


@dataclass(frozen=True, slots=True)
class ForeignTopic:
    """A topic of another program: its encoding and schema as the log names them, its messages."""

    topic: str
    encoding: str
    schema: str
    messages: int = 0


def is_foreign(path: Path, channel: Channel, schemas: Mapping[int, Schema]) -> bool:
    """Whether a channel is of another program.

    Raises:
        LogError: it has a topic of ours, and is none of ours.

    """
    schema = schemas[channel.schema_id].name if channel.schema_id in schemas else ""
    ours = schema.startswith(f"{PROFILE}.")
    if not issuer_of(channel.topic) or kind_of(channel.topic) not in OUR_KINDS:
        return not ours
    lost = channel.schema_id and channel.schema_id not in schemas  # in a part that is damaged
    if not (ours or lost) or channel.message_encoding != ENCODING:
        raise LogError(
            f"{path} is not a fleet log: topic '{channel.topic}' has messages of type '{schema}' "
            f"in '{channel.message_encoding}' ('{PROFILE}.{kind_of(channel.topic)}' in "
            f"'{ENCODING}' is expected)"
        )
    return False


def foreign_topics(
    channels: Iterable[Channel], schemas: Mapping[int, Schema], counts: Mapping[int, int]
) -> tuple[ForeignTopic, ...]:
    """What there is of these channels; several of the same topic, encoding and schema are one."""
    found: dict[tuple[str, str, str], int] = {}
    for channel in channels:
        schema = schemas[channel.schema_id].name if channel.schema_id in schemas else ""
        key = channel.topic, channel.message_encoding, schema
        found[key] = found.get(key, 0) + counts.get(channel.id, 0)
    return tuple(ForeignTopic(*key, count) for key, count in sorted(found.items()))


@dataclass(frozen=True, slots=True)
class ForeignMessage:
    """A message of another program, not decoded."""

    encoding: str
    payload: bytes

    @property
    def has_decoder(self) -> bool:
        """Whether the encoding is one that `value` knows."""
        return self.encoding in _DECODERS

    def value(self) -> Any:
        """What it says: maps by text, lists, text, numbers, truth values and None.

        Of MessagePack bytes become text as in `0x00ff`, extensions `ext 5: 0x00ff`, time stamps
        their ns since 1970, and keys that are no text their JSON.

        Raises:
            ValueError: it is malformed, too large or too deep, or there is no decoder.

        """
        if not self.has_decoder:
            raise ValueError(f"there is no decoder for '{self.encoding}'")
        if len(self.payload) > MAX_DECODED_BYTES:
            raise ValueError(f"it has {len(self.payload):,} bytes, more than {MAX_DECODED_BYTES:,}")
        try:
            return _plain(_DECODERS[self.encoding](self.payload), MAX_DEPTH)
        except RecursionError:
            raise ValueError("it is nested too deeply") from None
        except _MALFORMED as error:
            raise ValueError(str(error) or "it is malformed or nested too deeply") from error


@dataclass
class ForeignDecoder:
    """Decodes one message after the other, and keeps account of those that cannot be decoded."""

    failed: int = 0
    first: str = ""

    def value(self, topic: str, message: ForeignMessage, log_ns: int) -> Any:
        """What a message says; raises ValueError as it does itself."""
        try:
            return message.value()
        except ValueError as error:
            if message.has_decoder:
                self.failed += 1
                self.first = self.first or f"{topic} at {log_ns / 1e9:.6f} s: {error}"
            raise

    def problem(self) -> str:
        """What could not be decoded, though its encoding is known, in a line; empty if nothing."""
        if self.failed < 2:
            return self.first and f"a message cannot be decoded: {self.first}"
        return f"{self.failed:,} messages cannot be decoded, the first of {self.first}"


class _Pairs(list[tuple[Any, Any]]):
    """A map as it is decoded: no key is hashed before it is known to be a plain one."""


def _unpacked(payload: bytes) -> Any:
    return _msgpack.unpackb(payload, object_pairs_hook=_Pairs, strict_map_key=False)


_MALFORMED = (ValueError, TypeError, OverflowError, _msgpack.exceptions.UnpackException)
_DECODERS: dict[str, Callable[[bytes], Any]] = {"msgpack": _unpacked, "json": msgspec.json.decode}


def _plain(value: Any, depth: int) -> Any:
    if isinstance(value, _Pairs | dict | list) and not depth:
        raise ValueError(f"it is nested more than {MAX_DEPTH} deep")
    match value:
        case _Pairs():
            return _map(value, depth)
        case dict():
            return {key: _plain(part, depth - 1) for key, part in value.items()}
        case list():
            return [_plain(part, depth - 1) for part in value]
        case int() if not INTEGERS[0] <= value <= INTEGERS[1]:
            return str(value)
        case bytes():
            return _hex(value)
        case _msgpack.Timestamp():
            return value.to_unix_nano()
        case _msgpack.ExtType():
            return f"ext {value.code}: {_hex(value.data)}"
        case _:
            return value


def _map(pairs: _Pairs, depth: int) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, part in pairs:
        if isinstance(key, list):
            raise ValueError("a key is a list or a map")
        plain = _plain(key, depth)
        name = plain if isinstance(plain, str) else msgspec.json.encode(plain).decode()
        if name in out:
            raise ValueError(f"it has the key '{name[:40]}' twice")
        out[name] = _plain(part, depth - 1)
    return out


def _hex(data: bytes) -> str:
    return f"0x{data.hex()}"
