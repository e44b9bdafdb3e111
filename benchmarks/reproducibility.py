"""Random fault plans, flown several times on every bus under CPU load: the digests must agree.

    python -m benchmarks.reproducibility [--plans 20] [--seed 0] [--times 3]

The plans and encounters are those of `fleet fuzz` with the same seeds. Each is flown over zenoh
through the simulation's own router, over zenoh through an outside router, and on the in-memory bus.
Exits with 1 if any digest differs.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tomli_w

from fleet.fuzz.cases import case_of
from fleet.transport.zenoh_session import open_router

BURN = "while True: pass"


@contextmanager
def burning(count: int) -> Iterator[None]:
    """Keep the machine busy."""
    burners = [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(count)]
    try:
        yield
    finally:
        for process in burners:
            process.kill()
            process.wait()


def digest(scenario: Path, *options: str) -> str:
    """The digest of one run, as a process of its own."""
    command = [sys.executable, "-m", "fleet", "run", str(scenario), "--json", *options]
    done = subprocess.run(
        [*command, "--out", os.devnull, "--force"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        return f"failed: {done.stderr.strip().splitlines()[-1]}"
    return str(json.loads(done.stdout)["digest"])


def main() -> None:
    """Fly and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--times", type=int, default=3)
    options = parser.parse_args()
    router, endpoint = open_router("tcp/127.0.0.1:0")
    buses = {"router": (), "outside": ("--connect", endpoint), "memory": ("--bus", "memory")}
    same = 0
    seeds = [
        s for s in range(options.seed, options.seed + 10 * options.plans) if case_of(s)["fault"]
    ]
    with tempfile.TemporaryDirectory() as folder, burning(os.cpu_count() or 1):
        for seed in seeds[: options.plans]:
            path = Path(folder) / f"{seed}.toml"
            path.write_text(tomli_w.dumps(case_of(seed)), encoding="utf-8")
            found = [
                (name, digest(path, *extra))
                for _ in range(options.times)
                for name, extra in buses.items()
            ]
            kinds = ", ".join(rule["kind"] for rule in case_of(seed)["fault"])
            equal = len({d for _, d in found}) == 1 and not found[0][1].startswith("failed")
            same += equal
            verdict = f"{len(found)} equal" if equal else f"DIFFERENT: {found}"
            print(f"seed {seed} ({kinds}): {found[0][1]} {verdict}", flush=True)
    router.close()
    print(f"{same} of {options.plans} plans gave one digest in {3 * options.times} runs each")
    sys.exit(same < options.plans)


if __name__ == "__main__":
    main()
