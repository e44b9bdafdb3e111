"""Decoding by templates gives exactly what decoding message by message gives."""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.log.batches import CLASS_BY_KIND
from fleet.log.chunk import HEAD
from fleet.log.fields import FieldArray
from fleet.log.layout import Decoder, RawRecords
from fleet.protocol.bounds import TickNumber
from fleet.protocol.classes import MESSAGES
from fleet.protocol.codec import encode
from fleet.protocol.messages import (
    Clock,
    Digest,
    Message,
    PersistentState,
    StateBroadcast,
    Truth,
)
from tests.support.samples import CLOCK, DIGEST, SAMPLES, adsb, messages_of, pack, truth, unpack

fast = settings(deadline=None, derandomize=True, max_examples=60)
FIXED = [cls for cls in MESSAGES if Decoder(cls, 0).fixed]
PAD = bytes(HEAD.itemsize)


def decode(
    cls: type[Any], payloads: Sequence[bytes]
) -> tuple[dict[str, FieldArray], dict[int, str]]:
    """Columns of payloads that stand in one stretch of data and are added in two parts."""
    gap = HEAD.itemsize + 9
    ends = np.cumsum([gap + len(p) for p in payloads], dtype=np.int64)
    begins = np.append(0, ends)[:-1] + 9
    data = b"".join(bytes(9) + PAD + p for p in payloads)
    records, rows, half = RawRecords(), np.arange(len(payloads)), len(payloads) // 2
    for part in (slice(half), slice(half, None)):
        records.add(data, begins[part], ends[part], rows[part])
    decoder = Decoder(cls, HEAD.itemsize)
    out = decoder.columns(len(payloads))
    return out, decoder.decode(records, out)


def assert_same_as_plain(cls: type[Any], payloads: Sequence[bytes]) -> set[int]:
    """Compare with the decoder of single messages; returns the rows that it rejects.

    What a message leaves out is NaN.
    """
    columns, bad = decode(cls, payloads)
    plain = msgspec.msgpack.Decoder(cls)
    rejected = set()
    for row, payload in enumerate(payloads):
        try:
            message = plain.decode(payload)
        except ValueError:
            rejected.add(row)
            continue
        for name in message.__struct_fields__:
            value = msgspec.to_builtins(getattr(message, name))
            value = math.nan if value is None else value
            found = columns[name][row]
            if isinstance(found, np.ndarray):
                found = tuple(found.tolist())
            elif isinstance(found, np.generic):
                found = found.item()
            assert repr(found) == repr(value), name
    assert bad.keys() == rejected
    return rejected


def many(message: Message, n: int, seed: int = 0) -> list[bytes]:
    """A message n times with other numbers of every width, some of them NaN or out of bounds."""
    rng = random.Random(seed)
    whole = unpack(encode(message))
    out = []
    for _ in range(n):
        values: dict[str, Any] = {}
        for name, value in whole.items():
            if isinstance(value, bool):
                values[name] = rng.random() < 0.5
            elif isinstance(value, int):
                values[name] = rng.choice((rng.getrandbits(rng.choice((3, 7, 8, 16, 31, 52))), 1))
            elif isinstance(value, float):
                other = rng.uniform(-7.0, 7.0) if name != "speed_mps" else 25.0
                values[name] = rng.choice((other, value))
            elif isinstance(value, list):
                values[name] = [rng.uniform(-1e3, 1e3) for _ in value]
            else:
                values[name] = value
        out.append(pack(values))
    return out


@pytest.mark.parametrize("cls", FIXED, ids=lambda c: c.kind)
@given(data=st.data())
@fast
def test_any_messages_decode_as_they_do_one_by_one(cls: type[Message], data: st.DataObject) -> None:
    some = data.draw(st.lists(messages_of(cls), min_size=1, max_size=6))
    # Repeated, so that there are enough of each layout for a template.
    assert not assert_same_as_plain(cls, [encode(m) for m in some * 8])


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda m: m.kind)
def test_numbers_of_all_widths_decode_as_they_do_one_by_one(sample: Message) -> None:
    payloads = [encode(sample)] * 20
    if type(sample) in FIXED:
        payloads = many(sample, 1000) + payloads
    assert len(assert_same_as_plain(type(sample), payloads)) < len(payloads) / 2


def test_truth_and_broadcasts_are_of_fixed_layout() -> None:
    assert {Truth, StateBroadcast, PersistentState} <= {*FIXED}


def test_of_fixed_classes_only_broadcasts_check_more_than_types_and_that_is_known() -> None:
    assert [cls for cls in FIXED if hasattr(cls, "__post_init__")] == [StateBroadcast]
    payloads = [encode(adsb(n % 4 + 1)) for n in range(40)]
    ids = {pack({**unpack(p), "id": 0}) for p in payloads[:1]}
    assert assert_same_as_plain(StateBroadcast, payloads + [*ids] * 20) == set(range(40, 60))


TRUTH: dict[str, Any] = unpack(encode(truth(3, (1.5, 2.5, -300.0), 10**10)))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("heading_rad", 7.5),
        ("heading_rad", -7.5),
        ("heading_rad", float("nan")),
        ("speed_mps", float("inf")),
        ("t_ns", 2**63),
        ("seq", 2**53),
        ("command_term", -1),
        ("position_ned_m", [0.0, 0.0, 2e7]),
        ("position_ned_m", [0.0, 0.0]),
        ("mode", 5),
        ("mode", "x" * 65),
        ("id", 1.0),
        ("id", True),
        ("velocity_ned_mps", 1.0),
        ("waypoint_index", None),
    ],
)
@pytest.mark.parametrize("first", [False, True])
def test_what_is_no_message_is_left_out_and_all_others_are_there(
    field: str, value: Any, first: bool
) -> None:
    good, wrong = [pack(TRUTH)] * 30, [pack({**TRUTH, field: value})] * 12
    payloads = wrong + good if first else good + wrong
    assert len(assert_same_as_plain(Truth, payloads)) == 12


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("heading_rad", 1),
        ("heading_rad", -3),
        ("position_ned_m", [100, -200.5, -100_000]),
        ("speed_mps", 1000),
        ("mode", "naïve ✈"),
        ("mode", "ends in zero\0"),
        ("mode", "x" * 40),
        ("t_ns", 2**63 - 1),
        ("seq", 2**53 - 1),
    ],
)
def test_unusual_but_valid_messages_are_decoded(field: str, value: Any) -> None:
    payloads = [pack(TRUTH)] * 30 + [pack({**TRUTH, field: value})] * 12
    assert not assert_same_as_plain(Truth, payloads)


def test_other_encodings_of_the_same_message_are_decoded() -> None:
    short = struct.pack(">Bf", 0xCA, 0.25)
    single = pack(TRUTH).replace(struct.pack(">Bd", 0xCB, TRUTH["heading_rad"]), short, 1)
    wide = pack(TRUTH).replace(b"\xa2id\x03", b"\xa2id\xcf" + (3).to_bytes(8, "big"))
    turned = pack(dict(reversed(TRUTH.items())))
    assert len({pack(TRUTH), wide, turned, single}) == 4
    payloads = [pack(TRUTH), wide, turned, single] * 20
    assert not assert_same_as_plain(Truth, payloads)


class Sparse(msgspec.Struct, forbid_unknown_fields=True):
    """A class with a field that can be left out."""

    number: TickNumber
    other: TickNumber = 4


SPARSE = msgspec.msgpack.encode(Sparse(3, 5))


def test_a_field_that_is_left_out_has_its_default() -> None:
    short = pack({"number": 7})
    assert not assert_same_as_plain(Sparse, [short] * 20 + [SPARSE] * 20)
    assert decode(Sparse, [short] * 20)[0]["other"].tolist() == [4] * 20


def test_speeds_are_read_where_they_are_told_and_are_nan_elsewhere() -> None:
    """As also in logs that were written before there were any."""
    told = [pack({**TRUTH, "commanded_speed_mps": 20.0 + 0.1 * n}) for n in range(30)]
    payloads = [pack(TRUTH)] * 30 + told + [pack({**TRUTH, "commanded_speed_mps": None})] * 10
    assert not assert_same_as_plain(Truth, payloads)
    speeds = decode(Truth, payloads)[0]["commanded_speed_mps"]
    assert np.isnan(speeds[:30]).all()
    assert speeds[30:60].tolist() == [20.0 + 0.1 * n for n in range(30)]
    wrong = pack({**TRUTH, "commanded_speed_mps": 0.5})
    assert assert_same_as_plain(Truth, told + [wrong] * 5) == {*range(30, 35)}


def test_a_field_twice_is_no_template() -> None:
    twice = pack({"number": 7, "numbez": 8}).replace(b"numbez", b"number")
    more = b"\x83" + SPARSE[1:] + b"\xa5other\x04"
    assert not assert_same_as_plain(Sparse, [twice] * 20 + [SPARSE] * 20 + [more] * 20)


def test_a_number_beyond_64_bits_does_not_become_minus_one() -> None:
    good = encode(Digest(2**40, 5, "00"))
    wrong = good.replace((2**40).to_bytes(8, "big"), bytes([255] * 8))
    assert assert_same_as_plain(Digest, [good] * 20 + [wrong] * 9) == {*range(20, 29)}


def test_few_messages_are_decoded_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    decoder, decoded = Decoder(Truth, 0), list[bytes]()
    plain = decoder._decode

    def noted(payload: bytes) -> Any:
        decoded.append(payload)
        return plain(payload)

    monkeypatch.setattr(decoder, "_decode", noted)
    payloads = [pack({**TRUTH, "id": n % 100, "seq": n, "t_ns": n}) for n in range(5000)]
    data, ends = bytes(8) + b"".join(payloads), 8 + np.cumsum([len(p) for p in payloads])
    records = RawRecords()
    records.add(data, np.append(8, ends)[:-1], ends, np.arange(5000))
    out = decoder.columns(5000)
    assert decoder.decode(records, out) == {}
    assert out["seq"].tolist() == [*range(5000)]
    assert len(decoded) < 50


def test_text_that_is_another_in_each_message_is_decoded() -> None:
    payloads = [encode(Digest(n, n, f"{n:032x}")) for n in range(300)]
    columns, bad = decode(Digest, payloads)
    assert not bad
    assert columns["digest"].tolist() == [f"{n:032x}" for n in range(300)]


def test_no_messages_are_empty_columns_of_the_right_shapes() -> None:
    for cls in CLASS_BY_KIND.values():
        columns, bad = decode(cls, [])
        assert not bad
        assert all(len(column) == 0 for column in columns.values())
    assert decode(Truth, [])[0]["position_ned_m"].shape == (0, 3)


def test_what_varies_in_length_becomes_tuples_and_maps() -> None:
    columns, _ = decode(Clock, [encode(CLOCK)])
    assert columns["held"][0] == (0,)
    assert columns["expected"][0] == CLOCK.expected
    assert decode(Digest, [encode(DIGEST)])[0]["digest"][0] == DIGEST.digest
    decisions = [m for m in SAMPLES if m.kind == "decision"]
    (encounters,) = decode(type(decisions[0]), [encode(m) for m in decisions])[0]["encounters"]
    assert encounters[0]["sector"] == "head_on"
