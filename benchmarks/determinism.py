"""The digest of many runs of one scenario: with and without CPU load, other hash seeds, both buses.

    python -m benchmarks.determinism [SCENARIO] [--runs 10]

Exits with 1 if any digest differs.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys

BURN = "while True: pass"


def digest(scenario: str, bus: str, hash_seed: str) -> str:
    """The digest of one run, as a process of its own."""
    command = [sys.executable, "-m", "fleet", "run", scenario, "--bus", bus, "--json"]
    done = subprocess.run(
        [*command, "--out", os.devnull, "--force"],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
    )
    return str(json.loads(done.stdout)["digest"])


def main() -> None:
    """Run and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    digests = [digest(options.scenario, "memory", "0")]
    print(f"memory bus: {digests[0]}", flush=True)
    for n in range(options.runs):
        burners = 2 * (os.cpu_count() or 1) if n % 2 else 0
        burning = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(burners)]
        try:
            digests.append(digest(options.scenario, "zenoh", str(n)))
        finally:
            for process in burning:
                process.kill()
                process.wait()
        print(f"zenoh, {burners} burners, PYTHONHASHSEED={n}: {digests[-1]}", flush=True)
    print(f"{digests.count(digests[0])} of {len(digests)} digests are the same")
    sys.exit(len(set(digests)) > 1)


if __name__ == "__main__":
    main()
