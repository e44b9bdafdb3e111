"""Who hears a class of messages, and who issues it: what each class declares."""

from __future__ import annotations

from enum import StrEnum


class Audience(StrEnum):
    """Who hears a class of messages; the recorder hears everything."""

    ALL = "all"
    """All others, the coordinator too."""
    UAVS = "uavs"
    """All other UAVs."""
    TARGET = "target"
    """The UAV that it names, which may be the issuer itself."""
    RECORDER = "recorder"
    """Nobody else."""


class Issuers(StrEnum):
    """Who issues a class of messages."""

    ANY = "any"
    """UAVs and the coordinator."""
    UAVS = "uavs"
    COORDINATOR = "coordinator"
