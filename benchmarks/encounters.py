"""Losses of separation, arrival, delay and commands in sets of encounters (see `encounter_sets`).

    python -m benchmarks.encounters [--sets pairs late ...] [--seeds FIRST LAST] [--every N]
        [--links perfect faulty] [--set KEY=VALUE ...] [--jobs 2] [--json FILE] [--toml FOLDER]

Every encounter is flown on the in-memory bus with perfect links, with 0.5 s of latency and 30 %
loss, and by the plans alone, which is `resolver = "none"`. A run ends 20 s after the last arrival,
or at its duration. Prints a line for each set; on standard error, what is wrong in a run: a loss of
separation, a UAV that has not arrived at the end or more than 60 s late, or more than 20
commands to one. `--every` flies the first and then every N-th seed of each set. `--toml` writes
the encounters as scenarios for `fleet run`.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from benchmarks.encounter_sets import ARRIVAL_SHARE, SETS, scenario_of
from benchmarks.flown import Outcome, Separation, fly, undisturbed
from fleet.config.loading import convert, with_faults
from fleet.config.scenario import Scenario

LINKS: dict[str, list[dict[str, Any]]] = {
    "perfect": [],
    "faulty": [{"kind": "latency", "base_s": 0.5}, {"kind": "loss", "probability": 0.3}],
}
LATE_S = 60.0
MANY = 20
LINGER_S = 20.0


@dataclass(frozen=True)
class Job:
    """An encounter, the links it is flown with, and settings laid over it."""

    name: str
    seed: int
    links: str
    settings: tuple[str, ...] = ()

    def scenario(self) -> Scenario:
        """What is flown."""
        table = msgspec.to_builtins(scenario_of(self.name, self.seed))
        for setting in self.settings:
            _lay_over(table, tomllib.loads(setting))
        source = f"{self.name} {self.seed}"
        return with_faults(convert(table, source), LINKS[self.links], source)


@dataclass(frozen=True)
class Result:
    """An encounter as flown, and without anybody told anything."""

    job: Job
    flown: Outcome
    none: Separation

    def wrong(self) -> list[str]:
        """What is wrong with this run, in words."""
        found = [
            f"UAVs {m.a} and {m.b} lost separation: {m.least_separation:.3f} "
            f"({m.horizontal_m:.0f} m, {m.vertical_m:.0f} m) at {m.t_s:.1f} s"
            for m in self.flown.separation.lost
        ]
        found += [f"UAV {uav} has not arrived" for uav in self.flown.missing]
        rows = self.flown.arrivals.rows
        found += [f"UAV {r.id} {r.delay_s:.0f} s late" for r in rows if (r.delay_s or 0.0) > LATE_S]
        told = self.flown.commands.items()
        found += [f"UAV {u} given {n} commands" for u, n in told if n > MANY]
        return found


def one(job: Job) -> Result:
    """Fly one encounter."""
    scenario = job.scenario()
    until_s = 1.2 * ARRIVAL_SHARE * scenario.duration_s
    return Result(job, fly(scenario, LINGER_S), undisturbed(scenario, until_s))


def line(results: Sequence[Result]) -> str:
    """A row of the table, for the runs of a set with the same links."""
    job = results[0].job
    none = [r for r in results if r.none.lost]
    lost = [r for r in results if r.flown.separation.lost]
    delays = [d for r in results for d in r.flown.arrivals.delays_s]
    told = [sum(r.flown.commands.values()) for r in results]
    most = max(max(r.flown.commands.values(), default=0) for r in results)
    uavs = sum(len(r.flown.arrivals.rows) for r in results)
    cells = (
        job.name,
        job.links,
        len(results),
        f"{len(none)}, {min(r.none.least for r in results):.2f}",
        f"{len(lost)}, {min(r.flown.separation.least for r in results):.3f}",
        f"{uavs - sum(len(r.flown.missing) for r in results)} of {uavs}",
        f"{statistics.fmean(delays):.1f}, {max(delays):.0f} s" if delays else "-",
        f"{sum(told) / uavs:.1f}, {most}",
        sum(r.flown.unresolved for r in results),
    )
    return f"| {' | '.join(map(str, cells))} |"


HEAD = (
    "| set | links | runs | `none`: runs with loss, least | runs with loss, least "
    "| UAVs arrived | delay mean, most | commands a UAV mean, most | unresolved |\n"
    + "|---" * 9
    + "|"
)


def main() -> None:
    """Fly what is asked for and print the table."""
    options = _options()
    jobs = [
        Job(name, seed, links, tuple(options.settings))
        for name in options.sets
        for links in options.links
        for seed in _seeds(name, options)
    ]
    if options.toml:
        _write_scenarios(Path(options.toml), jobs)
        return
    print(HEAD, flush=True)
    results = list[Result]()
    with ProcessPoolExecutor(options.jobs) as pool:
        flown = map(_told, pool.map(one, jobs))
        for _, group in groupby(flown, key=lambda r: (r.job.name, r.job.links)):
            of_set = list(group)
            results += of_set
            print(line(of_set), flush=True)
    if options.json:
        rows = [{**asdict(r), "wrong": r.wrong()} for r in results]
        Path(options.json).write_text(json.dumps(rows), encoding="utf-8")


def _told(result: Result) -> Result:
    """The same, with what is wrong said at once, apart from the table."""
    for what in result.wrong():
        job = result.job
        print(f"{job.name} {job.seed}, {job.links}: {what}", file=sys.stderr, flush=True)
    return result


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", nargs="*", default=list(SETS), choices=list(SETS))
    parser.add_argument("--seeds", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.add_argument("--every", type=int, default=1, metavar="N")
    parser.add_argument("--links", nargs="*", default=list(LINKS), choices=list(LINKS))
    parser.add_argument("--set", dest="settings", action="append", default=[])
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json")
    parser.add_argument("--toml")
    return parser.parse_args()


def _seeds(name: str, options: argparse.Namespace) -> Iterable[int]:
    first, last = options.seeds or (1, SETS[name].count)
    return range(first, last + 1, options.every)


def _write_scenarios(folder: Path, jobs: Iterable[Job]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for job in jobs:
        table = msgspec.to_builtins(job.scenario())
        given = {k: v for k, v in table.items() if v is not None}
        path = folder / f"{job.name}-{job.seed}-{job.links}.toml"
        path.write_text(tomli_w.dumps(given), encoding="utf-8")


def _lay_over(table: dict[str, Any], setting: dict[str, Any]) -> None:
    for key, value in setting.items():
        if isinstance(value, dict):
            _lay_over(table[key], value)
        else:
            table[key] = value


if __name__ == "__main__":
    main()
