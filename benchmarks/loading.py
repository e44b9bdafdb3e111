"""Loading a log of a million messages into numpy columns, beside a plain loop over the MCAP reader.

    python -m benchmarks.loading [--messages 1000000] [--uavs 16] [--rounds 3]

The log has what a run has most of: true states and broadcasts, written by the recorder. The plain
loop takes each message from the MCAP library's reader and decodes it with the same checked decoder;
it makes no columns of them, which would take longer still. The two are run in turn, each in a
process of its own, so that a noisy machine is noisy for both and neither finds the other's memory.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing as mp
import random
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader

import fleet.log
from fleet.log.recorder import LogRecorder
from fleet.protocol.codec import decode, encode
from fleet.protocol.messages import Message, StateBroadcast, Truth
from fleet.protocol.topics import topic_of

TICK_NS = 100_000_000
MODES = ("plan", "plan", "plan", "command")


def state(rng: random.Random, uav: int, tick: int) -> tuple[Truth, StateBroadcast]:
    """A true state and a broadcast with plausible numbers of every width."""
    heading, climb = rng.uniform(-math.pi, math.pi), rng.uniform(-8.0, 8.0)
    position = (rng.uniform(-2e4, 2e4), rng.uniform(-2e4, 2e4), rng.uniform(-400.0, -100.0))
    velocity = (25.0 * math.cos(heading), 25.0 * math.sin(heading), -climb)
    t_ns, term, mode = tick * TICK_NS, tick // 50, rng.choice(MODES)
    truth = Truth(
        uav, tick, t_ns, position, velocity, 25.0, heading, 0.0, mode, tick // 900, heading, climb,
        heading, climb, -200.0, term, uav % 3, tick % 7,
    )  # fmt: skip
    adsb = StateBroadcast(
        uav, tick // 2, t_ns, t_ns, position, velocity, 25.0, heading, 0.0, position, position,
        False, heading, climb, 9.0, heading, 1.0, climb, "" if mode == "plan" else "turn", heading,
        climb, -200.0, term, uav % 3, tick % 7, term, term, mode != "plan", True, "full",
    )  # fmt: skip
    return truth, adsb


def write(path: Path, messages: int, uavs: int) -> None:
    """A log of so many messages of so many UAVs."""
    rng, written, tick = random.Random(1), 0, 0
    with LogRecorder(path, overwrite=False) as recorder:
        while written < messages:
            for uav in range(1, uavs + 1):
                truth, adsb = state(rng, uav, tick)
                said: tuple[Message, ...] = (truth,) if tick % 2 else (truth, adsb)
                for message in said[: messages - written]:
                    topic, t_ns = topic_of(message), message.t_ns
                    recorder.write(topic, encode(message), message.seq, t_ns, t_ns)
                    written += 1
            tick += 1


def columns(path: Path) -> int:
    """Load all columns; returns the number of messages."""
    return sum(len(columns) for columns in fleet.log.open(path).load().values())


def plain(path: Path) -> int:
    """Decode message by message; returns their number."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        return len([decode(c.topic, m.data) for _, c, m in reader.iter_messages()])


def timed(load: Callable[[Path], int], path: Path) -> tuple[int, float, float]:
    """Messages, seconds, and seconds of processor time."""
    begun, worked = time.perf_counter(), time.process_time()
    count = load(path)
    return count, time.perf_counter() - begun, time.process_time() - worked


def main() -> None:
    """Write the log, load it in both ways in turn and print times and ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=1_000_000)
    parser.add_argument("--uavs", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    times: list[list[float]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        write(path, options.messages, options.uavs)
        print(
            f"{options.messages:,} messages of {options.uavs} UAVs, {path.stat().st_size:,} bytes"
        )
        print(f"{'':6} {'wall time':^30} {'processor time':^30}")
        print("round " + 2 * f" {'plain loop':>11} {'columns':>9} {'ratio':>7} ")
        for n in range(options.rounds):
            both = []
            for load in (plain, columns):
                with mp.get_context("spawn").Pool(1) as pool:
                    count, *seconds = pool.apply(timed, (load, path))
                assert count == options.messages
                both.append(seconds)
            slow, fast = both
            times.append([x for k in range(2) for x in (slow[k], fast[k], slow[k] / fast[k])])
            print(f"{n + 1:>5} {line(times[-1])}", flush=True)
    print(f"median{line([statistics.median(column) for column in zip(*times, strict=True)])}")


def line(numbers: list[float]) -> str:
    """Times and ratios of a round."""
    return "".join(
        f" {slow:>9.2f} s {fast:>7.2f} s {ratio:>7.1f} "
        for slow, fast, ratio in (numbers[:3], numbers[3:])
    )


if __name__ == "__main__":
    main()
