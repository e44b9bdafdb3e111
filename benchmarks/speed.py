"""Lockstep speed beside a bare zenoh barrier: same processes, messages and payload sizes.

    python -m benchmarks.speed [SCENARIO] [--set generate.count=64] [--rounds 5] [--ticks 2000]

The barrier has no model, no codec and no log: processes receive a grant and the broadcasts of the
tick before, publish blocks of bytes as long as the real messages, and say that they are done. The
two are run in turn, so that a noisy machine is noisy for both. All hear all: no radio range.
"""

from __future__ import annotations

import argparse
import multiprocessing as mp
import os
import statistics
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from fleet.config.loading import read_scenario
from fleet.config.traffic import uavs_of
from fleet.log.reader import read
from fleet.protocol.topics import EVERYTHING
from fleet.simulation.simulation import RunOptions, run_fleet
from fleet.simulation.supervisor import LEAN_RUNTIME
from fleet.transport.zenoh_bus import open_client_bus, open_router_bus

Schedule = dict[str, list[tuple[str, int]]]
"""For each process: the topics and sizes that it publishes in an even and an odd tick, in order."""

CLOCK, STOP = "sim/clock", b"stop"


def schedule_of(log: Path) -> tuple[dict[str, Schedule], int]:
    """By process and tick parity, the regular messages of a log; and the mean size of a grant."""
    sizes: dict[tuple[str, int], list[int]] = defaultdict(list)
    ticks, grants = 0, list[int]()
    for record in read(log):
        if record.topic == "sim/digest":
            ticks += 1
        elif record.topic == CLOCK:
            grants.append(len(record.payload))
        else:
            parity = (record.log_ns // 100_000_000) % 2
            sizes[record.topic, parity].append(len(record.payload))
    out: dict[str, Schedule] = {}
    for (topic, parity), lengths in sorted(sizes.items()):
        if len(lengths) > 0.4 * ticks / 2:
            mean = round(statistics.mean(lengths))
            schedule = out.setdefault(topic.partition("/")[0], {"0": [], "1": []})
            schedule[str(parity)].append((topic, mean))
    for schedule in out.values():
        for sent in schedule.values():
            sent.sort(key=lambda s: s[0].endswith("done"))
    return out, round(statistics.mean(grants))


def participant(endpoint: str, name: str, schedule: Schedule, heard: list[int]) -> None:
    """A process of the bare barrier; `heard` counts the broadcasts of others by parity."""
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    with open_client_bus("bare", name, endpoint) as bus:
        bus.listen(CLOCK)
        bus.listen("*/adsb/0", own=False)
        bus.put(f"{name}/done", b"ready")
        tick = 0
        while bus.take(CLOCK).payload != STOP:
            for _ in range(heard[(tick - 1) % 2] if tick else 0):
                bus.take("*/adsb/0")
            for topic, size in schedule[str(tick % 2)]:
                bus.put(topic, bytes(size))
            tick += 1


def bare(schedules: dict[str, Schedule], clock: int, ticks: int) -> float:
    """Seconds a tick of the bare barrier."""
    context = mp.get_context("forkserver")
    context.set_forkserver_preload(["zenoh", "numpy", "msgspec"])
    bus, endpoint = open_router_bus("bare", "sim", "tcp/127.0.0.1:0")
    with bus:
        bus.listen(EVERYTHING, own=False)
        counts = [
            {n: sum("adsb" in t for t, _ in s[str(p)]) for n, s in schedules.items()}
            for p in range(2)
        ]
        processes = []
        for name, schedule in schedules.items():
            heard = [sum(c.values()) - c[name] for c in counts]
            process = context.Process(target=participant, args=(endpoint, name, schedule, heard))
            process.start()
            processes.append(process)
        for _ in processes:
            bus.take(EVERYTHING)
        begun = time.perf_counter()
        for tick in range(ticks):
            bus.put(CLOCK, bytes(clock))
            for _ in range(sum(len(s[str(tick % 2)]) for s in schedules.values())):
                bus.take(EVERYTHING)
        taken = time.perf_counter() - begun
        bus.put(CLOCK, STOP)
        for process in processes:
            process.join()
    return taken / ticks


def main() -> None:
    """Run both in turn and print the medians and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the scenario")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ticks", type=int, default=2000)
    options = parser.parse_args()
    scenario = read_scenario(options.scenario, options.set).scenario
    if scenario.radio().limited:
        parser.error("the barrier has no radio range; leave surveillance.range_m out")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        fulls, bares = [], []
        for n in range(options.rounds):
            outcome = run_fleet(RunOptions(scenario, out=log, force=True), lambda _: None)
            fulls.append(outcome.wall_s / outcome.ticks)
            schedules, clock = schedule_of(log)
            bares.append(bare(schedules, clock, options.ticks))
            print(
                f"round {n + 1}: full {1e3 * fulls[-1]:.2f} ms a tick, "
                f"bare {1e3 * bares[-1]:.2f} ms a tick, ratio {fulls[-1] / bares[-1]:.2f}",
                flush=True,
            )
    full, barrier = statistics.median(fulls), statistics.median(bares)
    ratio = statistics.median(f / b for f, b in zip(fulls, bares, strict=True))
    print(
        f"{scenario.name}, {len(uavs_of(scenario))} UAVs: full {1e3 * full:.2f} ms a tick "
        f"({scenario.tick_s / full:.0f} times real time), bare barrier {1e3 * barrier:.2f} ms, "
        f"median ratio {ratio:.2f}"
    )


if __name__ == "__main__":
    main()
