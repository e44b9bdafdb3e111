"""How well `fleet replay` keeps its times, by its own account and by that of a subscriber.

    python -m benchmarks.replay [SCENARIO ...] [--duration 20] [--rates 1 10]

Writes a log of each scenario (0 s: to its end), replays it through a router to a subscriber in
another process, and compares what came with the log, message for message. A message's time at the
subscriber is its arrival after the first one, less its log time after the first one over the rate.
Exits with 1 if anything differs, or if at rate 1 the 99th percentile of the player's error is 5 ms
or more.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from fleet.analysis.tally import quantiles
from fleet.config.loading import packaged, read_scenario
from fleet.log.reader import read
from fleet.protocol.sample import Sample
from fleet.simulation.simulation import RunOptions, run_fleet
from fleet.transport.zenoh_bus import open_client_bus
from fleet.transport.zenoh_session import open_router

LIMIT_S = 0.005


def heard(endpoint: str, run: str, ready: threading.Event, until: threading.Event) -> list[Sample]:
    """What comes until the event, with times of arrival."""
    found: list[Sample] = []
    with open_client_bus(run, "ear", endpoint) as bus:
        bus.stamp("**")
        with open_client_bus(run, "probe", endpoint) as probe:
            while (arrival := bus.next_before(time.time_ns() + 20_000_000)) is None:
                probe.put("probe/first", b"")  # until the router knows the subscription
            probe.put("probe/last", b"")
            while arrival is None or arrival.topic != "probe/last":
                arrival = bus.next_before(time.time_ns() + 100_000_000)
        ready.set()
        quiet = 0
        while not (until.is_set() and quiet > 5):
            arrival = bus.next_before(time.time_ns() + 100_000_000)
            quiet = 0 if arrival else quiet + 1
            if arrival:
                found.append(arrival)
    return found


def listener(endpoint: str, run: str, out: Path) -> None:
    """The subscriber's process: listens until its standard input ends."""
    ready, until = threading.Event(), threading.Event()

    def wait() -> None:
        ready.wait()
        print("ready", flush=True)
        sys.stdin.read()
        until.set()

    threading.Thread(target=wait, daemon=True).start()
    rows = [
        (a.topic, a.payload.hex(), a.arrived_unix_ns) for a in heard(endpoint, run, ready, until)
    ]
    out.write_text(json.dumps(rows), encoding="utf-8")


def replayed(log: Path, run: str, rate: float, out: Path) -> tuple[dict[str, float], int]:
    """Replay to a subscriber: the player's error, and how many messages it sent."""
    router, endpoint = open_router("tcp/127.0.0.1:0")
    listener = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.replay", "--listen", endpoint, run, str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert listener.stdin is not None
    assert listener.stdout is not None
    try:
        listener.stdout.readline()
        command = ["replay", str(log), "-r", f"{rate:g}", "--connect", endpoint, "--json"]
        done = subprocess.run(
            [sys.executable, "-m", "fleet", *command], capture_output=True, text=True, check=True
        )
        listener.stdin.close()
        listener.wait(timeout=60)
    finally:
        listener.kill()
        listener.wait()
        router.close()
    told = json.loads(done.stdout)
    return told["timing_error_s"], told["messages"]


def bare(log: Path, rate: float) -> dict[str, float]:
    """How late this process wakes up if it only sleeps until the log times: the machine's share."""
    late: list[float] = []
    begun_s, first_ns = time.monotonic(), next(read(log)).log_ns
    for log_ns in sorted({r.log_ns for r in read(log)}):
        due_s = begun_s + (log_ns - first_ns) / 1e9 / rate
        time.sleep(max(0.0, due_s - time.monotonic()))
        late.append(time.monotonic() - due_s)
    return quantiles(late)


def words(errors_s: dict[str, float]) -> str:
    """Quantiles in ms."""
    return ", ".join(f"{name} {1e3 * value:.2f}" for name, value in errors_s.items())


def main() -> None:
    """Replay and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=packaged())
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--rates", type=float, nargs="*", default=[1.0, 10.0])
    parser.add_argument("--listen", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listen:
        listener(options.listen[0], options.listen[1], Path(options.listen[2]))
        return
    good = True
    for name in options.scenarios:
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.mcap"
            cut = [f"duration_s={options.duration}"] if options.duration else []
            scenario = read_scenario(name, cut).scenario
            flown = RunOptions(scenario, bus="memory", out=log)
            run_fleet(flown, lambda _: None)
            records = list(read(log))
            asleep_s = bare(log, options.rates[0])
            print(f"{name}: merely sleeping is late by, ms: {words(asleep_s)}", flush=True)
            for rate in options.rates:
                out = Path(folder) / f"{rate:g}.json"
                errors_s, sent = replayed(log, flown.run, rate, out)
                rows = json.loads(out.read_text(encoding="utf-8"))
                same = [(t, p) for t, p, _ in rows] == [(r.topic, r.payload.hex()) for r in records]
                at_ear = [
                    abs((a[2] - rows[0][2]) / 1e9 - (r.log_ns - records[0].log_ns) / 1e9 / rate)
                    for a, r in zip(rows, records, strict=False)
                ]
                good &= same and (rate != 1.0 or errors_s["p99"] < LIMIT_S)
                print(
                    f"{name} rate {rate:g}: {sent} messages {'identical' if same else 'DIFFERENT'}"
                    f"; error, ms: {words(errors_s)}; at the subscriber: "
                    f"{words(quantiles(at_ear))}",
                    flush=True,
                )
    sys.exit(not good)


if __name__ == "__main__":
    main()
