"""Realtime accuracy of injected delays: actual minus intended, with the machine's steal time.

    python -m benchmarks.accuracy [--duration 20] [--delays 10ms 50ms 200ms]

Flies `head_on` in realtime over zenoh once for every delay.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path


def cpu_times() -> tuple[int, int]:
    """Stolen and total jiffies of all processors since boot (Linux)."""
    fields = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0].split()[1:9]
    return int(fields[7]), sum(map(int, fields))


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--delays", nargs="*", default=["10ms", "50ms", "200ms"])
    options = parser.parse_args()
    print("| delay | messages | slip p50, ms | slip p99, ms | largest, ms | degraded | steal |")
    print("|---|---|---|---|---|---|---|")
    for delay in options.delays:
        stolen, total = cpu_times()
        command = [sys.executable, "-m", "fleet", "run", "head_on", "--clock", "realtime"]
        command += ["--latency", delay, "--duration", str(options.duration), "--json"]
        done = subprocess.run(
            [*command, "--out", os.devnull, "--force"], capture_output=True, text=True, check=True
        )
        found = json.loads(done.stdout)["injected_delay"]
        now_stolen, now_total = cpu_times()
        steal = (now_stolen - stolen) / max(1, now_total - total)
        slip = {name: f"{1e3 * value:.2f}" for name, value in found["slip_s"].items()}
        print(
            f"| {delay} | {found['count']} | {slip['p50']} | {slip['p99']} | {slip['max']} "
            f"| {'yes' if found['degraded'] else 'no'} | {steal:.1%} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
