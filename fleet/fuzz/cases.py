"""Random cases, each a function of its seed: an encounter and a fault plan, as a TOML table.

The encounters are short and tight, some by plans that bend where they meet, and the faults begin
and end within them: what matters is that elections, commands and failures fall together, not that
separation can be kept.
"""

from __future__ import annotations

import math
import random
from typing import Any

from fleet.faults.lifecycle import ProcessRule
from fleet.faults.registry import kinds
from fleet.model.elementary import cos, sin

CaseTable = dict[str, Any]


def case_of(seed: int) -> CaseTable:
    """The scenario of a seed."""
    rng = random.Random(seed)
    duration_s = float(rng.choice((24, 30, 36, 45)))
    uavs = _uavs(rng, rng.randint(2, 5))
    numbers = [u["id"] for u in uavs]
    table: CaseTable = {
        "name": f"fuzz-{seed}",
        "seed": seed,
        "duration_s": duration_s,
        "tick_s": rng.choice((0.1, 0.1, 0.2)),
        "zone": {"radius_m": rng.choice((60, 100)), "half_height_m": 20},
        "surveillance": {
            "broadcast_s": rng.choice((0.2, 0.4)),
            "timeout_s": rng.choice((5.0, 60.0)),
        },
        "coordination": {
            "electors": rng.choice(("coordinator", "coordinator", "coordinator", "local")),
            "group_hold_s": rng.choice((0.0, 2.0)),
        },
        "resolution": {
            "horizon_s": rng.choice((10, 15)),
            "turn_candidates": 7,
            "climb_candidates": 5,
            "speed_candidates": rng.choice((0, 0, 5)),
            "growth_mps": rng.choice((0.0, 0.0, 5.0)),
        },
        "uav": uavs,
    }
    drawn = rng.choices(list(kinds()), k=rng.choice((0, 1, 1, 2, 2, 3, 4, 6)))
    table["fault"] = [_rule(rng, kind, numbers, duration_s) for kind in drawn]
    for uav in uavs:
        if rng.random() < 0.3:
            uav["waypoints_ned_m"] = _bent(rng, uav)
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        table["fault"].append(_pressing(rng, duration_s))
    if rng.random() < 0.3:
        table["fault"].append(_failing(rng, numbers, duration_s))
    _equip(rng, uavs)
    if rng.random() < 0.15:
        rng.choice(uavs)["zone"] = {"radius_m": rng.choice((40, 150)), "half_height_m": 30}
    return table


def _equip(rng: random.Random, uavs: list[CaseTable]) -> None:
    """Now and then some, not all, are equipped for less than all."""
    if rng.random() < 0.2:
        for uav in rng.sample(uavs, len(uavs) - 1):
            uav["equipment"] = rng.choice(("full", "full", "no_compute", "deaf", "mute", "none"))


def _uavs(rng: random.Random, count: int) -> list[CaseTable]:
    """UAVs that pass near the origin at about the same time, from well apart."""
    meet_s = rng.uniform(12.0, 20.0)
    numbers = sorted(rng.sample(range(1, 30), count))
    first = rng.uniform(0.0, 360.0)
    out = []
    for n, number in enumerate(numbers):
        heading_deg = (first + n * 360.0 / count + rng.uniform(-25.0, 25.0)) % 360.0
        speed_mps = rng.choice((20.0, 25.0, 25.0, 30.0))
        back_m = speed_mps * (meet_s + rng.uniform(-2.0, 2.0))
        aside_m = rng.uniform(-60.0, 60.0)
        north, east = cos(math.radians(heading_deg)), sin(math.radians(heading_deg))
        down_m = -300.0 + rng.choice((0.0, 0.0, 0.0, 15.0, -15.0))
        start = (-back_m * north - aside_m * east, -back_m * east + aside_m * north)
        goal = (start[0] + 4000.0 * north, start[1] + 4000.0 * east)
        out.append(
            {
                "id": number,
                "position_ned_m": [round(start[0], 1), round(start[1], 1), down_m],
                "heading_deg": round(heading_deg, 1),
                "waypoints_ned_m": [[round(goal[0], 1), round(goal[1], 1), down_m]],
                "speed_mps": speed_mps,
            }
        )
    return out


def _bent(rng: random.Random, uav: CaseTable) -> list[list[float]]:
    """A plan that turns, or changes its altitude, about where the UAVs meet."""
    north, east, down_m = uav["position_ned_m"]
    goal = uav["waypoints_ned_m"][0]
    part = rng.uniform(150.0, 800.0) / 4000.0
    corner = [north + part * (goal[0] - north), east + part * (goal[1] - east)]
    heading = math.radians(uav["heading_deg"] + rng.choice((0.0, rng.uniform(-150.0, 150.0))))
    level_m = down_m + rng.choice((0.0, 30.0, -30.0))
    beyond = [corner[0] + 3500.0 * cos(heading), corner[1] + 3500.0 * sin(heading)]
    return [[round(x, 1) for x in (*corner, down_m)], [round(x, 1) for x in (*beyond, level_m)]]


def _rule(rng: random.Random, kind: str, numbers: list[int], duration_s: float) -> CaseTable:
    """One rule, over a window within the run or for all of it."""
    cls = kinds()[kind]
    rule: CaseTable = {"kind": kind}
    if rng.random() < 0.75 or issubclass(cls, ProcessRule):
        start_s = round(rng.uniform(0.2, 0.7 * duration_s), 1)
        rule["start_s"] = start_s
        if rng.random() < 0.8:
            rule["end_s"] = round(start_s + rng.choice((0.3, 1.0, 3.0, 8.0, 15.0)), 1)
    rule |= cls.fuzzed_whom(rng, numbers)
    rule |= cls.fuzzed(rng, numbers)
    return {key: value for key, value in rule.items() if value is not None}


def _pressing(rng: random.Random, duration_s: float) -> CaseTable:
    """A rule on what is rare and matters most: commands, elections and answers come late or twice.

    Late by about as long as they are valid, so that some come just in time and some in disorder.
    """
    rule = dict(
        rng.choice(PRESSING), **{"class": rng.choice(("cmd", "cmd", "cmd,election", "ack"))}
    )
    if rng.random() < 0.5:
        rule["start_s"] = round(rng.uniform(0.1, 0.6) * duration_s, 1)
    return rule


def _failing(rng: random.Random, numbers: list[int], duration_s: float) -> CaseTable:
    """One that elects or is likely to compute fails for a while, or its clock is set back."""
    start_s = round(rng.uniform(0.1, 0.6) * duration_s, 1)
    end_s = round(start_s + rng.choice((0.3, 1.0, 2.0, 4.0)), 1)
    what = rng.choice(FAILURES)
    who = rng.choice((*numbers[:2], numbers[0], "coordinator"))
    return {**what, "node": str(who), "start_s": start_s, "end_s": end_s}


PRESSING: tuple[CaseTable, ...] = (
    {"kind": "latency", "base_s": 1.2, "jitter_s": 1.2, "distribution": "uniform"},
    {
        "kind": "latency",
        "base_s": 0.5,
        "jitter_s": 0.8,
        "distribution": "exponential",
    },
    {"kind": "latency", "base_s": 1.8, "jitter_s": 0.8, "distribution": "uniform"},
    {"kind": "duplicate", "probability": 1.0, "delay_s": 0.5},
    {"kind": "duplicate", "probability": 0.5, "delay_s": 1.5},
    {"kind": "replay", "probability": 0.5, "delay_s": 3.0},
    {"kind": "reorder", "probability": 0.5, "delay_s": 1.2},
    {"kind": "loss", "probability": 0.6},
)

FAILURES: tuple[CaseTable, ...] = (
    {"kind": "kill"},
    {"kind": "kill"},
    {"kind": "pause"},
    {"kind": "clock", "offset_s": -1.0},
)
