"""Files that anybody may hand over as targets: scenarios, studies, hosts, encounters of others."""

from __future__ import annotations

import contextlib
import random
import shutil
import tempfile
import tomllib
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomli_w

from fleet.cli.hosts import HostsFormat, made_of
from fleet.config.idle_rules import idle_rules
from fleet.config.loading import load_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.errors import FleetError
from fleet.hosts.hosts_file import load_hosts
from fleet.imports.importing import import_traffic
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.study.design import cells_of
from fleet.study.loading import base_scenario, load_study
from fleet.study.scenario_of_run import scenario_of_run
from tests.hostile import corpus
from tests.hostile.mutation import (
    MOST_BYTES,
    changed_text,
    mutated_bytes,
    mutated_tree,
    pick,
)

FLOWN_UAVS, FLOWN_TICKS = 6, 3
"""What can be used is flown for so many ticks, if it has no more UAVs."""
WORDS = (
    "0", "-0", "1e308", "-1e-308", "nan", "inf", "-inf", "1e999", "999999999999999999999", "", " ",
    "\"", ",", ";", "#", ">", ":", "52.0N", "S33.5", "00:00:00.00>", "FL100", "360", "-181", "91",
    "\t", "\u00e9", "\u0661", "1_000", "0x10", "[deg]", "[ft]", "[none]", "CRE", "MOVE", "DEST",
)  # fmt: skip


class FileTarget:
    """One kind of file, read from a disk by its suffix."""

    limit_s = 20.0

    def __init__(self, name: str, suffix: str, read: Callable[[Path], bool]) -> None:
        self.name, self._read = name, read
        self.accepted, self.together = 0, 1
        folder = tempfile.mkdtemp(prefix="hostile-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self._path = Path(folder) / f"given{suffix}"
        self._is_toml = suffix == ".toml"

    def seeds(self) -> list[bytes]:
        """Good ones."""
        return corpus.stored(self.name)

    def mutate(self, rng: random.Random, data: bytes) -> bytes:
        """Another one."""
        turn = rng.random()
        if turn < 0.1:
            return mutated_bytes(rng, data)[:MOST_BYTES]
        if self._is_toml and turn < 0.85:
            with contextlib.suppress(ValueError, TypeError, RecursionError, AttributeError):
                return _mutated_toml(rng, data)
        text = data.decode("utf-8", "replace")
        changed = changed_text(rng, text) if turn < 0.25 else _other_word(rng, text)
        return changed.encode("utf-8", "replace")[:MOST_BYTES]

    def __call__(self, data: bytes) -> None:
        """Read it, and use what it says."""
        self._path.write_bytes(data)
        with contextlib.suppress(FleetError):
            self.accepted += self._read(self._path)


def _mutated_toml(rng: random.Random, data: bytes) -> bytes:
    tree: Any = tomllib.loads(data.decode("utf-8"))
    for _ in range(1 + int(rng.random() * 2)):
        tree = mutated_tree(rng, tree)
    return tomli_w.dumps(tree).encode("utf-8", "replace")[:MOST_BYTES]


def _other_word(rng: random.Random, text: str) -> str:
    """Another word in a line, another line, or words in another order."""
    lines = text.split("\n")
    place = int(rng.random() * len(lines))
    line = lines[place]
    mark = pick(rng, (",", " ", ";", ">", ":"))
    words = line.split(mark)
    turn = rng.random()
    if turn < 0.6:
        words[int(rng.random() * len(words))] = pick(rng, WORDS)
        lines[place] = mark.join(words)
    elif turn < 0.7:
        rng.shuffle(words)
        lines[place] = mark.join(words)
    elif turn < 0.8:
        lines.insert(place, lines[int(rng.random() * len(lines))])
    elif turn < 0.9:
        del lines[place]
    else:
        lines[place] = line * int(2 + rng.random() * 20)
    return "\n".join(lines)


def read_scenario_file(path: Path) -> bool:
    """As `fleet run` does, and its first ticks."""
    return _used(load_scenario(path))


def _used(scenario: Scenario) -> bool:
    uavs = uavs_of(scenario)
    if len(uavs) > FLOWN_UAVS or scenario.resolver not in ("geometric", "none"):
        return True
    idle_rules(scenario)
    run = run_in_memory(scenario, RunRecorder(scenario, None))
    for _ in zip(run, range(FLOWN_TICKS), strict=False):
        pass
    return True


def read_study_file(path: Path) -> bool:
    """As `fleet study run` does, up to the scenario of a run of its first cell."""
    study = load_study(path)
    base = base_scenario(study)
    return _used(scenario_of_run(study, base, cells_of(study)[0], 0))


def read_hosts_file(path: Path) -> bool:
    """As `fleet hosts` does, for all that can start a role."""
    deployment = load_hosts(str(path))
    return all(made_of(kind, deployment) for kind in HostsFormat)


def read_import(path: Path) -> bool:
    """As `fleet import` does, and the scenario that it makes."""
    made = import_traffic(path)
    made.lines()
    return _used(made.scenario)


FILES: dict[str, Callable[[], FileTarget]] = {
    "scenario": lambda: FileTarget("scenario", ".toml", read_scenario_file),
    "study": lambda: FileTarget("study", ".toml", read_study_file),
    "hosts": lambda: FileTarget("hosts", ".toml", read_hosts_file),
    "bluesky": lambda: FileTarget("bluesky", ".scn", read_import),
    "daidalus": lambda: FileTarget("daidalus", ".daa", read_import),
    "csv": lambda: FileTarget("csv", ".csv", read_import),
}
