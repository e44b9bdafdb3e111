"""One target without atheris: seeds are mutated again and again."""

from __future__ import annotations

import random
import sys
from pathlib import Path

from tests.hostile import report
from tests.hostile.target import Watched, watch
from tests.hostile.targets import TARGETS

DEPTH = 4
"""A seed is mutated so many times at most."""


def fuzz(watched: Watched, inputs: int, seed: int) -> None:
    """Take seeds and so many inputs made of them; the same with the same seed."""
    rng = random.Random(seed)
    seeds = watched.target.seeds()
    for data in seeds:
        watched(data)
    while watched.inputs < inputs:
        data = rng.choice(seeds)
        for _ in range(rng.randint(1, DEPTH)):
            data = watched.target.mutate(rng, data)
        watched(data)


def main(name: str, inputs: str, seed: str, path: str, _folder: str) -> None:
    """Fuzz a target and write what came of it."""
    report.bound_memory()
    watch()
    watched = Watched(TARGETS[name]())
    fuzz(watched, int(inputs), int(seed))
    report.write(Path(path), watched)


if __name__ == "__main__":
    main(*sys.argv[1:])
