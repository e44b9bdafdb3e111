"""Lockstep speed beside a bare zenoh barrier: same processes, messages and payload sizes.

    python -m benchmarks.speed [SCENARIO] [--set generate.count=64] [--rounds 5] [--ticks 2000]

The barrier has no model, no codec and no log: processes receive a grant and the broadcasts of the
tick before, publish blocks of bytes as long as the real messages, and say that they are done. The
two are run in turn, so that a noisy machine is noisy for both. With a radio range each listens to
the cells that it begins in reach of, so that deliveries are the same; that is meant for short runs.
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
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.log.reader import read
from fleet.protocol.cells import names_in
from fleet.protocol.topics import EVERYTHING
from fleet.simulation.simulation import RunOptions, run_fleet
from fleet.simulation.supervisor import LEAN_RUNTIME
from fleet.transport.zenoh_bus import open_client_bus, open_router_bus

Schedule = dict[str, list[tuple[str, int]]]
"""For each process: the topics and sizes that it publishes in an even and an odd tick, in order."""

Heard = list[dict[str, int]]
"""How many broadcasts come on each topic, in an even and an odd tick."""

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


def heard_by(scenario: Scenario, schedules: dict[str, Schedule]) -> dict[str, list[str]]:
    """The broadcast topics of others that each process listens to."""
    out, cells = {name: ["*/adsb/*"] for name in schedules}, scenario.cells()
    if cells:
        for uav in uavs_of(scenario):
            inner = names_in(cells.block(uav.position_ned_m))
            out[str(uav.id)] = [f"*/adsb/{cell}" for cell in inner]
    return out


def participant(
    endpoint: str, name: str, schedule: Schedule, topics: list[str], heard: list[dict[str, int]]
) -> None:
    """A process of the bare barrier; `heard` counts the broadcasts of others by parity."""
    os.environ.setdefault("ZENOH_RUNTIME", LEAN_RUNTIME)
    with open_client_bus("bare", name, endpoint) as bus:
        bus.listen(CLOCK)
        for topic in topics:
            bus.listen(topic, own=False)
        bus.put(f"{name}/done", b"ready")
        tick = 0
        while bus.take(CLOCK).payload != STOP:
            for topic, count in heard[(tick - 1) % 2].items() if tick else ():
                for _ in range(count):
                    bus.take(topic)
            for topic, size in schedule[str(tick % 2)]:
                bus.put(topic, bytes(size))
            tick += 1


def heard_counts(name: str, topics: list[str], schedules: dict[str, Schedule]) -> Heard:
    """How many broadcasts of others come on each topic that a process listens to, by parity."""
    out: Heard = [dict.fromkeys(topics, 0) for _ in range(2)]
    for other, schedule in schedules.items():
        for parity, counts in enumerate(out):
            told = [t.partition("/")[2] for t, _ in schedule[str(parity)] if "/adsb/" in t]
            for suffix in told if other != name else ():
                for heard in {f"*/{suffix}", "*/adsb/*"} & counts.keys():
                    counts[heard] += 1
    return out


def bare(
    schedules: dict[str, Schedule], topics: dict[str, list[str]], clock: int, ticks: int
) -> float:
    """Seconds a tick of the bare barrier."""
    context = mp.get_context("forkserver")
    context.set_forkserver_preload(["zenoh", "numpy", "msgspec"])
    bus, endpoint = open_router_bus("bare", "sim", "tcp/127.0.0.1:0")
    with bus:
        bus.listen(EVERYTHING, own=False)
        processes = []
        for name, schedule in schedules.items():
            heard = heard_counts(name, topics[name], schedules)
            arguments = (endpoint, name, schedule, topics[name], heard)
            process = context.Process(target=participant, args=arguments)
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
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        fulls, bares = [], []
        for n in range(options.rounds):
            outcome = run_fleet(RunOptions(scenario, out=log, force=True), lambda _: None)
            fulls.append(outcome.wall_s / outcome.ticks)
            schedules, clock = schedule_of(log)
            bares.append(bare(schedules, heard_by(scenario, schedules), clock, options.ticks))
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
