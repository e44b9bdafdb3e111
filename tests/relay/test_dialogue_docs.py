"""The dialogue of docs/protocol/foreign.md is that of the code."""

from __future__ import annotations

import re
from pathlib import Path

from fleet.protocol.messages import StateBroadcast
from fleet.relay.answers import (
    ANSWERED,
    ANSWERED_BY_COMPUTING,
    FILLED_IN,
    HEADER,
    MOST_ANSWERED,
    SHARED,
    STATE,
)
from fleet.relay.medium import LONGEST_ANSWER_BYTES, STOP_S
from fleet.relay.questions import (
    FirstQuestion,
    LastQuestion,
    PlanQuestion,
    StepQuestion,
    UavStart,
)

PAGE = Path(__file__).parents[2] / "docs" / "protocol" / "foreign.md"
TEXT = PAGE.read_text(encoding="utf-8")


def section(title: str) -> str:
    """What stands under a heading of the third level."""
    return TEXT.partition(f"### {title}\n")[2].partition("\n##")[0]


def first_cells(text: str) -> set[str]:
    """Words in the first columns of its tables."""
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    return {word for row in rows for word in re.findall(r"`(\w+)`", row)}


def test_every_field_of_a_question_is_told() -> None:
    asked = section("What it asks")
    fields = {*PlanQuestion.__struct_fields__, *StepQuestion.__struct_fields__}
    begins = {cls.__struct_fields__[0] for cls in (FirstQuestion, StepQuestion, LastQuestion)}
    assert first_cells(asked) == fields | begins
    (start,) = [line for line in asked.splitlines() if line.startswith("| `start`")]
    assert {*re.findall(r"`(\w+)`", start)} == {"start", *UavStart.__struct_fields__}


def test_every_class_of_an_answer_is_told_and_what_is_filled_in() -> None:
    answered = section("What it is answered")
    assert first_cells(answered) == {cls.kind for cls in (*ANSWERED, *ANSWERED_BY_COMPUTING)}
    (adsb,) = [line for line in answered.splitlines() if line.startswith("| `adsb`")]
    told = {*re.findall(r"`(\w+)`", adsb)}
    assert {*FILLED_IN[StateBroadcast]} - {*HEADER} <= told
    shared = {name.partition("_")[0] for name in {*SHARED} - {*STATE}}
    assert {f"{name}_..." for name in shared} <= {*re.findall(r"`([\w.]+)`", adsb)}


def test_the_limits_are_told() -> None:
    assert LONGEST_ANSWER_BYTES == 1 << 20
    assert "an answer of more than 1 MiB" in TEXT
    assert f"is of more than {MOST_ANSWERED} messages" in TEXT
    assert f"has not ended after {STOP_S:g} s is killed" in TEXT
