"""How long a round of the geometric resolver takes for one converging group.

    python -m benchmarks.resolution [--counts 4 8 12 16 24 48] [--rounds 3]

N UAVs fly to the centre of a circle, evenly from all sides, until the resolver first advises. That
round is timed, in which every candidate of every UAV is looked at, and one round later, in which
all fly what they were told. Prints the least processor times and the exponents p of time ~ N^p.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from fleet.agents.advisory import Advisory, Aircraft, Situation
from fleet.agents.geometric import GeometricResolver
from fleet.config.loading import read_scenario
from fleet.config.scenario import Scenario
from fleet.config.traffic import uavs_of
from fleet.model.conflict.tracks import ActiveManoeuvre
from fleet.model.units import to_ns
from fleet.protocol.surveillance import manoeuvre_of

STEP_S = 1.0
LEAST_RADIUS_M = 2000.0
APART_M = 84.0
"""Radius for each UAV: so that neighbours have not met when they begin."""


def converging(count: int) -> Scenario:
    """So many on a circle."""
    radius_m = max(LEAST_RADIUS_M, APART_M * count)
    changes = [f"generate.count={count}", f"generate.radius_m={radius_m}"]
    return read_scenario("converge", changes).scenario


def alerted(scenario: Scenario) -> tuple[Situation, list[Advisory]]:
    """The first situation in which the resolver advises, and what."""
    resolver = GeometricResolver(scenario)
    flying = [
        (u.id, scenario.pilot(u.id, u.speed_mps), u.plan(), u.state()) for u in uavs_of(scenario)
    ]
    while True:
        aircraft = tuple(
            Aircraft(uav, state, pilot.intent(plan, state), None, pilot.ahead(plan, state))
            for uav, pilot, plan, state in flying
        )
        situation = Situation(1, tuple(a.id for a in aircraft), aircraft)
        advised = list(resolver.resolve(situation))
        if advised:
            return situation, advised
        flown = [(u, p, *p.follow(plan, s, to_ns(STEP_S))) for u, p, plan, s in flying]
        flying = [(u, pilot, plan, states[-1]) for u, pilot, plan, states in flown]


def obeyed(situation: Situation, advised: list[Advisory]) -> Situation:
    """The same moment, with everybody flying what was advised."""
    told = {a.target: a for a in advised}
    aircraft = tuple(
        replace(craft, manoeuvre=_manoeuvre(told[craft.id])) if craft.id in told else craft
        for craft in situation.aircraft
    )
    return replace(situation, aircraft=aircraft)


def _manoeuvre(a: Advisory) -> ActiveManoeuvre:
    return manoeuvre_of(a.manoeuvre, a.heading_rad, a.climb_mps, a.level_down_m, a.speed_mps)


def least_s(scenario: Scenario, situation: Situation, rounds: int) -> float:
    """Least processor time of a round."""
    resolver, times = GeometricResolver(scenario), []
    for _ in range(rounds):
        begun = time.process_time()
        resolver.resolve(situation)
        times.append(time.process_time() - begun)
    return min(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[4, 8, 12, 16, 24, 48])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    print("| N | advised | first round | a later round |\n|---|---|---|---|", flush=True)
    first, later = [], []
    for count in options.counts:
        scenario = converging(count)
        situation, advised = alerted(scenario)
        first.append(least_s(scenario, situation, options.rounds))
        later.append(least_s(scenario, obeyed(situation, advised), options.rounds))
        times = f"{1e3 * first[-1]:.1f} ms | {1e3 * later[-1]:.1f} ms"
        print(f"| {count} | {len(advised)} | {times} |", flush=True)
    for name, times_s in (("first", first), ("later", later)):
        exponent = np.polyfit(np.log(options.counts), np.log(times_s), 1)[0]
        print(f"{name} round: time ~ N^{exponent:.2f}")


if __name__ == "__main__":
    main()
