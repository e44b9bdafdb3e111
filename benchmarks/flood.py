"""What a flood does to a fleet in realtime: latency of messages, memory, and how the run ends.

    python -m benchmarks.flood [--scenario converge] [--duration 25] [--rounds 3] [--open]

Each round flies the scenario undisturbed, and once for each flooder: a client that puts messages as
fast as it can for 10 s. With certificates it is an observer, or a participant in the name of others
and of nobody, or in its own; with `--open` anybody on an open bus, in the same names. Told are what
messages took over zenoh in that time (commands take the same way), the greatest memory of a
participant and of the simulation, and what became of the run. The flooder would have a host of its
own, and so yields to all others (nice 19). Other options are for `fleet run`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import zenoh

from fleet.log.reader import read
from fleet.model.types import Array
from fleet.protocol.codec import decode, encode
from fleet.protocol.messages import DeliveryReport
from fleet.security.identity import Identity
from fleet.transport.zenoh_session import SessionOptions, open_client
from tests.rogue import AHEAD, listed_run, until
from tests.support.samples import adsb

FLOOD_S = 10.0
BEGIN_S = 8.0
"""The flood begins so long after the run."""
FORGED = ("1/adsb/0", "1/cmd/2", "99/adsb/0", "nobody/knows/this")
STRANGE = ("99/adsb/0", "98/truth", "nobody/knows/this")
OWN = ("3/adsb/0", "3/cmd/1")
FLOODERS: dict[str, tuple[str, Sequence[str]]] = {
    "nobody": ("", ()),
    "an observer": ("observer", FORGED),
    "UAV 3 in others' names": ("uav-3", FORGED),
    "UAV 3 in its own name": ("uav-3", OWN),
    "UAV 3 as strangers": ("uav-3", STRANGE),
}
"""By which certificate, and on which topics."""


@dataclass(frozen=True)
class Flooded:
    """What a flood made of a run."""

    sent: int
    status: str
    why: str
    verdict: str
    simulation_mb: float
    participant_mb: float
    took_ms: Array

    def line(self) -> str:
        """In words."""
        p50, p99 = np.percentile(self.took_ms, [50, 99]) if self.took_ms.size else (0.0, 0.0)
        memory = f"simulation {self.simulation_mb:.0f} MB, a participant {self.participant_mb:.0f}"
        how = f"{self.status} {self.why}".strip()
        return (
            f"{self.sent} sent; {self.took_ms.size} messages took p50 {p50:.2f} ms, p99 {p99:.2f}; "
            f"{memory}; {how}, check {self.verdict}"
        )


def flood(run: str, endpoint: str, identity: Identity | None, topics: Sequence[str]) -> int:
    """How many messages were put."""
    payload, sent = encode(adsb(3, seq=AHEAD)), 0
    wait = zenoh.CongestionControl.BLOCK
    session = open_client(endpoint, 10.0, SessionOptions(identity))
    with suppress(zenoh.ZError):  # the run has ended over it
        end_s = time.monotonic() + FLOOD_S
        keys = [f"fleet/{run}/{topic}" for topic in topics]
        while time.monotonic() < end_s:
            for key in keys:
                session.put(key, payload, congestion_control=wait)
            sent += len(keys)
    with suppress(zenoh.ZError):
        session.close()
    return sent


def yielding() -> ProcessPoolExecutor:
    """A process that takes the processor when nobody else wants it."""
    return ProcessPoolExecutor(1, get_context("spawn"), initializer=os.nice, initargs=(19,))


@contextmanager
def greatest_mb(pid: int) -> Iterator[dict[int, float]]:
    """The greatest memory of a process and its descendants, by process, in MB (Linux)."""
    found: dict[int, float] = {}
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(0.2):
            with suppress(OSError):
                for process in (pid, *descendants(pid)):
                    text = Path(f"/proc/{process}/status").read_text(encoding="ascii")
                    rows = dict(row.split(":", 1) for row in text.splitlines())
                    if "VmRSS" in rows:
                        mb = int(rows["VmRSS"].split()[0]) / 1024
                        found[process] = max(mb, found.get(process, 0.0))

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield found
    finally:
        ended.set()
        thread.join()


def descendants(pid: int) -> list[int]:
    """All below a process."""
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    below = [int(child) for child in listed]
    return [*below, *(grand for child in below for grand in descendants(child))]


def flown(words: Sequence[str], flooder: str, *, secured: bool) -> Flooded:
    """One run in realtime, and what a flood made of it."""
    certificate, topics = FLOODERS[flooder]
    with tempfile.TemporaryDirectory() as name:
        folder, log = Path(name), Path(name) / "run.mcap"
        certs = folder / "certs"
        if secured:
            fleet("certs", str(certs), "--uavs", "1-16")
        closed = ("--secure", str(certs)) if secured else ()
        run = subprocess.Popen(
            [sys.executable, "-m", "fleet", "run", *words, *closed, "--json", "--out", str(log)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env={**os.environ, "XDG_RUNTIME_DIR": name},
        )
        told, endpoint = until(lambda: listed_run(folder), run)
        sent = 0
        with greatest_mb(run.pid) as memory:
            if certificate:
                time.sleep(BEGIN_S)
                identity = Identity(certs, certificate) if secured else None
                with yielding() as flooding:
                    sent = flooding.submit(flood, told, endpoint, identity, topics).result()
            result = json.loads(run.communicate()[0])
        others = [mb for pid, mb in memory.items() if pid != run.pid]
        verdict = json.loads(fleet("check", str(log), "--json"))["verdict"]
        return Flooded(
            sent,
            result["status"],
            result["why"],
            verdict,
            memory[run.pid],
            max(others),
            np.array(transits_ns(log)) / 1e6,
        )


def fleet(*words: str) -> str:
    """What a command prints."""
    command = [sys.executable, "-m", "fleet", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def transits_ns(log: Path) -> list[int]:
    """What messages took that were sent while the flood was on."""
    reports = (decode(r.topic, r.payload) for r in read(log) if r.topic.endswith("/delivery"))
    rows = (
        row
        for report in reports
        if isinstance(report, DeliveryReport)
        for row in zip(report.sent_ns, report.transit_ns, strict=True)
    )
    begin_s = BEGIN_S + 1.0
    return [took for sent, took in rows if took and begin_s < sent / 1e9 < BEGIN_S + FLOOD_S]


def main() -> None:
    """Fly in turn."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenario", default="converge")
    parser.add_argument("--duration", default="25")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--open", action="store_true")
    given, settings = parser.parse_known_args()
    words = (given.scenario, "--clock", "realtime", "--duration", given.duration, *settings)
    pooled: dict[str, list[Array]] = defaultdict(list)
    for _ in range(given.rounds):
        for flooder in FLOODERS:
            told = flown(words, flooder, secured=not given.open)
            pooled[flooder].append(told.took_ms)
            print(f"{flooder}: {told.line()}", flush=True)
    print("all rounds together:")
    for flooder, parts in pooled.items():
        took = np.concatenate(parts)
        if took.size:
            p50, p99 = np.percentile(took, [50, 99])
            least = min(np.percentile(part, 99) for part in parts if part.size)
            print(f"  {flooder}: p50 {p50:.2f} ms, p99 {p99:.2f} ms, of the best round {least:.2f}")


if __name__ == "__main__":
    main()
