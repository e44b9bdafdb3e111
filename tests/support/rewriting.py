"""Logs of runs in memory, and copies of them with something changed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from fleet.analysis.recorded_run import RecordedRun, whole_records
from fleet.config.scenario import Scenario
from fleet.log.reader import Record, Summary, read
from fleet.log.recorder import LogRecorder
from fleet.protocol.topics import DIGEST
from fleet.repetition.compare import Comparison, compare_runs
from fleet.repetition.logged_ticks import ticks_of
from fleet.simulation.simulation import RunOptions, RunOutcome, run_fleet

Change = Callable[[int, Record], Record | None]


def logged(path: Path, scenario: Scenario, **options: Any) -> RunOutcome:
    """Write the log of a run in memory."""
    return run_fleet(RunOptions(scenario, bus="memory", out=path, **options), lambda _: None)


def rewritten(
    log: Path,
    path: Path,
    change: Change = lambda _, record: record,
    added: Sequence[Record] = (),
    **metadata: dict[str, str] | None,
) -> Path:
    """A copy of a log with some messages changed, left out or added, and other metadata."""
    summary = Summary(log)
    records = list(read(log, summary))
    about = {**summary.metadata, **metadata}
    with LogRecorder(path, overwrite=True) as recorder:
        recorder.metadata("run", about["run"] or {})
        for n, record in enumerate(records):
            kept = change(n, record)
            if kept is not None:
                recorder.write(kept.topic, kept.payload, kept.seq, kept.sent_ns, kept.log_ns)
        for extra in added:
            recorder.write(extra.topic, extra.payload, extra.seq, extra.sent_ns, extra.log_ns)
        result = about["result"]
        if result is not None:
            recorder.metadata("result", result)
    return path


def naming_code(folder: Path, scenario: Scenario) -> Path:
    """The log `evil.mcap` of a run without a resolver, whose metadata name that of the scenario."""
    honest = folder / "honest.mcap"
    logged(honest, msgspec.structs.replace(scenario, resolver="none"))
    list(read(honest, summary := Summary(honest)))
    named = {"effective_scenario": msgspec.json.encode(scenario).decode()}
    return rewritten(honest, folder / "evil.mcap", run={**(summary.metadata["run"] or {}), **named})


def compared(log: Path, again: Path) -> Comparison:
    """A log compared with what stands for its repetition."""
    return compare_runs(RecordedRun.of_log(log, lenient=True), ticks_of(read(again)))


def flipped(payload: bytes, byte: int, bit: int) -> bytes:
    changed = bytearray(payload)
    changed[byte] ^= 1 << bit
    return bytes(changed)


def with_payload(record: Record, payload: bytes) -> Record:
    return dataclasses.replace(record, payload=payload)


def swap(one: Record, other: Record | None) -> Change:
    return lambda _, record: other if record == one else record


def whole_ticks(records: list[Record]) -> list[Record]:
    """What counts of a lockstep run that was cut."""
    last = max((n for n, r in enumerate(records) if r.topic == DIGEST), default=-1)
    return list(whole_records(records, last + 1))
