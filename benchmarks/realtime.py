"""What zenoh takes in a realtime run, beside a bare put.

    python -m benchmarks.realtime [SCENARIO] [--rounds 3] [--duration 20]

In turn: the scenario in realtime over zenoh, whose delivery reports say for each message how long
it was on its way; and two processes at a router in a third, one of which puts a message of the size
of a broadcast to the other now and then, with the same marks of time. Prints median, 99th
percentile and most of each round, the steps that began late, and the processor time that others
took.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import os
import random
import subprocess
import sys
import time
from multiprocessing.connection import Connection

from benchmarks.accuracy import cpu_times
from fleet.simulation.supervisor import LEAN_RUNTIME
from fleet.transport.zenoh_bus import open_client_bus, open_router_bus

SIZE = 700
"""Bytes of a payload, about those of a broadcast."""
TOPIC = "1/adsb/0"
BETWEEN_S = (0.005, 0.035)


def sender(endpoint: str, count: int) -> None:
    """Put so many messages, one after the other."""
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    rng = random.Random(1)
    with open_client_bus("bare", "1", endpoint) as bus:
        bus.stamp("2/ready")
        bus.next_before(time.time_ns() + 10**10)
        for _ in range(count):
            time.sleep(rng.uniform(*BETWEEN_S))
            bus.put(TOPIC, bytes(SIZE))


def receiver(endpoint: str, count: int, out: Connection) -> None:
    """Take them and tell how long each was on its way, in ns."""
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    with open_client_bus("bare", "2", endpoint) as bus:
        bus.stamp(TOPIC)
        bus.put("2/ready", b"")
        taken: list[int] = []
        while len(taken) < count:
            arrival = bus.next_before(time.time_ns() + 10**10)
            if arrival is None:
                break
            taken.append(arrival.arrived_unix_ns - arrival.put_unix_ns)
        out.send(taken)


def bare(count: int) -> list[float]:
    """How long each of so many puts is on its way, in ms, in order of length."""
    context = mp.get_context("forkserver")
    here, there = context.Pipe(duplex=False)
    bus, endpoint = open_router_bus("bare", "sim", "tcp/127.0.0.1:0")
    with bus:
        one = context.Process(target=sender, args=(endpoint, count))
        other = context.Process(target=receiver, args=(endpoint, count, there))
        one.start()
        time.sleep(1.0)  # it must hear that the other one is ready
        other.start()
        taken: list[int] = here.recv()
        one.join()
        other.join()
    return sorted(1e-6 * t for t in taken)


def fleet(scenario: str, duration_s: float) -> dict[str, float]:
    """What zenoh took in a run, by quantile in ms, and the late steps."""
    command = [sys.executable, "-m", "fleet", "run", scenario, "--clock", "realtime", "--json"]
    command += ["--duration", str(duration_s), "--out", os.devnull, "--force"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(done.stdout)
    took = {name: 1e3 * value for name, value in result["zenoh_latency_s"].items()}
    return {**took, "late": result["late_steps"]["count"]}


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=20.0)
    options = parser.parse_args()
    print("| | p50, ms | p99, ms | most, ms | late steps | steal |\n|---|---|---|---|---|---|")
    for _ in range(options.rounds):
        stolen, total = cpu_times()
        took = fleet(options.scenario, options.duration)
        cells = [took["p50"], took["p99"], took["max"]]
        _row(options.scenario, cells, str(took["late"]), stolen, total)
        stolen, total = cpu_times()
        puts = bare(round(options.duration / (sum(BETWEEN_S) / 2.0)))
        cells = [puts[len(puts) // 2], puts[len(puts) * 99 // 100], puts[-1]]
        _row("bare put", cells, "-", stolen, total)


def _row(name: str, times_ms: list[float], late: str, stolen: int, total: int) -> None:
    now_stolen, now_total = cpu_times()
    steal = (now_stolen - stolen) / max(1, now_total - total)
    shown = " | ".join(f"{t:.2f}" for t in times_ms)
    print(f"| {name} | {shown} | {late} | {steal:.1%} |", flush=True)


if __name__ == "__main__":
    main()
