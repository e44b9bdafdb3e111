"""Shorthands: `--latency 300ms`, `--loss 20%`, `--partition 1,2/3,4@60s+30s`."""

from __future__ import annotations

import re
from typing import Any

_TIME = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}


def seconds(text: str) -> float:
    """A duration: 300ms, 0.3s, 2min, or plain seconds; raises ValueError."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(s|ms|us|min|)", text.strip())
    if not found:
        raise ValueError(f"'{text}' is no time; write 300ms, 0.3s or 2min")
    return float(found[1]) * _TIME[found[2]]


def fraction(text: str) -> float:
    """A probability: 20% or 0.2; raises ValueError."""
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(%?)", text.strip())
    value = float(found[1]) / (100.0 if found[2] else 1.0) if found else -1.0
    if not 0.0 <= value <= 1.0:
        raise ValueError(f"'{text}' is no probability; write 20% or 0.2")
    return value


def window(text: str) -> tuple[str, float, float | None]:
    """`WHAT@START+LENGTH` as what, start and end; without a window: from 0, for ever."""
    what, at, when = text.partition("@")
    if not at:
        return what, 0.0, None
    start, plus, length = when.partition("+")
    begin = seconds(start)
    return what, begin, begin + seconds(length) if plus else None


def rules_of(
    latency: str = "",
    jitter: str = "",
    loss: str = "",
    burst: str = "",
    partition: tuple[str, ...] = (),
    duplicate: str = "",
    corrupt: str = "",
) -> list[dict[str, Any]]:
    """`[[fault]]` tables for shorthands; raises ValueError, naming the option."""
    out: list[dict[str, Any]] = []
    if latency or jitter:
        base = _parsed("--latency", seconds, latency or "0")
        out.append(
            {
                "kind": "latency",
                "base_s": base,
                "jitter_s": _parsed("--jitter", seconds, jitter or "0"),
            }
        )
    if loss and burst:
        ticks = _parsed("--burst", float, burst)
        out.append(
            {"kind": "burst", "loss": _parsed("--loss", fraction, loss), "mean_ticks": ticks}
        )
    elif loss:
        out.append({"kind": "loss", "probability": _parsed("--loss", fraction, loss)})
    elif burst:
        raise ValueError("--burst: needs --loss, the mean loss that its bursts make up")
    for text in partition:
        groups, start, end = _parsed("--partition", window, text)
        rule: dict[str, Any] = {"kind": "partition", "groups": groups, "start_s": start}
        out.append(rule if end is None else {**rule, "end_s": end})
    for name, text in (("duplicate", duplicate), ("corrupt", corrupt)):
        if text:
            out.append({"kind": name, "probability": _parsed(f"--{name}", fraction, text)})
    return out


def _parsed(option: str, parse: Any, text: str) -> Any:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from error
