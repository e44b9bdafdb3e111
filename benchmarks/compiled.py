"""Whether compiling pays: runs of two UAVs, in turn by the sources and by all of them compiled.

    pip install cython setuptools
    python -m benchmarks.compiled [--rounds 5] [--folder FOLDER]

Cython compiles a copy of all modules that a run in memory goes through, without types and without
fused multiply-add, so that the arithmetic is the same; that takes about 20 minutes of processor
time, once for a FOLDER. What Cython cannot compile stays as it is. Each round flies the cells of
`studies/latency_loss.toml` by each, and tells the ratio of their processor times. Exits with 1 if
their digests are not the same.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
FLOWN_THROUGH = ["agents", "coordinator", "analysis", "faults", "model", "node", "protocol"]
FLOWN_THROUGH += ["simulation"]

UNTOLD = "faults/kinds/partition.py"
"""Has an annotation with an f-string, which Cython cannot tell to those who ask for it."""

BUILD = """
import sys
from Cython.Build import cythonize
from setuptools import Extension, setup
how, exact = {"annotation_typing": False, "binding": True}, ["-ffp-contract=off"]
made = []
for path in sys.argv[1:]:
    module = Extension(path[:-3].replace("/", "."), [path], extra_compile_args=exact)
    try:
        made += cythonize([module], language_level=3, quiet=True, compiler_directives=how)
    except Exception:
        print("cannot be compiled:", path)
print(len(made), "modules compiled")
setup(name="compiled", ext_modules=made, script_args=["-q", "build_ext", "--inplace", "-j2"])
"""

FLY = """
import json, sys, time
import msgspec
from fleet.agents import agent
from fleet.study.batches import Batch, BatchOrder, fly_batch
from fleet.study.design import cells_of
from fleet.study.loading import load_study
study = load_study(sys.argv[1])
cells = tuple(range(len(cells_of(study))))
order = BatchOrder(msgspec.json.encode(study), Batch(tuple((n, cells) for n in range(3))))
begun_s = time.process_time()
digests = [row.digest for row in fly_batch(order)]
print(json.dumps([time.process_time() - begun_s, digests, agent.__file__]))
"""


def copied(folder: Path) -> Path:
    """The package as it is installed, by itself in a folder."""
    shutil.copytree(ROOT / "fleet", folder / "fleet", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def compile_in(folder: Path) -> None:
    """Compile what a run goes through."""
    found = (p for name in FLOWN_THROUGH for p in (folder / "fleet" / name).rglob("*.py"))
    paths = [str(p.relative_to(folder)) for p in found if p.name != "__init__.py"]
    words = [path for path in sorted(paths) if not path.endswith(UNTOLD)]
    subprocess.run([sys.executable, "-c", BUILD, *words], cwd=folder, check=True)
    (folder / "done").touch()


def flown(folder: Path) -> tuple[float, list[str], str]:
    """Processor time of some runs by the package in a folder, their digests, and where it is."""
    study = str(ROOT / "studies" / "latency_loss.toml")
    told = subprocess.run(
        [sys.executable, "-c", FLY, study],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        check=True,
        capture_output=True,
        text=True,
    )
    time_s, digests, place = json.loads(told.stdout)
    return time_s, digests, place


def main() -> int:
    """Compile, fly in turn, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "compiled")
    options = parser.parse_args()
    sources, compiled = options.folder / "sources", options.folder / "compiled"
    if not (compiled / "done").exists():
        shutil.rmtree(options.folder, ignore_errors=True)
        copied(sources)
        compile_in(copied(compiled))
    ratios, all_same = [], True
    for n in range(options.rounds):
        (plain_s, plain, _), (fast_s, fast, place) = flown(sources), flown(compiled)
        if not place.endswith(".so"):
            raise SystemExit(f"not compiled: {place}")
        ratios.append(fast_s / plain_s)
        all_same = all_same and plain == fast
        same = "the same digests" if plain == fast else "OTHER DIGESTS"
        print(f"round {n + 1}: {plain_s:.1f} s, compiled {fast_s:.1f} s, {same}", flush=True)
    each = ", ".join(f"{ratio:.2f}" for ratio in sorted(ratios))
    print(f"compiled by sources: median {statistics.median(ratios):.2f} ({each})")
    return int(not all_same)


if __name__ == "__main__":
    sys.exit(main())
