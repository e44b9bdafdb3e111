"""One target under atheris, which follows the arcs of the project's code."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import atheris

NUMERIC = ["fleet.model.elementary", "fleet.model.vehicle"]
"""Arithmetic takes most of the time, and has hardly any arcs that an input decides on."""

with atheris.instrument_imports(include=["fleet"], exclude=NUMERIC):
    from tests.hostile import report
    from tests.hostile.target import Watched, watch
    from tests.hostile.targets import TARGETS

LONGEST = 1 << 16


def main(name: str, inputs: str, seed: str, path: str, folder: str) -> None:
    """Fuzz a target; what came of it is written with the last input, since libFuzzer then exits."""
    report.bound_memory()
    watched = Watched(TARGETS[name]())
    seeds = watched.target.seeds()
    for n, data in enumerate(seeds):
        (Path(folder) / f"{n:04}").write_bytes(data)
    last = int(inputs)

    def take(data: bytes) -> None:
        watched(data)
        if watched.inputs == last or watched.inputs % 100_000 == 0:
            report.write(Path(path), watched)

    def mutate(data: bytes, most: int, drawn: int) -> bytes:
        return watched.target.mutate(random.Random(drawn), data)[:most]

    options = [f"-runs={last}", f"-seed={seed}", f"-max_len={LONGEST}", "-timeout=300"]
    options += [
        f"-artifact_prefix={folder}/",
        "-mutate_depth=2",
        "-rss_limit_mb=0",
        "-reload=0",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options, folder], take, custom_mutator=mutate)
    watch()
    atheris.Fuzz()


if __name__ == "__main__":
    main(*sys.argv[1:])
