"""Attacks on an open bus, and what became of the run: a table of docs/protocol.

    python -m tests.rogue

Each attack is a real zenoh client beside a real run, once for each clock. `python -m tests.rogue`
prints the tables, the last one under `--secure` (`tests/rogue_secured.py`); `tests/test_rogue.py`
holds that no attack passes in silence.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import zenoh

from fleet.protocol.codec import encode
from fleet.protocol.messages import Clock, Done, Message, PersistentState, Truth
from fleet.transport.zenoh_session import open_client
from tests.support.samples import SAMPLES, ack, adsb, command, election, heartbeat

Session = Any
T = TypeVar("T")
CLOCKS = ("lockstep", "realtime")
NS = 10**9
DEEP = b'{"rules": [], "x": ' + b"[" * 2000 + b"]" * 2000 + b"}"


@dataclass(frozen=True)
class Attack:
    """What is put on the bus: topic, and a payload, a deletion (None) or what to do instead."""

    topic: str
    payload: bytes | None = b""
    mark: bytes | None = None
    words: str = ""
    harmless: bool = False
    """Nobody uses it: the run goes on, and its result is that of a run without it."""
    faults: tuple[str, ...] = ()
    """Options of the run."""
    tick: int = 1
    """It is made when UAV 2 has come so far."""


def _of(message: Message, topic: str = "") -> tuple[str, bytes]:
    name = "coordinator" if message.id == 0 else str(message.id)
    return topic or f"{name}/{message.suffix}", encode(message)


def _truth(seq: int, t_ns: int = 0) -> Message:
    """A true state of UAV 1."""
    (sample,) = [m for m in SAMPLES if isinstance(m, Truth)]
    return msgspec.structs.replace(sample, id=1, seq=seq, t_ns=t_ns)


def _by_the_absent(message: Message, *faults: str, tick: int = 10) -> Attack:
    """Said in the name of a process that a fault has ended or stopped, at its usual time."""
    topic, payload = _of(message)
    return Attack(topic, payload, words=topic, faults=faults, tick=tick)


AHEAD = 10**6
"""A number that no genuine message has yet."""
TICK_NS = 100_000_000
DEAD = ("--kill", "1@0.5s")
GHOST = adsb(99, (0.0, 0.0, -300.0), seq=AHEAD)

ATTACKS: dict[str, Attack] = {
    "a ghost's broadcast": Attack(*_of(GHOST), harmless=True, words="stranger"),
    "a stranger's deletion": Attack("99/adsb/0", None, harmless=True, words="stranger"),
    "a stranger's garbage": Attack("99/adsb/0", b"\x91" * 3000, harmless=True, words="stranger"),
    "a coordinator's heartbeat, by wildcard": Attack(
        "*/heartbeat", encode(heartbeat(0, AHEAD)), harmless=True, words="several topics"
    ),
    "a broadcast on a wildcard key": Attack(
        "*/adsb/0", encode(adsb(1, seq=AHEAD)), harmless=True, words="several topics"
    ),
    "a deletion of a UAV's topic": Attack("1/adsb/0", None, harmless=True, words="deletion"),
    "a forged command": Attack(*_of(command(seq=AHEAD, t_ns=0)), words="1/cmd/2"),
    "a forged broadcast": Attack(*_of(adsb(1, seq=AHEAD)), words="1/adsb/0"),
    "a broadcast with an old number": Attack(*_of(adsb(1, seq=0)), words="1/adsb/0"),
    "a forged election": Attack(*_of(election(3, (1, 2), 1, 0)), words="coordinator/election"),
    "a forged heartbeat": Attack(*_of(heartbeat(0, AHEAD)), words="coordinator/heartbeat"),
    "a heartbeat of a UAV": Attack(
        "1/heartbeat",
        encode(msgspec.structs.replace(heartbeat(0, AHEAD), id=1)),
        words="1/heartbeat",
    ),
    "a forged acknowledgement": Attack(*_of(ack(command(), seq=AHEAD)), words="2/ack/1"),
    "a forged true state": Attack(*_of(_truth(AHEAD)), words="1/truth"),
    "a forged persistent state": Attack(
        *_of(PersistentState(1, AHEAD, 0, 0, 0, 0, 0)), words="1/persistent_state"
    ),
    "a forged report of a step": Attack(*_of(Done(1, 0, 0, -1, {}, {})), words="1/done"),
    "a broadcast with a NaN": Attack(
        "1/adsb/0", encode(adsb(1, (float("nan"), 0.0, -300.0), seq=AHEAD)), words="1/adsb/0"
    ),
    "5 kB as a UAV": Attack("1/adsb/0", b"\x90" * 5000, words="1/adsb/0"),
    "a nested payload": Attack("1/adsb/0", b"\x91" * 3000, words="1/adsb/0"),
    "64 MiB as a UAV": Attack("1/adsb/0", bytes(64 << 20), harmless=True),
    "garbage as a UAV": Attack("1/adsb/0", b"\xc1garbage", words="1/adsb/0"),
    "another UAV's broadcast": Attack("2/adsb/0", encode(adsb(1)), words="2/adsb/0"),
    "a broadcast from the far future": Attack(
        *_of(adsb(1, t_ns=2**63 - 1, seq=AHEAD)), words="1/adsb/0"
    ),
    "a time of publication before 1970": Attack(
        *_of(adsb(1, seq=AHEAD)), mark=struct.pack("<q", -(2**63)), words="1/adsb/0"
    ),
    "a place that is no number": Attack(
        *_of(adsb(1, seq=AHEAD)), mark=struct.pack("<q3d", 0, *3 * [float("nan")]), words="1/adsb/0"
    ),
    "a term of 2^52": Attack(*_of(heartbeat(0, AHEAD, 2**52)), words="coordinator/heartbeat"),
    "garbage as the clock": Attack("sim/clock", b"garbage", words="sim/clock"),
    "a deletion of the clock": Attack("sim/clock", None, words="sim/clock"),
    "a forged grant": Attack(
        "sim/clock", encode(Clock(AHEAD, 100_000_000 * AHEAD, "run", {})), words="sim/clock"
    ),
    "a forged end": Attack("sim/clock", encode(Clock(1, 0, "stop", {})), words="sim/clock"),
    "a forged abort": Attack("sim/abort", b"process 2 is a bad one", words="sim/abort"),
    "a forged digest": Attack("sim/digest", b"\x80", words="sim/digest"),
    "a dead UAV's true state": _by_the_absent(_truth(9, 9 * TICK_NS), *DEAD),
    "a dead UAV's command": _by_the_absent(command(seq=0, t_ns=9 * TICK_NS), *DEAD),
    "a dead UAV's broadcast": _by_the_absent(adsb(1, t_ns=8 * TICK_NS, seq=3), *DEAD),
    "a dead UAV's persistent state": _by_the_absent(
        PersistentState(1, 0, 9 * TICK_NS, 0, 0, 0, 0), *DEAD
    ),
    "a dead UAV's last report": _by_the_absent(Done(1, 20, 20 * TICK_NS, 20, {}, {}), *DEAD),
    "a command that a dead UAV did not count": _by_the_absent(command(seq=AHEAD, t_ns=0), *DEAD),
    "a dead coordinator's election": _by_the_absent(
        msgspec.structs.replace(election(3, (1, 2), 1, 2 * NS, 9 * TICK_NS), seq=0),
        "--kill",
        "coordinator@0.5s",
    ),
    "a broadcast before its UAV is started again": _by_the_absent(
        adsb(1, t_ns=8 * TICK_NS, seq=3), "--kill", "1@0.5s+1.2s"
    ),
    "a broadcast numbered as of an earlier incarnation": _by_the_absent(
        adsb(1, t_ns=14 * TICK_NS, seq=3), "--kill", "1@0.5s+0.2s", tick=15
    ),
    "a stopped UAV's broadcast": _by_the_absent(
        adsb(1, t_ns=8 * TICK_NS, seq=3), "--pause", "1@0.5s+1.2s"
    ),
}


@dataclass(frozen=True)
class Told:
    """How a run ended that was attacked."""

    code: int
    result: dict[str, Any]
    error: str
    check: dict[str, Any]

    @property
    def named(self) -> str:
        """What the result says of it: topics and reasons."""
        return ", ".join(f"{r['topic']} ({r['why']})" for r in self.result["rejected"])


def attacked(attack: Attack, clock: str, folder: Path) -> Told:
    """Fly `head_on` for some seconds and attack it when it is on."""
    log = folder / "run.mcap"
    paced = ("--speed", "1") if clock == "lockstep" else ()
    command = ("run", "head_on", "--clock", clock, "--duration", "2", *attack.faults, *paced)
    run = subprocess.Popen(
        [sys.executable, "-m", "fleet", *command, "--json", "--force", "--out", str(log)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
    )
    try:
        _strike(attack, run, folder)
        out, error = run.communicate(timeout=60)
    finally:
        run.kill()
        run.wait()
    checked = fleet("check", str(log), "--json")
    return Told(run.returncode, json.loads(out), error, json.loads(checked.stdout))


def fleet(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command of `fleet` to its end."""
    command = [sys.executable, "-m", "fleet", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)


def _strike(attack: Attack, run: subprocess.Popen[str], folder: Path) -> None:
    """Put it on the bus of a run once that has come to its tick."""
    name, endpoint = until(lambda: listed_run(folder), run)
    session = open_client(endpoint, 10.0)
    try:
        assert _has_come_to(session, name, attack.tick)
        key = f"fleet/{name}/{attack.topic}"
        wait = zenoh.CongestionControl.BLOCK
        if attack.payload is None:
            session.delete(key, congestion_control=wait)
        else:
            session.put(key, attack.payload, attachment=attack.mark, congestion_control=wait)
    finally:
        session.close()


def listed_run(folder: Path) -> tuple[str, str] | None:
    """Name and endpoint of the run that is listed in a folder."""
    for path in folder.glob("fleet-*/*.json"):
        text = path.read_text(encoding="utf-8")
        if text:
            return path.stem, json.loads(text)["endpoint"]
    return None


def _has_come_to(session: Session, run: str, tick: int) -> bool:
    """Whether UAV 2 has sent a true state with that number or a higher one."""
    heard = threading.Event()

    def note(sample: Any) -> None:
        payload = sample.payload.to_bytes()
        if payload and msgspec.msgpack.decode(payload)["seq"] >= tick:
            heard.set()

    watch = session.declare_subscriber(f"fleet/{run}/2/truth", note)
    try:
        return heard.wait(30.0)
    finally:
        watch.undeclare()


def until(ask: Callable[[], T | None], run: subprocess.Popen[str]) -> T:
    """The first answer that is one; the run must not end before."""
    deadline_s, pause = time.monotonic() + 60.0, threading.Event()
    while (answer := ask()) is None:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < deadline_s
        pause.wait(0.01)
    return answer


def silent(attack: Attack, told: Told) -> str:
    """What is wrong with how a run took an attack; empty if nothing is."""
    if "Traceback" in told.error:
        return "a traceback"
    if attack.words not in told.named:
        return f"not named: {told.named or told.error}"
    if attack.harmless:
        return "" if told.code == 0 else f"the run ended: {told.error}"
    if told.code != 1 or told.result["status"] != "invalid" or attack.words not in told.error:
        return f"exit code {told.code}, {told.result['status']}: {told.error}"
    return "" if told.check["verdict"] == "invalid" else f"the log is {told.check['verdict']}"


def main() -> None:
    """Print both tables."""
    from tests.rogue_processes import ROGUES, tried
    from tests.rogue_secured import print_secured

    head = " | ".join(CLOCKS) + " |\n|---|---|---|"
    print(f"| attack | {head}")
    bad = 0
    for name, attack in ATTACKS.items():
        cells = []
        for clock in CLOCKS:
            with tempfile.TemporaryDirectory() as folder:
                told = attacked(attack, clock, Path(folder))
            wrong = silent(attack, told)
            bad += bool(wrong)
            how = "refused" if attack.harmless else "run invalid"
            cells.append(f"SILENT: {wrong}" if wrong else f"{how}: {told.named}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print(f"\n| rogue | {head}")
    for name, rogue in ROGUES.items():
        cells = []
        for clock in CLOCKS:
            with tempfile.TemporaryDirectory() as folder:
                cells.append(tried(rogue, clock, Path(folder)))
        bad += sum(cell.startswith("SILENT") for cell in cells)
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    bad += print_secured()
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
