"""Equipment: what a UAV can do beside flying its plan.

| equipment    | broadcasts | hears and obeys | computes |
|--------------|------------|-----------------|----------|
| `full`       | yes        | yes             | yes      |
| `no_compute` | yes        | yes             | no       |
| `deaf`       | yes        | no              | no       |
| `mute`       | no         | yes             | no       |
| `none`       | no         | no              | no       |

A word that is none of these, as a stranger may broadcast, is taken for the least.
"""

from __future__ import annotations

from typing import Literal

Equipment = Literal["full", "no_compute", "deaf", "mute", "none"]

FULL = "full"


def broadcasts(equipment: str) -> bool:
    """Whether others know of it."""
    return equipment in ("full", "no_compute", "deaf")


def hears(equipment: str) -> bool:
    """Whether it hears anything, and so obeys."""
    return equipment in ("full", "no_compute", "mute")


def computes(equipment: str) -> bool:
    """Whether it can lead a group: that takes hearing and being heard as well."""
    return equipment == FULL
