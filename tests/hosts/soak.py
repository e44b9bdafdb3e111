"""A long realtime flight over hosts whose links go silent, under faults that change: does it last?

    python -m tests.hosts.soak [--duration 3600] [--uavs 16] [--seed 1] [--out FOLDER]

Needs root on Linux (network namespaces). The router and the simulation are on one host, coordinator
and UAVs on three others; UAVs patrol between random points of a box, so that they keep meeting. Now
and then, drawn from the seed, something happens: faults of the links change, a process is killed
and started again, or the link to a host is cut for 0.5 to 40 s. Memory of every process is noted
each 10 s. In the end: is the run complete, is its log whole, has anybody ended by itself, what does
`fleet check` say, and has memory stayed flat (`flat`)? Exits with 1 if anything of that is not so.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.hosts.memory_samples import MemorySamples, flat
from tests.hosts.namespaces import Hosts, unable
from tests.hosts.random_events import Event, RandomEvents
from tests.hosts.spread_fleet import SpreadFleet

BOX_M, LEAST_LEG_M, SPEED_MPS = 8000.0, 3000.0, 25.0
LAYERS_M = (285.0, 300.0, 315.0)
SAMPLE_S = 10.0
BEFORE_S, CALM_S = 30.0, (5.0, 25.0)
"""Nothing happens at first, at the end, and between two events for so long."""
AFTER_S = 90.0
OTHERS = (1, 2, 3)
GRACE_S = 600.0
"""So long the end may be late: at 40 s of silence links take a while to come back."""


def patrols(uavs: int, duration_s: float, seed: int) -> str:
    """A scenario: UAVs that fly from one random point of a box to the next for so long."""
    rng = random.Random(f"patrols {seed}")
    lines = ['name = "patrols"', f"duration_s = {duration_s:g}"]
    for uav in range(1, uavs + 1):
        down_m = -rng.choice(LAYERS_M)
        grid = int(uavs**0.5 + 0.999)
        row, column = divmod(uav - 1, grid)
        here = (row + 0.5) / grid * BOX_M, (column + 0.5) / grid * BOX_M
        points, left_m = list[tuple[float, float]](), 1.1 * duration_s * SPEED_MPS
        last = here
        while left_m > 0.0:
            there = rng.uniform(0.0, BOX_M), rng.uniform(0.0, BOX_M)
            leg_m = ((there[0] - last[0]) ** 2 + (there[1] - last[1]) ** 2) ** 0.5
            if leg_m >= LEAST_LEG_M:
                points.append(there)
                left_m, last = left_m - leg_m, there
        shown = ", ".join(f"[{n:.0f}, {e:.0f}, {down_m:g}]" for n, e in points)
        lines += ["", "[[uav]]", f"id = {uav}", f"heading_deg = {rng.uniform(0, 360):.0f}"]
        lines += [f"speed_mps = {SPEED_MPS:g}", f"waypoints_ned_m = [{shown}]"]
        lines.append(f"position_ned_m = [{here[0]:.0f}, {here[1]:.0f}, {down_m:g}]")
    return "\n".join(lines) + "\n"


def flown(folder: Path, uavs: int, duration_s: float, seed: int) -> dict[str, Any]:
    """Fly, disturb and watch; what came of it."""
    scenario = folder / "patrols.toml"
    scenario.write_text(patrols(uavs, duration_s, seed), encoding="utf-8")
    events, ended = list[Event](), dict[str, str]()
    with Hosts(1 + len(OTHERS), folder) as hosts:
        fleet = SpreadFleet(hosts, folder, uavs, OTHERS)
        fleet.fly((str(scenario),), "--clock", "realtime")
        fleet.await_flight(2.0)
        with MemorySamples(lambda: _processes(fleet), SAMPLE_S, folder / "memory.csv") as samples:
            happenings = RandomEvents(fleet, uavs, OTHERS, seed)
            end_s = time.monotonic() + duration_s
            time.sleep(min(BEFORE_S, 0.1 * duration_s))
            while time.monotonic() < end_s - min(AFTER_S, 0.4 * duration_s):
                assert "run" not in fleet.ended_s, fleet.said
                ended.update(_revived(fleet))
                events.append(happenings.happen())
                print(f"{time.monotonic() - end_s + duration_s:6.0f} s: {events[-1]}", flush=True)
                time.sleep(happenings.rng.uniform(*CALM_S))
            ended.update(_revived(fleet))
            happenings.calm()
            result = fleet.result(within_s=duration_s + GRACE_S)
    fleet.finish()
    return {
        "events": [str(event) for event in events],
        "unanswered": happenings.unanswered,
        "ended": ended,
        "result": result,
        "check": _checked(fleet.log),
        "memory": [role.told() for role in samples.roles()],
        "flat": all(flat(role) for role in samples.roles()),
        "log_mb": fleet.log.stat().st_size / 1e6,
    }


def _processes(fleet: SpreadFleet) -> dict[str, int]:
    """Who is there, by name."""
    there = {"router": fleet.router, **fleet.processes, "simulation": fleet.simulation}
    return {name: process.pid for name, process in there.items() if process.poll() is None}


def _revived(fleet: SpreadFleet) -> dict[str, str]:
    """Who has ended by itself, and what it said; another one is started in its place."""
    gone = [name for name, process in fleet.processes.items() if process.poll() is not None]
    said = {name: fleet.said.get(name, "") for name in gone}
    for name in gone:
        print(f"{name} has ended: {said[name]}", flush=True)
        fleet.join(name)
    return said


def _checked(log: Path) -> dict[str, Any]:
    command = (sys.executable, "-m", "fleet", "check", str(log), "--json")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    found: dict[str, Any] = json.loads(done.stdout)
    broken = [i for log in found["logs"] for i in log["invariants"] if i["verdict"] == "invalid"]
    return {"verdict": found["verdict"], "broken": broken}


def main() -> int:
    """Fly and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--duration", type=float, default=3600.0)
    parser.add_argument("--uavs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if why := unable():
        sys.exit(why)
    folder = options.out or Path(tempfile.mkdtemp(prefix="soak-"))
    folder.mkdir(parents=True, exist_ok=True)
    found = flown(folder.resolve(), options.uavs, options.duration, options.seed)
    (folder / "soak.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    result, check = found["result"], found["check"]
    print(*found["memory"], sep="\n")
    print(f"{result['status']} {result['why']}; {len(result['outages'])} outages")
    print(
        f"{len(found['events'])} events, {len(found['unanswered'])} questions not answered in time"
    )
    print(f"log: {found['log_mb']:.0f} MB")
    print(f"check: {check['verdict']}; {check['broken'] or 'no invariant violated'}")
    print(f"ended by themselves: {found['ended'] or 'nobody'}")
    print("memory is flat" if found["flat"] else "memory is not flat")
    good = result["status"] == "complete" and not (check["broken"] or found["ended"])
    return int(not (good and found["flat"]))


if __name__ == "__main__":
    sys.exit(main())
