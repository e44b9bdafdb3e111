"""Hostile inputs by the million; prints a row of docs/bounds.md for each target.

    python -m tests.hostile --inputs 1000000 [--class adsb ...] [--seed 1] [--keep FOLDER]

With atheris (`pip install atheris`) inputs that reach new arcs of the project's code are mutated
further; without it the seeds alone are. What comes out of a target that may not is told with its
place, and its inputs are kept in FOLDER. Exits with 1 if there is any.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.hostile.targets import TARGETS

MEMORY_MIB = 1024
"""No process of a campaign may take more."""
_ARCS = re.compile(r"cov: (\d+) ft: (\d+)")


def flown(name: str, inputs: int, seed: int, keep: Path) -> dict[str, Any]:
    """Fuzz one target in a process of its own; what came of it."""
    guided = importlib.util.find_spec("atheris") is not None
    module = "tests.hostile.guided" if guided else "tests.hostile.unguided"
    report = keep / f"{name}.json"
    report.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", module, name, str(inputs), str(seed), str(report), folder]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    (keep / f"{name}.txt").write_text(done.stdout[-20000:] + done.stderr[-20000:])
    found: dict[str, Any] = {"inputs": 0, "accepted": 0, "peak_mib": 0, "findings": []}
    if report.exists():
        found = json.loads(report.read_text())
    if done.returncode:
        found["findings"].append({"what": done.stderr[-800:], "where": "process", "count": 1})
    arcs = _ARCS.findall(done.stderr)
    found["arcs"] = int(arcs[-1][0]) if arcs else 0
    return found


def main() -> int:
    """Fuzz, print, and say whether all is well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=10_000)
    parser.add_argument("--class", nargs="+", dest="names", default=list(TARGETS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "hostile")
    options = parser.parse_args()
    options.keep.mkdir(parents=True, exist_ok=True)
    print("| target | inputs | taken | arcs | uncaught | most memory |\n|---|---|---|---|---|---|")
    bad = 0
    for name in options.names:
        found = flown(name, options.inputs, options.seed, options.keep)
        uncaught = sum(f["count"] for f in found["findings"])
        share = f"{found['accepted'] / max(1, found['inputs']):.0%}"
        row = f"{name} | {found['inputs']:,} | {share} | {found['arcs']:,} | {uncaught}"
        print(f"| {row} | {found['peak_mib']} MiB |", flush=True)
        for finding in found["findings"]:
            print(f"{finding['where']} ({finding['count']}):\n{finding['what']}", file=sys.stderr)
        bad += uncaught
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
