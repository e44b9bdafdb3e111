"""Logs of random encounters under random faults: each must repeat, and a changed byte be found.

    python -m benchmarks.repeat [--logs 30] [--seed 0] [--bus memory]

The cases are those of `fleet fuzz` with the same seeds, without those that have no faults. Every
log is repeated with `fleet repeat`; then one random bit of one random message is flipped, and the
comparison with the repetition must name that message and byte. Exits with 1 if anything fails.
"""

from __future__ import annotations

import argparse
import itertools
import json
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from fleet.analysis.recorded_run import RecordedRun
from fleet.config.loading import convert
from fleet.fuzz.cases import case_of
from fleet.log.reader import Record, Summary, read
from fleet.log.recorder import LogRecorder
from fleet.repetition.compare import compare_runs
from fleet.repetition.logged_ticks import ticks_of
from fleet.simulation.simulation import RunOptions, run_fleet


def repeated(log: Path, bus: str, out: Path) -> dict[str, object]:
    """What `fleet repeat` says."""
    command = [sys.executable, "-m", "fleet", "repeat", str(log), "--bus", bus, "--json"]
    done = subprocess.run(
        [*command, "--out", str(out)], capture_output=True, text=True, check=False
    )
    told: dict[str, object] = json.loads(done.stdout or "{}")
    return told | {"code": done.returncode, "error": done.stderr.strip()}


def with_a_flipped_bit(log: Path, path: Path, rng: random.Random) -> tuple[Record, int]:
    """Write a copy of a log in which one bit of one message is another; which message and byte."""
    summary = Summary(log)
    records = list(read(log, summary))
    chosen = rng.randrange(len(records))
    record = records[chosen]
    payload, byte = bytearray(record.payload), rng.randrange(len(record.payload))
    payload[byte] ^= 1 << rng.randrange(8)
    records[chosen] = replace(record, payload=bytes(payload))
    with LogRecorder(path, overwrite=True) as recorder:
        recorder.metadata("run", summary.metadata["run"])
        for r in records:
            recorder.write(r.topic, r.payload, r.seq, r.sent_ns, r.log_ns)
        recorder.metadata("result", summary.metadata["result"])
    return record, byte


def found(changed: Path, again: Path, record: Record, byte: int) -> bool:
    """Whether the comparison names the message and the byte, and nothing else."""
    comparison = compare_runs(RecordedRun.of_log(changed, lenient=True), ticks_of(read(again)))
    if comparison.altered is None or comparison.differs is not None:
        return False
    named = [(m.topic, m.seq, m.byte) for m in comparison.altered.messages]
    return named == [(record.topic, record.seq, byte)]


def main() -> None:
    """Fly, repeat, change and look."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--bus", choices=("memory", "zenoh"), default="memory")
    options = parser.parse_args()
    seeds = (s for s in itertools.count(options.seed) if case_of(s)["fault"])
    same = named = 0
    begun_s = time.monotonic()
    for seed in itertools.islice(seeds, options.logs):
        case = case_of(seed)
        with tempfile.TemporaryDirectory() as folder:
            log, again, changed = (Path(folder) / f"{n}.mcap" for n in ("log", "again", "changed"))
            outcome = run_fleet(
                RunOptions(convert(case, f"case {seed}"), bus="memory", out=log), lambda _: None
            )
            told = repeated(log, options.bus, again)
            equal = told.get("digest") == outcome.run_recorder.digest and told["code"] == 0
            record, byte = with_a_flipped_bit(log, changed, random.Random(seed))
            seen = again.exists() and found(changed, again, record, byte)
        same, named = same + equal, named + seen
        kinds = ", ".join(rule["kind"] for rule in case["fault"])
        where = f"byte {byte} of {record.topic} seq {record.seq}"
        print(
            f"seed {seed} ({kinds}): {'same digest' if equal else f'NOT THE SAME: {told}'}; "
            f"{where} {'named' if seen else 'NOT NAMED'}",
            flush=True,
        )
    print(
        f"{same} of {options.logs} logs repeat with the same digest over {options.bus}, "
        f"{named} of {options.logs} changed bytes named, {time.monotonic() - begun_s:.0f} s"
    )
    sys.exit(min(same, named) < options.logs)


if __name__ == "__main__":
    main()
