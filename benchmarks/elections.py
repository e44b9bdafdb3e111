"""Elections under loss, and with a computing UAV that does not hear or is not heard.

    python -m benchmarks.elections [SCENARIO] [--seeds 8]

First: how many terms there were, how many commands were accepted and refused, and how near the
aircraft came, under heavy loss. Then: the same where some messages of or to UAV 1, which is to
compute, never arrive, and when the first command was accepted.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from msgspec import Struct

from fleet.analysis.invariants import RecordedRun, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.loading import read_scenario, with_faults
from fleet.model.units import to_s
from fleet.protocol import codec
from fleet.protocol.messages import Ack, Election
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder

Rules = list[dict[str, Any]]


def lossy(loss: float, latency_s: float = 0.0) -> Rules:
    """Latency and loss on all links."""
    return [{"kind": "latency", "base_s": latency_s}, {"kind": "loss", "probability": loss}]


def lost(src: str = "*", dst: str = "*", kinds: str = "*") -> Rules:
    """These never arrive."""
    return [{"kind": "loss", "probability": 1.0, "src": src, "dst": dst, "class": kinds}]


LOSSES: dict[str, Rules] = {
    "none": [],
    "30 %, 0.5 s": lossy(0.3, 0.5),
    "50 %": lossy(0.5),
    "80 %": lossy(0.8),
    "80 %, 0.5 s": lossy(0.8, 0.5),
}
LOST: dict[str, Rules] = {
    "nothing": [],
    "to UAV 1, all of the coordinator": lost("coordinator", "1"),
    "to UAV 1, elections": lost(dst="1", kinds="election"),
    "to UAV 1, all of other UAVs": lost("uav", "1"),
    "to UAV 1, everything": lost(dst="1"),
    "of UAV 1, commands": lost("1", kinds="cmd"),
    "to UAV 2, commands": lost(dst="2", kinds="cmd"),
    "to UAV 1, answers to commands": lost(dst="1", kinds="ack"),
    "all commands": lost(kinds="cmd"),
}


class Flight(Struct, frozen=True):
    """What came of one run."""

    terms: int
    by_uavs: int
    accepted: int
    refused: int
    first_s: float | None
    leaders: tuple[int, ...]
    least: float
    verdict: str


def fly(name: str, rules: Rules, seed: int, settings: Sequence[str]) -> Flight:
    """Fly it in memory."""
    scenario = with_faults(read_scenario(name, [*settings, f"seed={seed}"]).scenario, rules, name)
    records = RecordCollector()
    run_recorder = RunRecorder(scenario, records)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    kept = [r for r in records.kept if not r.topic.startswith("sim/")]
    messages = [codec.decode(r.topic, r.payload) for r in kept]
    elections = {m.term: m for m in messages if isinstance(m, Election)}
    acks = [m for m in messages if isinstance(m, Ack)]
    accepted = [m for m in acks if m.accepted]
    return Flight(
        len(elections),
        sum(m.id > 0 for m in elections.values()),
        len(accepted),
        len(acks) - len(accepted),
        to_s(accepted[0].t_ns) if accepted else None,
        tuple(sorted({m.target for m in accepted})),
        run_recorder.separation.least(),
        str(check(RecordedRun.of_records(scenario, records.kept)).overall),
    )


def _range(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):.1f} ({min(values):g}-{max(values):g})"


def main() -> None:
    """Fly all, and print a table of each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--set", dest="settings", action="append", default=[])
    options = parser.parse_args()
    name, settings = options.scenario, options.settings
    with ProcessPoolExecutor() as pool:
        print(f"{name}, {options.seeds} seeds\n")
        print("| loss | terms | by UAVs | accepted | refused | least separation | lost | check |")
        print("|---|---|---|---|---|---|---|---|")
        seeds = range(1, options.seeds + 1)
        for title, rules in LOSSES.items():
            jobs = [pool.submit(fly, name, rules, seed, settings) for seed in seeds]
            found = [job.result() for job in jobs]
            cells = [
                _range([f.terms for f in found]),
                _range([f.by_uavs for f in found]),
                _range([f.accepted for f in found]),
                _range([f.refused for f in found]),
                f"{min(f.least for f in found):.2f}",
                f"{sum(f.least < 1.0 for f in found)} of {len(found)}",
                ", ".join(sorted({f.verdict for f in found})),
            ]
            print(f"| {title} | " + " | ".join(cells) + " |", flush=True)
        print("\n| never arrives | terms | commanded by | from | least separation | check |")
        print("|---|---|---|---|---|---|")
        for title, rules in LOST.items():
            one = pool.submit(fly, name, rules, 1, settings).result()
            leaders = ", ".join(map(str, one.leaders)) or "nobody"
            first = "-" if one.first_s is None else f"{one.first_s:.1f} s"
            row = [str(one.terms), leaders, first, f"{one.least:.2f}", one.verdict]
            print(f"| {title} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
