"""A log that was changed after it was written: what `fleet repeat` finds in it."""

from __future__ import annotations

import dataclasses
import random
from pathlib import Path

import pytest

from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.faults.plan import plan_json
from fleet.log.reader import Record, Summary, read
from fleet.protocol.topics import CLOCK, DIGEST
from tests.support.mutants import meeting
from tests.support.rewriting import compared, flipped, logged, rewritten, swap, with_payload


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log with an election, commands and losses; the scenario announces no change."""
    path = tmp_path_factory.mktemp("logs") / "good.mcap"
    logged(path, meeting(Loss(probability=0.2), duration_s=4.0))
    return path


def test_any_changed_byte_is_found_and_named(good: Path, tmp_path: Path) -> None:
    rng = random.Random(4)
    records = list(read(good))
    classes = {r.topic.split("/")[1] for r in records}
    assert classes >= {"adsb", "heartbeat", "election", "cmd", "ack", "truth", "delivery", "done"}
    chosen = [rng.choice([r for r in records if r.topic.split("/")[1] == c]) for c in classes]
    for record in [*sorted(chosen, key=lambda r: r.topic), *rng.sample(records, 20)]:
        byte, bit = rng.randrange(len(record.payload)), rng.randrange(8)
        other = with_payload(record, flipped(record.payload, byte, bit))
        log = rewritten(good, tmp_path / "x.mcap", swap(record, other))
        found = compared(log, good)
        assert found.verdict == "altered", record
        assert found.differs is None
        assert found.altered is not None
        (message,) = found.altered.messages
        assert (message.topic, message.seq) == (record.topic, record.seq)
        assert message.byte == byte
        assert message.fields
        assert found.altered.t_ns == record.log_ns


@pytest.mark.parametrize("name", ["seq", "sent_ns", "log_ns"])
@pytest.mark.parametrize("topic", ["2/adsb/0", CLOCK, DIGEST])
def test_a_changed_record_round_a_message_is_found(
    good: Path, tmp_path: Path, topic: str, name: str
) -> None:
    record = [r for r in read(good) if r.topic == topic][7]
    other = dataclasses.replace(record, **{name: getattr(record, name) + 50_000})
    found = compared(rewritten(good, tmp_path / "x.mcap", swap(record, other)), good)
    assert found.verdict == "altered"
    assert found.altered is not None
    assert topic in {m.topic for m in found.altered.messages}
    assert found.altered.tick in (7, 14)


def test_a_message_that_is_missing_doubled_or_added_is_found(good: Path, tmp_path: Path) -> None:
    record = [r for r in read(good) if r.topic == "2/truth"][20]
    found = compared(rewritten(good, tmp_path / "x.mcap", swap(record, None)), good).altered
    assert found is not None
    assert (found.tick, found.messages[0].what) == (20, "is only in the repetition")
    later = dataclasses.replace(record, log_ns=4_000_000_000)
    found = compared(rewritten(good, tmp_path / "x.mcap", added=[later]), good).altered
    assert found is not None
    assert found.why == "there is more after the last tick"


def test_a_missing_tick_is_found(good: Path, tmp_path: Path) -> None:
    def without(_: int, record: Record) -> Record | None:
        return None if record.log_ns == 1_500_000_000 else record

    found = compared(rewritten(good, tmp_path / "x.mcap", without), good).altered
    assert found is not None
    assert (found.tick, found.why) == (15, "tick 15 is missing, or its digest")


def test_another_digest_or_plan_stated_at_the_end_is_found(good: Path, tmp_path: Path) -> None:
    summary = Summary(good)
    for _ in read(good, summary):
        pass
    result = summary.metadata["result"]
    log = rewritten(good, tmp_path / "x.mcap", result={**result, "digest": "00"})
    found = compared(log, good).altered
    assert found is not None
    assert found.why == "the digest stated at the end is another, 00"
    plan = plan_json([Loss(probability=0.3)])
    log = rewritten(good, tmp_path / "x.mcap", result={**result, "fault_plan": plan})
    found = compared(log, good).altered
    assert found is not None
    assert "fault plan" in found.why


def test_both_are_told_where_a_log_was_changed_and_the_run_goes_another_way(
    good: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.mcap"
    logged(other, meeting(Loss(probability=0.2), Kill(node="3", start_s=2.0), duration_s=4.0))
    record = [r for r in read(good) if r.topic == "1/truth"][30]
    payload = flipped(record.payload, -1, 0)
    log = rewritten(
        good, tmp_path / "x.mcap", swap(record, dataclasses.replace(record, payload=payload))
    )
    found = compared(log, other)
    assert found.altered is not None
    assert found.differs is not None
    assert (found.altered.tick, found.differs.tick) == (30, 20)
