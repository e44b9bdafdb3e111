"""One target at full speed: seeds, and what was found with atheris, are mutated on."""

from __future__ import annotations

import random
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.hostile import report
from tests.hostile.target import Watched, watch
from tests.hostile.targets import TARGETS

TOGETHER = 4
"""So many messages may come in a tick."""
DEPTH = 2
"""A seed is mutated so many times at most."""


def fuzz(watched: Watched, inputs: int, seed: int, found: Sequence[bytes] = ()) -> None:
    """Take seeds, what else was found, and so many inputs made of them; each seed makes its own."""
    rng = random.Random(seed)
    seeds = [*watched.target.seeds(), *found]
    for data in seeds:
        watched(data)
    while watched.inputs < inputs:
        data = rng.choice(seeds)
        for _ in range(rng.randint(1, DEPTH)):
            data = watched.target.mutate(rng, data)
        watched(data)


def main(name: str, inputs: str, seed: str, path: str, folder: str) -> None:
    """Fuzz a target, from what is in a folder too, and write what came of it."""
    report.bound_memory()
    watch()
    watched = Watched(TARGETS[name]())
    watched.target.together = TOGETHER
    found = [file.read_bytes() for file in sorted(Path(folder).iterdir())]
    fuzz(watched, int(inputs), int(seed), found)
    report.write(Path(path), watched)


if __name__ == "__main__":
    main(*sys.argv[1:])
