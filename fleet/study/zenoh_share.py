"""Runs of a study that are flown again, with a process for each UAV over zenoh: digests agree."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import msgspec
from msgspec import Struct

from fleet.errors import FailedError, FleetStoppedError, StudyError
from fleet.model.words import BusKind
from fleet.simulation.simulation import RunOptions, run_fleet
from fleet.study.loading import base_scenario
from fleet.study.results import ResultsFolder, write_whole
from fleet.study.scenario_of_run import scenario_of_run

ZENOH = "zenoh.json"


class FlownAgain(Struct, frozen=True):
    """A run in memory and over zenoh: the digests, which should be the same."""

    cell: int
    run: int
    in_memory: str
    over_zenoh: str

    @property
    def agrees(self) -> bool:
        """Whether it came to the same, message by message."""
        return self.in_memory == self.over_zenoh


def flown_again(folder: Path) -> list[FlownAgain]:
    """What has been flown again of a study; raises StudyError if that cannot be read."""
    path = folder / ZENOH
    if not path.exists():
        return []
    try:
        return msgspec.json.decode(path.read_bytes(), type=list[FlownAgain])
    except (OSError, msgspec.MsgspecError) as error:
        raise StudyError(f"{path}: cannot be read: {error}; delete it") from error


def chosen_again(results: ResultsFolder) -> list[tuple[int, int, str]]:
    """Cell, number and digest of the runs that are to be flown again: a share by chance.

    The choice is a function of the seed of the study, so that it does not depend on what was known.
    """
    table = results.table(["digest"])
    columns = (table[name].to_pylist() for name in ("cell", "run", "digest"))
    share = results.study.zenoh_share
    return [
        (cell, run, digest)
        for cell, run, digest in zip(*columns, strict=True)
        if digest and _chance(results.study.seed, cell, run) < share
    ]


def fly_again(
    results: ResultsFolder, progress: Callable[[int, int], None] = lambda _done, _total: None
) -> list[FlownAgain]:
    """Fly the chosen runs again over zenoh, but for those that have been, one after the other.

    `progress` is called with how many of how many are done.

    Raises:
        StudyError: another command flies it.
        FleetStoppedError: a run over zenoh became invalid. FailedError: results cannot be written.
        KeyboardInterrupt: it was interrupted; what was flown again is kept.

    """
    with results.alone():
        return _fly_again(results, progress)


def _fly_again(results: ResultsFolder, progress: Callable[[int, int], None]) -> list[FlownAgain]:
    study = results.study
    base, found = base_scenario(study), flown_again(results.folder)
    known, chosen = {(again.cell, again.run) for again in found}, chosen_again(results)
    for done, (cell, run, digest) in enumerate(chosen):
        progress(done, len(chosen))
        if (cell, run) in known:
            continue
        scenario = scenario_of_run(study, base, results.cells[cell], run)
        outcome = run_fleet(RunOptions(scenario, bus=BusKind.ZENOH), lambda _: None)
        if outcome.status == "interrupted":
            raise KeyboardInterrupt(outcome.why)
        if outcome.status != "complete":
            raise FleetStoppedError(f"run {run} of cell {cell} over zenoh: {outcome.why}")
        found.append(FlownAgain(cell, run, digest, outcome.run_recorder.digest))
        try:
            write_whole(results.folder / ZENOH, msgspec.json.encode(found))
        except OSError as error:
            raise FailedError(f"{results.folder / ZENOH}: {error.strerror}; make room") from error
    progress(len(chosen), len(chosen))
    return found


def _chance(seed: int, cell: int, run: int) -> float:
    """Uniform in [0, 1)."""
    word = hashlib.blake2b(f"zenoh {seed} {cell} {run}".encode(), digest_size=8).digest()
    return int.from_bytes(word, "little") / 2.0**64
