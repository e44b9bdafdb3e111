"""Conflict detection at constant density, beside that of BlueSky.

    python -m benchmarks.detection [--counts 100 1000 10000] [--rounds 5] [--band 200]

N UAVs at 1 per square km fly straight in random directions, 10 to 30 m/s, level at altitudes within
a band. Looked for are all pairs that come within 200 m and 25 m of each other in the next 60 s.
The same states are given to the detection of this project, as the reports that a coordinator has,
and in turn to the compiled one (C++) of BlueSky as arrays, where the package `bluesky-simulator` is
installed. Prints the least time of all rounds of each, and in how many pairs they differ: BlueSky
works with latitude and longitude, so that one at the very edge of a zone may be one.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import random
import time
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from fleet.config.scenario import Scenario
from fleet.model.conflict.detection import conflicts
from fleet.model.conflict.outlook import Outlook
from fleet.model.conflict.risk import Required, sample_times
from fleet.model.conflict.tracks import StateReport
from fleet.model.types import Pair
from fleet.model.vehicle.flight import State
from fleet.model.vehicle.guidance import FlightPlan
from fleet.model.vehicle.intent import Intent

HORIZON_S = 60.0
REQUIRED = Required(200.0, 25.0)
M_PER_DEG = 6371000.0 * math.pi / 180.0
MIDDLE_M = 300.0

Detector = Callable[[], set[Pair]]


def scene(count: int, band_m: float, seed: int = 1) -> list[StateReport]:
    """Reports of so many UAVs, at 1 per square km."""
    rng, half_m = random.Random(seed), 500.0 * math.sqrt(count)
    out = []
    for uav in range(1, count + 1):
        north, east = rng.uniform(-half_m, half_m), rng.uniform(-half_m, half_m)
        place = (north, east, -MIDDLE_M + rng.uniform(-0.5, 0.5) * band_m)
        heading = rng.uniform(-math.pi, math.pi)
        state = State(*place, rng.uniform(10.0, 30.0), heading)
        out.append(StateReport(uav, 0, state, Intent(heading, 0.0), FlightPlan((place,), heading)))
    return out


def own(reports: list[StateReport]) -> Callable[[], set[Pair]]:
    """Ours."""
    models = Scenario("detection", 100.0).models()
    outlook = Outlook(models, sample_times(HORIZON_S, 1.0), REQUIRED)
    return lambda: set(conflicts(reports, 0, outlook))


def blueskys(reports: list[StateReport]) -> Detector | None:
    """BlueSky's, if it is installed."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            from bluesky.traffic.asas import cstatebased  # noqa: PLC0415 (it may not be there)
    except ImportError:
        return None
    states = [r.state for r in reports]
    traffic = SimpleNamespace(
        id=[r.id for r in reports],
        lat=np.array([s.north_m / M_PER_DEG for s in states]),
        lon=np.array([s.east_m / M_PER_DEG for s in states]),
        trk=np.array([math.degrees(s.heading_rad) % 360.0 for s in states]),
        gs=np.array([s.speed_mps for s in states]),
        alt=np.array([-s.down_m for s in states]),
        vs=np.array([s.climb_mps for s in states]),
    )
    horizontal, vertical, ahead = (
        np.full(len(states), value)
        for value in (REQUIRED.horizontal_m, REQUIRED.vertical_m, HORIZON_S)
    )

    def found() -> set[Pair]:
        pairs = cstatebased.detect(traffic, traffic, horizontal, vertical, ahead)[0]
        return {(min(pair), max(pair)) for pair in pairs}

    return found


def timed(detector: Detector) -> tuple[float, set[Pair]]:
    """How long it takes once, in s, and what it finds."""
    begun = time.perf_counter()
    found = detector()
    return time.perf_counter() - begun, found


def main() -> None:
    """Measure and print a row for each number of UAVs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[100, 1000, 10_000])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--band", type=float, default=200.0)
    options = parser.parse_args()
    print("| N | pairs | this project | BlueSky, C++ | ratio | pairs that differ |")
    print("|---|---|---|---|---|---|", flush=True)
    for count in options.counts:
        reports = scene(count, options.band)
        detectors = [d for d in (own(reports), blueskys(reports)) if d]
        rounds = [[timed(d) for d in detectors] for _ in range(options.rounds)]
        least = [min(r[k][0] for r in rounds) for k in range(len(detectors))]
        pairs = [rounds[0][k][1] for k in range(len(detectors))]
        cells = [count, len(pairs[0]), f"{1e3 * least[0]:.2f} ms"]
        if len(detectors) > 1:
            cells += [f"{1e3 * least[1]:.1f} ms", f"{least[1] / least[0]:.0f}"]
            cells += [len(pairs[0] ^ pairs[1])]
        else:
            cells += ["not installed", "-", "-"]
        print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()
