"""What a viewer costs: a fleet as fast as it goes, unseen, and with a page that takes all it gets.

    python -m benchmarks.live [--uavs 30] [--simulated 20] [--rounds 3]

Random traffic over zenoh, a process for each UAV, unseen and seen in turn; wall milliseconds a
tick, the least of all rounds. The page's server is `fleet live` with one browser, which is a client
here that reads all views.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from aiohttp import ClientSession

FLEET = [sys.executable, "-m", "fleet"]


def flown_ms(folder: Path, uavs: int, simulated_s: float, *, seen: bool) -> tuple[float, int]:
    """Wall milliseconds a tick, and how many views were taken."""
    options = ["--duration", f"{simulated_s:g}", "--out", str(folder / "run.mcap"), "--force"]
    traffic = ["--set", f"generate.count={uavs}", "--set", "generate.density_per_km2=1"]
    pace = ["--speed", "1000"]  # no pace, but the run tells its name
    run = subprocess.Popen(
        [*FLEET, "run", "crossing", *traffic, *options, *pace, "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    views = asyncio.run(views_of(name_in(run, r"^run (\w+):"))) if seen else 0
    out, _ = run.communicate()
    result = json.loads(out)
    return 1000.0 * result["wall_s"] / (10.0 * simulated_s), views


def name_in(process: subprocess.Popen[str], pattern: str) -> str:
    """What a process says of itself."""
    assert process.stderr is not None
    for line in process.stderr:
        found = re.search(pattern, line)
        if found:
            return found[1]
    raise SystemExit("it said nothing")


async def views_of(run: str) -> int:
    """Look at a run until it is over; how many views were taken."""
    page = subprocess.Popen(
        [*FLEET, "live", run, "--wait", "60"], stderr=subprocess.PIPE, text=True
    )
    address, views = name_in(page, r"(http://\S+)"), 0
    async with ClientSession() as session, session.ws_connect(address + "live") as socket:
        async for message in socket:
            views += message.data.startswith('{"view"')
            if message.data.startswith('{"over"'):
                break
    page.wait()
    return views


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--uavs", type=int, default=30)
    parser.add_argument("--simulated", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    found: dict[bool, list[float]] = {False: [], True: []}
    views = 0
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(given.rounds):
            for seen in (False, True):
                ms, views = flown_ms(Path(folder), given.uavs, given.simulated, seen=seen)
                found[seen].append(ms)
                print(f"{'seen' if seen else 'unseen':8} {ms:7.2f} ms a tick", flush=True)
    unseen, seen_ms = min(found[False]), min(found[True])
    print(f"{given.uavs} UAVs: {unseen:.2f} ms a tick unseen, {seen_ms:.2f} seen ({views} views): ")
    print(f"{seen_ms / unseen:.3f} times as long")


if __name__ == "__main__":
    main()
