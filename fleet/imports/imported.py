"""What is made of a file of another program, whatever its format: UAVs, and remarks."""

from __future__ import annotations

from dataclasses import dataclass, field

from fleet.config.scenario import Origin, Point, Zone

SLOWEST_MPS = 1.0
"""A UAV flies faster; what does not is left out."""


@dataclass(frozen=True, slots=True)
class ImportRemark:
    """What could not be taken over as it is: the line (0: the whole file), of what, and why."""

    line: int
    subject: str
    why: str

    def text(self, source: str) -> str:
        """As it is told: `file: line 3: HDG: why`."""
        where = f"line {self.line}: " if self.line else ""
        return f"{source}: {where}{self.subject}: {self.why}"


@dataclass(frozen=True, slots=True)
class ImportedUav:
    """One aircraft as a UAV: how it starts and what it flies, in NED and SI units.

    `heading_deg` is that of the frame, `speed_mps` the speed along the path. `climb_mps` is its
    vertical speed at the start, `guidance_climb_mps` that with which it changes its altitude; None:
    as the fleet. `max_bank_deg` is its bank limit, None: as the fleet.
    """

    name: str
    line: int
    position_ned_m: Point
    heading_deg: float
    speed_mps: float
    waypoints_ned_m: tuple[Point, ...]
    climb_mps: float = 0.0
    guidance_climb_mps: float | None = None
    max_bank_deg: float | None = None


@dataclass(frozen=True, slots=True)
class ForeignSettings:
    """What the files of a program mean where they do not say it, and a scenario needs."""

    zone: Zone
    horizon_s: float
    max_bank_deg: float


@dataclass(slots=True)
class ForeignTraffic:
    """What a reader finds in a file; it adds its remarks as it goes.

    `corner_m` is how near to a corner a flight should come, if it can turn so tightly.
    """

    program: str
    settings: ForeignSettings
    origin: Origin
    uavs: list[ImportedUav] = field(default_factory=list)
    remarks: list[ImportRemark] = field(default_factory=list)
    duration_s: float = 0.0
    corner_m: float = 100.0

    def remark(self, line: int, subject: str, why: str) -> None:
        """Say what could not be taken over."""
        self.remarks.append(ImportRemark(line, subject, why))
