"""Hostile inputs by the million; prints a row of docs/bounds.md for each target.

    python -m tests.hostile --inputs 1000000 [--class adsb ...] [--seed 1] [--keep FOLDER]

With atheris (the extra `hostile`) the first of them follow coverage: those that reach new arcs of
the project's code are mutated further, by the rest too. What comes out of a target that may not is
told with its place, and its inputs are kept in FOLDER. Exits with 1 if there is any.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.hostile.targets import TARGETS

GUIDED = 100
"""One input in so many is made with atheris, which takes several times as long."""
_ARCS = re.compile(r"cov: (\d+) ft:")


def flown(name: str, inputs: int, seed: int, keep: Path) -> dict[str, Any]:
    """Fuzz one target in processes of its own; what came of it."""
    out: dict[str, Any] = {"inputs": 0, "accepted": 0, "peak_mib": 0, "arcs": 0, "findings": []}
    with tempfile.TemporaryDirectory() as folder:
        if importlib.util.find_spec("atheris"):
            _add(out, _phase("guided", name, max(1, inputs // GUIDED), seed, keep, folder))
        _add(out, _phase("unguided", name, inputs - out["inputs"], seed, keep, folder))
    return out


def _phase(
    module: str, name: str, inputs: int, seed: int, keep: Path, folder: str
) -> dict[str, Any]:
    """One process: its report, and how it ended if that was not well."""
    report = keep / f"{name}.{module}.json"
    report.unlink(missing_ok=True)
    words = [sys.executable, "-m", f"tests.hostile.{module}", name, str(inputs), str(seed)]
    words += [str(report), folder]
    own = {**os.environ, "TMPDIR": f"{folder}-files"}  # libFuzzer ends without cleaning up
    Path(own["TMPDIR"]).mkdir(exist_ok=True)
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=own)
    shutil.rmtree(own["TMPDIR"], ignore_errors=True)
    (keep / f"{name}.{module}.txt").write_text(done.stdout[-20000:] + done.stderr[-20000:])
    found: dict[str, Any] = {"inputs": 0, "accepted": 0, "peak_mib": 0, "findings": []}
    if report.exists():
        found = json.loads(report.read_text())
    if done.returncode:
        found["findings"].append({"what": done.stderr[-800:], "where": module, "count": 1})
    arcs = _ARCS.findall(done.stderr)
    return {**found, "arcs": int(arcs[-1]) if arcs else 0}


def _add(to: dict[str, Any], found: dict[str, Any]) -> None:
    for name in ("inputs", "accepted", "findings"):
        to[name] += found[name]
    for name in ("peak_mib", "arcs"):
        to[name] = max(to[name], found[name])


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
