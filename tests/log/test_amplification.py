"""Small logs take little memory, whatever is in them."""

from __future__ import annotations

import dataclasses
import resource
import subprocess
import sys
import zlib
from pathlib import Path

import msgspec
import pytest
import zstandard
from mcap.opcode import Opcode

from fleet.log.container import MAGIC, MAX_CHUNK_BYTES, RECORD
from fleet.log.reader import Record, read
from fleet.log.recorder import LogRecorder
from fleet.protocol.advisories import MOST_CANDIDATES, LoggedAdvisory, LoggedCandidate
from fleet.protocol.codec import decode, encode, kind_of
from fleet.protocol.messages import Decision
from tests.support.odd_logs import base_log, metadata_of

MOST_MIB = 400
"""What commands may take; they begin with about 150 MiB of libraries."""

READ_ALL = """
import sys
from fleet.cli import main
for command in sys.argv[1].split(";"):
    sys.argv = ["fleet", *command.split()]
    try:
        main()
    except SystemExit as ended:
        assert ended.code in (0, 1, 2, 3), command
    with open("/proc/self/status") as status:  # getrusage begins with what its parent had
        peak = next(line.split()[1] for line in status if line.startswith("VmHWM:"))
    print("PEAK", int(peak) >> 10, command)
"""


def peaks(folder: Path, *commands: str) -> dict[str, int]:
    """The most memory in MiB that commands took, one after the other in one process."""
    done = subprocess.run(
        [sys.executable, "-c", READ_ALL, ";".join(commands)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30)),
    )
    assert "Traceback" not in done.stderr
    told = [line.split(" ", 2) for line in done.stdout.splitlines() if line.startswith("PEAK ")]
    return {command: int(mib) for _, mib, command in told}


def elections(base: Path, path: Path, members: tuple[int, ...], count: int) -> None:
    """A log with many elections of many members."""
    records = list(read(base))
    first = next(r for r in records if kind_of(r.topic) == "election")
    said = decode(first.topic, first.payload)
    with LogRecorder(path, overwrite=False) as recorder:
        recorder.metadata("run", metadata_of(base)["run"])
        for n in range(count):
            named = (*members[:n], *members[n + 1 :])
            message = msgspec.structs.replace(said, id=1, seq=n, term=n, members=named)
            payload = encode(message)
            write(recorder, dataclasses.replace(first, topic="1/election", payload=payload, seq=n))
        for record in records:
            write(recorder, record)
        recorder.metadata("result", metadata_of(base)["result"])


def write(recorder: LogRecorder, r: Record) -> None:
    recorder.write(r.topic, r.payload, r.seq, r.sent_ns, r.log_ns)


def test_elections_of_thousands_take_little_memory(tmp_path: Path) -> None:
    base = base_log(tmp_path / "base.mcap")
    elections(base, tmp_path / "log.mcap", tuple(range(1, 4001)), 300)
    commands = (
        "check log.mcap",
        "metrics log.mcap",
        "report log.mcap",
        "export log.mcap --foxglove",
        "repeat log.mcap --loss 10%",
        "info log.mcap",
    )
    found = peaks(tmp_path, *commands)
    assert tuple(found) == commands
    assert max(found.values()) < MOST_MIB, found


def test_decisions_of_many_candidates_take_little_memory(tmp_path: Path) -> None:
    """The report draws some of the lines, and predicts no more than it draws."""
    base = base_log(tmp_path / "base.mcap")
    records = list(read(base))
    first = next(r for r in records if kind_of(r.topic) == "truth")
    turns = tuple(LoggedCandidate("turn", k * 1e-3, 0.0) for k in range(MOST_CANDIDATES))
    line = LoggedAdvisory(1, "", 0.0, 0.0, "", "turn", 0.5, 0.0, 2.0, 0.0, 0.0, candidates=turns)
    payload = encode(Decision(1, 0, first.sent_ns, 1, (line,) * 400))
    with LogRecorder(tmp_path / "log.mcap", overwrite=False) as recorder:
        recorder.metadata("run", metadata_of(base)["run"])
        for record in records:
            write(recorder, record)
        last = records[-1]
        decision = dataclasses.replace(last, topic="1/decision", payload=payload, seq=0)
        write(recorder, dataclasses.replace(decision, sent_ns=first.sent_ns))
        recorder.metadata("result", metadata_of(base)["result"])
    found = peaks(tmp_path, "report log.mcap", "metrics log.mcap")
    assert max(found.values()) < MOST_MIB, found


@pytest.mark.parametrize("told", [1 << 30, MAX_CHUNK_BYTES + 1])
def test_a_chunk_of_zeros_is_damage_and_no_memory(told: int, tmp_path: Path) -> None:
    base = base_log(tmp_path / "base.mcap").read_bytes()
    body = chunk(told)
    header = RECORD.size + RECORD.unpack_from(base, len(MAGIC))[1] + len(MAGIC)
    record = RECORD.pack(Opcode.CHUNK, len(body)) + body
    (tmp_path / "log.mcap").write_bytes(base[:header] + record + base[header:])
    found = peaks(tmp_path, "info log.mcap", "check log.mcap", "recover log.mcap")
    assert max(found.values()) < MOST_MIB, found


def chunk(size: int) -> bytes:
    """The body of a chunk of so many zeros."""
    crc, data = 0, b""
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    for begin in range(0, size, 1 << 20):
        block = bytes(min(1 << 20, size - begin))
        crc, data = zlib.crc32(block, crc), data + compressor.compress(block)
    data += compressor.flush()
    head = (0).to_bytes(8, "little") * 2 + size.to_bytes(8, "little") + crc.to_bytes(4, "little")
    return head + (4).to_bytes(4, "little") + b"zstd" + len(data).to_bytes(8, "little") + data
