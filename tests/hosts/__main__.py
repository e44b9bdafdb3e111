"""Real outages between hosts, one run each: the table of docs/hosts.md. Needs root on Linux.

Usage: python -m tests.hosts [name part ...]      (without: all; takes about ten minutes)
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.conftest import fly
from tests.hosts.namespaces import Hosts, unable
from tests.hosts.spread_fleet import SpreadFleet

SCENARIO, UAVS = "converge", 4
SETTINGS = ("--set", f"generate.count={UAVS}")
BEFORE_S, AFTER_S, LOCKSTEP_S = 3.0, 25.0, 120.0
SILENCES_S = (0.5, 3.0, 10.0, 40.0)


def silent(clock: str, for_s: float) -> Callable[[Path], str]:
    """The link to the host of two UAVs is silent for a while, and healed."""

    def outage(fleet: SpreadFleet) -> None:
        fleet.hosts.cut(2)
        time.sleep(for_s)
        fleet.hosts.heal(2)

    return lambda folder: flown(folder, clock, for_s, outage)


def router_restarted(clock: str, for_s: float) -> Callable[[Path], str]:
    """The router is killed, and another one started in its place."""

    def outage(fleet: SpreadFleet) -> None:
        fleet.kill(fleet.router)
        time.sleep(for_s)
        fleet.router = fleet.start_router()

    return lambda folder: flown(folder, clock, for_s, outage)


def uav_restarted(for_s: float) -> Callable[[Path], str]:
    """The process of a UAV is killed, and another one started in its place."""

    def outage(fleet: SpreadFleet) -> None:
        fleet.kill(fleet.processes["3"])
        time.sleep(for_s)
        fleet.join("3")

    return lambda folder: flown(folder, "realtime", for_s, outage)


def flown(folder: Path, clock: str, for_s: float, outage: Callable[[SpreadFleet], None]) -> str:
    """Fly on three hosts with something that happens on the way; what became of it."""
    long_s = BEFORE_S + for_s + AFTER_S + max(0.0, for_s - 10.0)
    duration_s = long_s if clock == "realtime" else LOCKSTEP_S
    words = (SCENARIO, *SETTINGS, "--duration", f"{duration_s:g}")
    pace = () if clock == "realtime" else ("--speed", "10")
    with Hosts(3, folder) as hosts:
        fleet = SpreadFleet(hosts, folder, UAVS, (1, 2))
        fleet.fly(words, "--clock", clock, *pace)
        fleet.await_flight(BEFORE_S)
        outage(fleet)
        result = fleet.result()
    fleet.finish()
    told = result["status"]
    if told == "invalid":
        return f"INVALID: {result['why']}"
    if clock == "lockstep":
        alone = fly(SCENARIO, f"generate.count={UAVS}", f"duration_s={duration_s}").digest
        return f"{told}, {'the same digest' if result['digest'] == alone else 'another digest'}"
    spans = [
        f"{o['id'] or 'coordinator'}: {o['until_s'] - o['since_s']:.1f} s ({o['end']})"
        for o in sorted(result["outages"], key=lambda o: (o["since_s"], o["id"]))
    ]
    check = (sys.executable, "-m", "fleet", "check", str(fleet.log))
    verdict = subprocess.run(check, capture_output=True, text=True, check=False).stdout
    judged = verdict.strip().splitlines()[-1].removeprefix(f"{fleet.log}: ")
    return f"{told}; not heard: {', '.join(spans) or 'nobody'}; check: {judged}"


def spread_out(folder: Path, *, linked: bool = False) -> str:
    """12 UAVs on three hosts, nothing cut."""
    words = (SCENARIO, "--set", "generate.count=12", "--duration", "60")
    with Hosts(3, folder) as hosts:
        fleet = SpreadFleet(hosts, folder, 12, (0, 1, 2), linked=linked)
        fleet.fly(words)
        result = fleet.result()
    fleet.finish()
    alone = fly(SCENARIO, "generate.count=12", "duration_s=60").digest
    same = result["digest"] == alone
    return f"{result['status']}, {'the digest of one host' if same else 'another digest'}"


CASES: dict[str, Callable[[Path], str]] = {
    "12 UAVs on 3 hosts, lockstep": spread_out,
    "12 UAVs on 3 hosts, a router on each, linked, lockstep": partial(spread_out, linked=True),
    **{f"link silent for {s:g} s, {c}": silent(c, s) for c in ("lockstep", "realtime")
       for s in SILENCES_S},
    **{f"router killed, again after 2 s, {c}": router_restarted(c, 2.0)
       for c in ("lockstep", "realtime")},
    "UAV 3 killed, again after 3 s, realtime": uav_restarted(3.0),
}  # fmt: skip


def main(*parts: str) -> None:
    """Print the table."""
    if why := unable():
        sys.exit(why)
    print("| what | what became of it |\n|---|---|", flush=True)
    for name, case in CASES.items():
        if not parts or any(part in name for part in parts):
            with tempfile.TemporaryDirectory() as folder:
                print(f"| {name} | {case(Path(folder))} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
