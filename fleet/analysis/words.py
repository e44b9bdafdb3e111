"""Numbers in words, the same in tables, pages and figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Any

DIGITS, MOST_DIGITS = 3, 6


def separation_text(value: float) -> str:
    """A normalised separation, with as many digits as it takes to see whether it is below 1.

    What is lost never reads as `1.000`: it is `0.9996`, or `<1` if that needs too many digits.
    """
    for digits in range(DIGITS, MOST_DIGITS + 1):
        text = f"{value:.{digits}f}"
        if value >= 1.0 or float(text) < 1.0:
            return text
    return "<1"


Z_95 = NormalDist().inv_cdf(0.975)


def wilson(successes: float, trials: int) -> tuple[float, float]:
    """Interval in which a probability is with 95 % confidence (Wilson's score interval)."""
    if not trials:
        return 0.0, 1.0
    share, square = successes / trials, Z_95**2 / trials
    middle = share + square / 2.0
    half = Z_95 * math.sqrt(share * (1.0 - share) / trials + square / (4.0 * trials))
    low, high = (middle - half) / (1.0 + square), (middle + half) / (1.0 + square)
    return max(0.0, low) * (successes > 0), 1.0 if successes >= trials else min(1.0, high)


def share_text(successes: float, trials: int) -> str:
    """A share with its 95 % interval, as in `70.0 % (48.1 to 85.5)`; `-` of nothing."""
    if not trials:
        return "-"
    low, high = wilson(successes, trials)
    return f"{100.0 * successes / trials:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"


def plain_text(value: Any) -> str:
    """A value for people: truth values are `yes` and `no`, as everywhere in tables."""
    return ("no", "yes")[value] if isinstance(value, bool) else str(value)


def counted(count: int, one: str, many: str = "") -> str:
    """As in `1 pair` and `2 pairs`."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def clock_text(told: Mapping[str, Any]) -> str:
    """What a result tells of the wall clocks, as in `within a tenth of a tick (+-0.3 ms)`."""
    if not told.get("offsets"):
        return "not compared: nothing was measured in both directions of a link"
    unknown = ["the coordinator's"] if 0 in told["unknown"] else []
    uavs = [number for number in told["unknown"] if number]
    unknown += [f"that of UAV {enumerated(uavs)}"] if uavs else []
    more = f"; nothing is known of {' and '.join(unknown)}" if unknown else ""
    if told["words"]:
        return f"{told['words']}; zenoh latency is corrected by that{more}"
    half_ms = 1e3 * max(row["uncertainty_s"] for row in told["offsets"])
    return f"within a tenth of a tick of each other (+-{half_ms:.2g} ms){more}"


def _participant_name(row: Mapping[str, Any]) -> str:
    return f"UAV {row['id']}" if row["id"] else "the coordinator"


def shortage_text(counts: Mapping[str, int]) -> str:
    """What was dropped for lack of room, as in `3 at sim/fault, 20 at 2`; empty if nothing was."""
    return ", ".join(f"{count} at {place}" for place, count in counts.items())


def outage_text(rows: Sequence[Mapping[str, Any]], most: int = 6) -> str:
    """When nothing was heard of whom, as in `UAV 3 from 12.1 to 22.4 s (back)`."""
    told = [
        f"{_participant_name(row)} "
        f"from {row['since_s']:.1f} to {row['until_s']:.1f} s ({row['end']})"
        for row in rows[:most]
    ]
    more = f"; and {len(rows) - most} more" if len(rows) > most else ""
    return "; ".join(told) + more


def arrival_text(told: Mapping[str, Any], uavs: int) -> str:
    """Whether all arrived, of totals of `Arrivals`, as in `yes: 4 of 4`."""
    answer = "not yet" if told["all_arrived"] == "not due" else told["all_arrived"]
    missing = missing_text(told, uavs)
    text = f"{answer}: {told['arrived']} of {uavs}{f'; {missing}' if missing else ''}"
    if told["delay_max_s"] is not None:
        text += f"; delay mean {told['delay_mean_s']:.1f} s, max {told['delay_max_s']:.1f} s"
    return text


def missing_text(told: Mapping[str, Any], uavs: int) -> str:
    """What is to be said of those that did not arrive; empty if all did."""
    late = told["not_arrived"]
    if late:
        return (
            f"UAV {enumerated(late)} {'was' if len(late) == 1 else 'were'} due and did not arrive"
        )
    if told["arrived"] == uavs:
        return ""
    if told["all_arrived"] == "not due":
        who = "no other" if told["arrived"] else "none"
        return f"{who} was due by the end"
    return "the others are not flown to the end"


def enumerated(numbers: Sequence[int], most: int = 8) -> str:
    """As in `1, 2, 3` or, of many, `1, 2 and 30 more`."""
    more = f" and {len(numbers) - most} more" if len(numbers) > most else ""
    return ", ".join(map(str, numbers[:most])) + more
