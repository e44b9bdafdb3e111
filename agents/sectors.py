"""The paper's sectors: where an encounter is first met decides on which axis it is resolved."""

from __future__ import annotations

import math

from fleet.config.scenario import Resolution
from fleet.model.words import Manoeuvre


def sector_of(angle_rad: float, rules: Resolution) -> str:
    """The sector of a collision angle: by default head_on in [-30, 30), right [30, 150) degrees.

    Left is [-150, -30), and all else rear.
    """
    head_on, rear = math.radians(rules.head_on_deg), math.radians(rules.rear_deg)
    if -head_on <= angle_rad < head_on:
        return "head_on"
    if head_on <= angle_rad < rear:
        return "right"
    return "left" if -rear <= angle_rad < -head_on else "rear"


def axis_of(sector: str) -> Manoeuvre:
    """Turns ahead and behind (eq. 10), climbs at the sides (eq. 11)."""
    return Manoeuvre.TURN if sector in ("head_on", "rear") else Manoeuvre.CLIMB
