"""Payloads: exactly one valid message of the topic's class, or ValueError."""

from __future__ import annotations

import itertools
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.protocol.classes import MESSAGES
from fleet.protocol.codec import decode, decode_clock, encode, kind_of
from fleet.protocol.messages import Message
from fleet.protocol.topics import topic_of
from tests.support.samples import (
    CLOCK,
    SAMPLES,
    any_message,
    float_paths,
    messages_of,
    pack,
    replaced,
)
from tests.support.samples import unpack as independently

each_sample = pytest.mark.parametrize("sample", SAMPLES, ids=lambda m: m.kind)
fast = settings(deadline=None, derandomize=True, max_examples=60)


def plain(value: Any) -> Any:
    """The value as a MessagePack reader without knowledge of the classes sees it."""
    if isinstance(value, msgspec.Struct):
        fields, short = msgspec.structs.fields(value), value.__struct_config__.omit_defaults
        told = {f.name: getattr(value, f.name) for f in fields}
        left_out = {f.name for f in fields if short and told[f.name] == f.default}
        return {name: plain(item) for name, item in told.items() if name not in left_out}
    return [plain(item) for item in value] if isinstance(value, tuple) else value


def test_samples_cover_every_class() -> None:
    assert tuple(type(m) for m in SAMPLES) == MESSAGES


@pytest.mark.parametrize("cls", MESSAGES, ids=lambda c: c.kind)
@given(data=st.data())
@fast
def test_every_class_round_trips(cls: type[Message], data: st.DataObject) -> None:
    message = data.draw(messages_of(cls))
    assert decode(topic_of(message), encode(message)) == message


def test_the_clock_round_trips() -> None:
    assert decode_clock(encode(CLOCK)) == CLOCK


@each_sample
def test_payload_is_a_map_with_named_fields_for_any_messagepack_reader(sample: Message) -> None:
    assert independently(encode(sample)) == plain(sample)


@each_sample
def test_what_another_messagepack_writer_encodes_is_understood(sample: Message) -> None:
    assert decode(topic_of(sample), pack(plain(sample))) == sample


@each_sample
def test_truncation_at_any_byte_is_rejected(sample: Message) -> None:
    payload = encode(sample)
    for length in range(len(payload)):
        with pytest.raises(ValueError):  # noqa: PT011
            decode(topic_of(sample), payload[:length])


@given(message=any_message(), tail=st.binary(min_size=1, max_size=8))
@fast
def test_trailing_bytes_are_rejected(message: Message, tail: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(message), encode(message) + tail)


@each_sample
def test_two_messages_in_one_payload_are_rejected(sample: Message) -> None:
    with pytest.raises(ValueError, match="trailing"):
        decode(topic_of(sample), 2 * encode(sample))


def float_cases() -> list[Any]:
    """Every float of every sample."""
    return [
        pytest.param(m, path, id=f"{m.kind}-{'.'.join(map(str, path))}")
        for m in SAMPLES
        for path in float_paths(plain(m))
    ]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("sample", "path"), float_cases())
def test_not_a_number_and_infinity_are_rejected(
    sample: Message, path: tuple[str | int, ...], value: float
) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(sample), pack(replaced(plain(sample), path, value)))


@each_sample
def test_an_unknown_field_is_rejected(sample: Message) -> None:
    with pytest.raises(ValueError, match="unknown field"):
        decode(topic_of(sample), pack({**plain(sample), "extra": 1}))


SPEEDS = ("guidance_speed_mps", "commanded_speed_mps", "speed_mps")
"""Speeds that are told only where there is something to tell."""
MEASURED = ("transit_ns", "delay_ns", "slip_ns")
"""What only realtime measures: all three, or none."""


@each_sample
def test_each_field_is_required(sample: Message) -> None:
    fields = plain(sample)
    for name in fields.keys() - set(SPEEDS if sample.kind != "adsb" else SPEEDS[:2]):
        rest = {n: v for n, v in fields.items() if n != name}
        match = "columns differ" if name in MEASURED else name
        with pytest.raises(ValueError, match=match):
            decode(topic_of(sample), pack(rest))


def test_what_only_realtime_measures_can_be_left_out() -> None:
    sample = next(m for m in SAMPLES if m.kind == "delivery")
    rest = {n: v for n, v in plain(sample).items() if n not in MEASURED}
    none = msgspec.structs.replace(sample, **dict.fromkeys(MEASURED, ()))
    assert decode(topic_of(sample), pack(rest)) == none


@pytest.mark.parametrize("column", ["src", "kinds", "fates", "transit_ns", "delay_ns", "slip_ns"])
def test_columns_of_different_lengths_are_rejected(column: str) -> None:
    sample = next(m for m in SAMPLES if m.kind == "delivery")
    fields = plain(sample)
    with pytest.raises(ValueError, match="columns differ"):
        decode(topic_of(sample), pack({**fields, column: fields[column][:1]}))


@each_sample
def test_each_field_has_a_type(sample: Message) -> None:
    fields = plain(sample)
    for name in fields:
        with pytest.raises(ValueError, match=rf"\$\.{name}"):
            decode(topic_of(sample), pack({**fields, name: None}))


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        ("adsb", "id", -1),
        ("adsb", "id", 2**53),
        ("adsb", "t_ns", -1),
        ("adsb", "t_ns", 2**63),
        ("adsb", "speed_mps", 0.0),
        ("adsb", "position_ned_m", [0.0, 1.1e7, 0.0]),
        ("adsb", "position_ned_m", [0.0, 0.0]),
        ("adsb", "position_ned_m", [0.0, 0.0, 0.0, 0.0]),
        ("adsb", "manoeuvre", 65 * "x"),
        ("cmd", "heading_rad", 7.1),
        ("cmd", "climb_mps", -1001.0),
        ("election", "members", [*range(1, 4098)]),
        ("election", "members", [1, 2, 2]),
        ("election", "members", [2, 1]),
    ],
)
def test_values_out_of_bounds_are_rejected(kind: str, field: str, value: object) -> None:
    sample = next(m for m in SAMPLES if m.kind == kind)
    with pytest.raises(ValueError, match=field):
        decode(topic_of(sample), pack({**plain(sample), field: value}))


@pytest.mark.parametrize(
    ("named", "sent"),
    [pytest.param(a, b, id=f"{a.kind}-{b.kind}") for a, b in itertools.permutations(SAMPLES, 2)],
)
def test_a_message_of_another_class_than_the_topic_names_is_rejected(
    named: Message, sent: Message
) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(named), encode(sent))


@pytest.mark.parametrize("topic", ["", "/", "1", "1/", "1/nosuch", "sim/clock", "sim/digest"])
def test_a_topic_without_a_message_class_is_rejected(topic: str) -> None:
    with pytest.raises(ValueError, match="no message class"):
        decode(topic, encode(SAMPLES[0]))


@pytest.mark.parametrize("kind", ["adsb", "cmd", "ack", "truth", "decision", "delivery"])
def test_text_that_is_not_utf8_is_rejected(kind: str) -> None:
    sample = next(m for m in SAMPLES if m.kind == kind)
    payload = encode(sample)
    text = next(w for w in (b"turn", b"duplicate", b"plan", b"election") if w in payload)
    assert decode(topic_of(sample), payload) == sample
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(sample), payload.replace(text, b"\xff" + text[1:]))


@pytest.mark.parametrize(
    "payload", [b"", b"\xc0", b"\x80", b"\x90", b"\xc1", b"\xdf\xff\xff\xff\xff", pack([1, 2, 3])]
)
@each_sample
def test_what_is_not_a_map_of_fields_is_rejected(sample: Message, payload: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(sample), payload)


@given(
    message=st.sampled_from(SAMPLES),
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), min_size=1, max_size=4),
)
@settings(fast, max_examples=1500)
def test_a_corrupted_payload_is_a_valid_message_or_rejected(
    message: Message, flips: list[tuple[int, int]]
) -> None:
    payload = bytearray(encode(message))
    for place, mask in flips:
        payload[place % len(payload)] ^= mask
    try:
        got = decode(topic_of(message), bytes(payload))
    except ValueError:
        return
    assert type(got) is type(message)
    assert decode(topic_of(message), encode(got)) == got


@given(kind=st.sampled_from(SAMPLES), payload=st.binary(max_size=40))
@settings(fast, max_examples=300)
def test_random_bytes_are_rejected(kind: Message, payload: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode(topic_of(kind), payload)


@each_sample
def test_the_topic_names_the_class(sample: Message) -> None:
    assert kind_of(topic_of(sample)) == sample.kind
