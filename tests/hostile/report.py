"""What a fuzzed process leaves behind: how much it took, and what it found."""

from __future__ import annotations

import json
import resource
from pathlib import Path

from tests.hostile.target import Watched

ADDRESS_SPACE = 6 << 30
"""No process of a campaign gets more address space."""


def bound_memory() -> None:
    """From now on what asks for too much fails."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))


def peak_mib() -> int:
    """The most memory that this process has had (VmHWM)."""
    with Path("/proc/self/status").open(encoding="ascii") as status:
        return next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) >> 10


def write(path: Path, watched: Watched) -> None:
    """Write what came of it; inputs that found something are beside it."""
    findings = []
    for n, finding in enumerate(watched.findings.values()):
        for k, data in enumerate(finding.inputs):
            kept = path.with_suffix("") / f"{n}"
            kept.mkdir(parents=True, exist_ok=True)
            (kept / f"{k:03}").write_bytes(data)
        findings.append({"what": finding.what, "where": finding.where, "count": finding.count})
    told = {
        "inputs": watched.inputs,
        "accepted": watched.target.accepted,
        "peak_mib": peak_mib(),
        "findings": findings,
    }
    path.write_text(json.dumps(told, indent=1), encoding="utf-8")
