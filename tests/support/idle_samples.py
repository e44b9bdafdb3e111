"""Rules of fault plans that do nothing in a run of four UAVs over 3 s, and such as do something."""

from __future__ import annotations

from typing import Any

Table = dict[str, Any]

ALL: Table = {"kind": "loss", "probability": 1.0}
KILL: Table = {"kind": "kill", "node": "1"}
PAUSE: Table = {"kind": "pause", "node": "1"}
SLOW: Table = {"kind": "slow", "node": "1", "factor": 3}
UAVS = (1, 2, 3, 4)
MUTE, DEAF = ["uav.2.equipment=mute"], ["uav.2.equipment=deaf"]


def equipped(equipment: str) -> list[str]:
    """Settings by which all UAVs have this."""
    return [f"uav.{n}.equipment={equipment}" for n in UAVS]


ALONE: dict[str, tuple[Table, str]] = {
    "no loss": ({"kind": "loss", "probability": 0}, "its probability is 0"),
    "no bursts": ({"kind": "burst", "loss": 0}, "its probability is 0"),
    "no copies": ({"kind": "duplicate", "probability": 0}, "its probability is 0"),
    "no replays": ({"kind": "replay", "probability": 0}, "its probability is 0"),
    "nothing held back": ({"kind": "reorder", "probability": 0}, "its probability is 0"),
    "held back for no time": ({"kind": "reorder", "probability": 1, "delay_s": 0}, "by 0 s"),
    "nothing corrupted": ({"kind": "corrupt", "probability": 0}, "its probability is 0"),
    "no latency": ({"kind": "latency"}, "it delays by 0 s"),
    "no random part": (
        {"kind": "latency", "jitter_s": 3, "distribution": "constant"},
        "it delays by 0 s",
    ),
    "capped": ({"kind": "latency", "base_s": 3, "cap_s": 0}, "it delays by 0 s"),
    "latency of less than a tick": (
        {"kind": "latency", "base_s": 0.06, "jitter_s": 0.03},
        "it delays by 0.09 s at most, and in lockstep every message takes a tick",
    ),
    "latency of a tick": ({"kind": "latency", "base_s": 0.1}, "it delays by 0.1 s at most"),
    "exponential latency of less than a tick": (
        {"kind": "latency", "jitter_s": 0.0027, "distribution": "exponential"},
        "it delays by 0.099",
    ),
    "lognormal latency of less than a tick": (
        {"kind": "latency", "jitter_s": 0.000018, "distribution": "lognormal"},
        "it delays by 0.09",
    ),
    "held back for less than a tick": (
        {"kind": "reorder", "probability": 1, "delay_s": 0.05},
        "it delays by 0.05 s at most",
    ),
    "a right clock": ({"kind": "clock", "node": "*"}, "offset_s and drift_ppm are 0"),
    "right positions": ({"kind": "navigation", "node": "*"}, "makes anything wrong"),
    "slow for one tick": ({**SLOW, "start_s": 1, "end_s": 1.1}, "no tick in its window"),
    "stopped in the first tick": ({**PAUSE, "end_s": 0.1}, "no tick but the first"),
}
"""Rules whose own values or windows make nothing of them, and words of the reason."""

AMONG: dict[str, tuple[list[Table], list[str], str]] = {
    "killed twice": ([{**KILL, "start_s": 1}, {**KILL, "start_s": 2}], [], "have stopped"),
    "killed at once": ([{**KILL, "start_s": 1}, {**KILL, "start_s": 1}], [], "have stopped"),
    "killed by two": (
        [
            {**KILL, "start_s": 1.5, "end_s": 2},
            {**KILL, "start_s": 1, "end_s": 1.5},
            {**KILL, "start_s": 1.2, "end_s": 1.8},
        ],
        [],
        "have stopped",
    ),
    "paused when dead": ([{**KILL, "start_s": 1}, {**PAUSE, "start_s": 1}], [], "have stopped"),
    "slow when paused": ([{**PAUSE, "start_s": 1}, {**SLOW, "start_s": 1}], [], "have stopped"),
    "slow twice": ([SLOW, {**SLOW, "start_s": 1.2, "end_s": 2}], [], "have stopped"),
    "lost from the dead": (
        [{**KILL, "start_s": 1}, {**ALL, "src": "1", "start_s": 1}],
        [],
        "other rules have stopped senders or receivers",
    ),
    "lost to the dead": (
        [{**KILL, "start_s": 1}, {**ALL, "dst": "1", "start_s": 1}],
        [],
        "other rules have stopped senders or receivers",
    ),
    "clock of the dead": (
        [{**KILL, "start_s": 1}, {"kind": "clock", "node": "1", "offset_s": 1, "start_s": 1}],
        [],
        "stopped by other rules then",
    ),
    "lost among none": ([{**ALL, "dst": "uav"}], equipped("none"), "nobody sends such messages"),
    "the deaf parted": (
        [{"kind": "partition", "groups": "1-2/3-4"}],
        equipped("deaf"),
        "it is between none of those",
    ),
    "told by the mute": ([{**ALL, "src": "2"}], MUTE, "nobody sends such messages"),
    "heard by the deaf": ([{**ALL, "dst": "2"}], DEAF, "nobody sends such messages"),
    "commands to the mute": ([{**ALL, "class": "cmd", "dst": "2"}], MUTE, "nobody sends such"),
    "a mute clock": ([{"kind": "clock", "node": "2", "offset_s": 1}], MUTE, "nobody hears of"),
    "mute positions": (
        [{"kind": "navigation", "node": "2", "noise_m": 50}],
        MUTE,
        "nobody hears of",
    ),
    "commands of no resolver": (
        [{**ALL, "class": "cmd,ack"}],
        ["resolver=none"],
        "nobody sends such messages",
    ),
    "elections of nobody": (
        [{**ALL, "class": "election,cmd"}],
        equipped("no_compute"),
        "nobody sends such messages",
    ),
    "short latency beside loss": (
        [{"kind": "loss", "probability": 0.3}, {"kind": "latency", "base_s": 0.09}],
        [],
        "it delays by 0.09 s at most",
    ),
}
"""Plans whose last rule does nothing beside the others, settings, words of the reason."""

TOGETHER: dict[str, tuple[list[Table], list[str]]] = {
    "latency of more than a tick": ([{"kind": "latency", "base_s": 0.11}], []),
    "exponential latency": (
        [{"kind": "latency", "jitter_s": 0.05, "distribution": "exponential"}],
        [],
    ),
    "latencies that add up": (
        [{"kind": "latency", "base_s": 0.06}, {"kind": "latency", "base_s": 0.06}],
        [],
    ),
    "latency of late copies": (
        [
            {"kind": "duplicate", "probability": 1.0, "delay_s": 0.08},
            {"kind": "latency", "base_s": 0.05},
        ],
        [],
    ),
    "copies at once": ([{"kind": "duplicate", "probability": 1.0}], []),
    "slow for two ticks": ([{**SLOW, "start_s": 1, "end_s": 1.2}], []),
    "vanished when dead": ([{**KILL, "start_s": 1}, {**KILL, "start_s": 2, "then": "vanish"}], []),
    "killed when paused": ([{**PAUSE, "start_s": 1}, {**KILL, "start_s": 1.5}], []),
    "killed for longer": (
        [{**KILL, "start_s": 1, "end_s": 1.5}, {**KILL, "start_s": 1.2, "end_s": 1.8}],
        [],
    ),
    "slow in other ticks": ([SLOW, {**SLOW, "start_s": 1.3, "end_s": 2}], []),
    "lost from one who is restarted": (
        [{**KILL, "start_s": 1, "end_s": 2}, {**ALL, "src": "1", "start_s": 1.5}],
        [],
    ),
    "answers between two ticks": (
        [
            {"kind": "latency", "base_s": 0.15},
            {**ALL, "class": "ack", "start_s": 0.51, "end_s": 0.59},
        ],
        [],
    ),
    "heard by the mute": ([{**ALL, "dst": "2"}], MUTE),
    "told by the deaf": ([{**ALL, "src": "2"}], DEAF),
    "a deaf clock": ([{"kind": "clock", "node": "2", "offset_s": 1}], DEAF),
}
"""Plans whose last rule does something."""
