"""Test vectors of what a fault plan does, for receivers in other languages.

`python -m tools.fault_vectors` writes docs/protocol/fault_vectors.json from the code; a test holds
that it is up to date, and that the example of a foreign UAV, written from the documents alone,
gives the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from fleet.faults.channel import Channel
from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.kinds.navigation import Navigation
from fleet.faults.plan import plan_of
from fleet.faults.rules import Rule
from fleet.model.vehicle.flight import State
from fleet.protocol.classes import DELIVERY_ORDER

PATH = Path(__file__).parent.parent / "docs" / "protocol" / "fault_vectors.json"
SEED = 20_110_805
TICK_NS = 100_000_000
SEPARATOR = ",\n  "
BITS = 2400
"""Size of a message in the vectors."""

DRAWS: tuple[tuple[int, int, str, tuple[int, ...]], ...] = (
    (0, 0, "loss of adsb", (0, 2, 1, 0)),
    (0, 0, "loss of adsb", (0, 2, 1, 1)),
    (0, 1, "loss of adsb", (0, 2, 1, 1)),
    (1, 0, "loss of adsb", (0, 2, 1, 1)),
    (2**63 - 1, 7, "latency of cmd", (2, 2, 1, 10**9 + 5)),
    (SEED, 3, "burst", (1, 2, 40)),
    (SEED, 3, "shadow", (1, 2, 4, 1)),
    (SEED, 3, "dropout", (2, 4_000_000_000)),
)
"""Seed, place in the plan, purpose and labels of draws."""

PLANS: dict[str, str] = {
    "latency, constant": '[{"kind": "latency", "base_s": 0.35, "distribution": "constant"}]',
    "latency, uniform": '[{"kind": "latency", "base_s": 0.3, "jitter_s": 0.4}]',
    "latency, exponential": '[{"kind": "latency", "jitter_s": 0.5, "distribution": "exponential"}]',
    "latency, lognormal": (
        '[{"kind": "latency", "jitter_s": 0.3, "distribution": "lognormal", "sigma": 0.7, '
        '"cap_s": 0.6}]'
    ),
    "loss": '[{"kind": "loss", "probability": 0.4}]',
    "loss, with a seed of its own": '[{"kind": "loss", "probability": 0.4, "seed": 7}]',
    "loss, of a class in a window": (
        '[{"kind": "loss", "probability": 1.0, "class": "cmd,ack", "src": "1", "dst": "2-3", '
        '"start_s": 0.3, "end_s": 0.6}]'
    ),
    "burst": '[{"kind": "burst", "loss": 0.5, "mean_ticks": 3}]',
    "corrupt": '[{"kind": "corrupt", "probability": 0.4}]',
    "duplicate": '[{"kind": "duplicate", "probability": 0.4, "delay_s": 0.25}]',
    "replay": '[{"kind": "replay", "probability": 0.4}]',
    "reorder": '[{"kind": "reorder", "probability": 0.4}]',
    "partition": '[{"kind": "partition", "groups": "1,3/2"}]',
    "rate": '[{"kind": "rate", "bits_per_s": 16000, "queue": 1}]',
    "range, cutoff": '[{"kind": "range", "max_m": 900}]',
    "range, rayleigh": '[{"kind": "range", "model": "rayleigh", "scale_m": 900}]',
    "range, polynomial": (
        '[{"kind": "range", "model": "polynomial", "quadratic_per_m2": 4e-7, "linear_per_m": 1e-4}]'
    ),
    "range, log_distance": (
        '[{"kind": "range", "model": "log_distance", "exponent": 3.2, "shadowing_db": 6}]'
    ),
    "several, of which the first drop counts": (
        '[{"kind": "latency", "base_s": 0.2, "distribution": "constant"}, '
        '{"kind": "duplicate", "probability": 0.5, "delay_s": 0.1}, '
        '{"kind": "reorder", "probability": 0.5, "delay_s": 0.7}, '
        '{"kind": "loss", "probability": 0.2}, {"kind": "corrupt", "probability": 0.2}]'
    ),
}
"""Plans, as JSON without what is as by default."""


def messages() -> list[LinkMessage]:
    """What is sent to UAV 2: every class, by UAVs 1 and 3, the coordinator, and itself."""
    out = []
    for n in range(20):
        kind, src = DELIVERY_ORDER[n % len(DELIVERY_ORDER)], (1, 3, 0, 1, 1, 2, 1)[n % 7]
        distance_m = None if n == 19 else 150.0 * (n % 9) + 10.0
        out.append(LinkMessage(src, 2, kind, n, n // 3 * TICK_NS, BITS, distance_m))
    return out


def fates(plan: tuple[Rule, ...]) -> list[list[int] | str]:
    """Of each message, the delays of its deliveries in ns, or what drops it."""
    channel = Channel(plan, SEED, TICK_NS)
    judged = [channel.fate(message) for message in messages()]
    return [fate.dropped_by or [d.delay_ns for d in fate.deliveries] for fate in judged]


def flips() -> dict[str, Any]:
    """Which bits are flipped, where there is no frame check."""
    text = '[{"kind": "corrupt", "probability": 0.5, "bits": 3, "frame_check": false}]'
    plan = plan_of(text)
    channel = Channel(plan, SEED, TICK_NS)
    places = [channel.fate(message).deliveries[0].flips for message in messages()]
    bits = [[int(place * BITS) for place in of_one] for of_one in places]
    return {"plan": plan, "bits": bits}


def sensed() -> dict[str, Any]:
    """What a fault of navigation makes of a state."""
    rule = Navigation(
        node="2",
        noise_m=10.0,
        vertical_noise_m=4.0,
        velocity_noise_mps=1.0,
        bias_ned_m=(1.0, 2.0, 3.0),
        drift_ned_mps=(0.5, 0.0, 0.0),
        dropout=0.3,
    )
    state, sense = State(100.0, 200.0, -300.0, 25.0, 0.5), rule.sensing(rule.draws(SEED, 3), 2)
    times_ns = [n * TICK_NS for n in range(8)]
    found = [sense(state, t_ns) for t_ns in times_ns]
    return {"rule": rule, "place": 3, "uav": 2, "state": state, "t_ns": times_ns, "sensed": found}


def vectors() -> dict[str, Any]:
    """All test vectors."""
    draws = [
        {
            "seed": seed,
            "place": place,
            "purpose": purpose,
            "labels": labels,
            "uniform": Draws(seed, place).uniform(purpose, *labels),
        }
        for seed, place, purpose, labels in DRAWS
    ]
    plans = {name: plan_of(text) for name, text in PLANS.items()}
    return {
        "seed": SEED,
        "tick_ns": TICK_NS,
        "draws": draws,
        "messages": messages(),
        "fates": {name: {"plan": plan, "of": fates(plan)} for name, plan in plans.items()},
        "flips": flips(),
        "navigation": sensed(),
    }


def text() -> str:
    """The file: one draw, message, plan and moment a line."""
    parts = []
    for name, value in msgspec.to_builtins(vectors()).items():
        head = f"{encoded(name)}: "
        if isinstance(value, list):
            parts.append(f"{head}[\n  {SEPARATOR.join(map(encoded, value))}\n ]")
        elif isinstance(value, dict):
            lines = [f"{encoded(key)}: {encoded(each)}" for key, each in value.items()]
            parts.append(f"{head}{{\n  {SEPARATOR.join(lines)}\n }}")
        else:
            parts.append(f"{head}{value}")
    return "{\n " + ",\n ".join(parts) + "\n}\n"


def encoded(value: object) -> str:
    """JSON on one line."""
    return msgspec.json.encode(value).decode()


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
