"""What arrives on a bus, before anybody has looked into it, and what goes with it on the way."""

from __future__ import annotations

import struct
from functools import lru_cache

from msgspec import Struct

from fleet.model.types import Position
from fleet.protocol.topics import key

"""North, east, down in m."""

SEVERAL, DELETION, ATTACHMENT = "several topics", "deletion", "attachment"
"""Flaws: the key is an expression or of another run; it is a deletion; its attachment is absurd."""

KEY_LENGTH, KEYS_KEPT = 200, 1 << 14
"""What keys of up to this length say is kept, of so many: anybody can put on any key."""

FARTHEST_M = 1e7
CLOCKS_APART_NS = 3_600_000_000_000
_TIME = struct.Struct("<q")
_TIME_AND_PLACE = struct.Struct("<q3d")
_TIME_AND_ROUND = struct.Struct("<qq")
_TIME_PLACE_AND_ROUND = struct.Struct("<q3dq")


class Sample(Struct, frozen=True, gc=False):
    """A message as it came; Unix times of arrival and of publication in ns (0: not taken).

    `place` is where the sender's radio was (NED, m), where a fault makes that matter; `round_ns`
    how long the round of the resolver took that the sender has just run (0: none). With a `flaw` it
    is no message, whatever it says.
    """

    topic: str
    payload: bytes
    arrived_unix_ns: int = 0
    put_unix_ns: int = 0
    place: Position | None = None
    flaw: str = ""
    round_ns: int = 0


def attachment(put_unix_ns: int, place: Position | None = None, round_ns: int = 0) -> bytes | None:
    """What goes with a message: its time of publication (0: none) and its sender's place.

    And how long the sender's round took (0: none).
    """
    if round_ns and place is not None:
        return _TIME_PLACE_AND_ROUND.pack(put_unix_ns, *place, round_ns)
    if round_ns:
        return _TIME_AND_ROUND.pack(put_unix_ns, round_ns)
    if place is not None:
        return _TIME_AND_PLACE.pack(put_unix_ns, *place)
    return _TIME.pack(put_unix_ns) if put_unix_ns else None


def sample_of(
    run: str, full_key: str, payload: bytes, mark: bytes | None, arrived_unix_ns: int = 0
) -> Sample:
    """An arrival in a run; attachments of other sizes than ours are none."""
    short = len(full_key) <= KEY_LENGTH
    topic, flaw = _kept_topic_of(run, full_key) if short else _topic_of(run, full_key)
    if mark is None or flaw:
        return Sample(topic, payload, arrived_unix_ns, flaw=flaw)
    put_unix_ns, place, round_ns = _read(mark)
    far_ns = abs(arrived_unix_ns - put_unix_ns) if arrived_unix_ns and put_unix_ns else 0
    wild = place is not None and not all(abs(x) <= FARTHEST_M for x in place)
    wild = wild or not 0 <= round_ns <= CLOCKS_APART_NS
    if put_unix_ns < 0 or far_ns > CLOCKS_APART_NS or wild:
        return Sample(topic, payload, arrived_unix_ns, flaw=ATTACHMENT)
    return Sample(topic, payload, arrived_unix_ns, put_unix_ns, place, round_ns=round_ns)


def _topic_of(run: str, full_key: str) -> tuple[str, str]:
    """The topic of a key in a run, and what is wrong with it."""
    begin = key(run, "")
    flawed = "*" in full_key or not full_key.startswith(begin)
    return full_key.removeprefix(begin), SEVERAL if flawed else ""


_kept_topic_of = lru_cache(KEYS_KEPT)(_topic_of)


def _read(mark: bytes) -> tuple[int, Position | None, int]:
    if len(mark) == _TIME_PLACE_AND_ROUND.size:
        put_unix_ns, north, east, down, round_ns = _TIME_PLACE_AND_ROUND.unpack(mark)
        return put_unix_ns, (north, east, down), round_ns
    if len(mark) == _TIME_AND_PLACE.size:
        put_unix_ns, north, east, down = _TIME_AND_PLACE.unpack(mark)
        return put_unix_ns, (north, east, down), 0
    if len(mark) == _TIME_AND_ROUND.size:
        put_unix_ns, round_ns = _TIME_AND_ROUND.unpack(mark)
        return put_unix_ns, None, round_ns
    return (_TIME.unpack(mark)[0], None, 0) if len(mark) == _TIME.size else (0, None, 0)
