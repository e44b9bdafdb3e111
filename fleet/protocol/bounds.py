"""Types of the fields of messages, with the bounds that a decoder checks."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

Coordinate = Annotated[float, Meta(ge=-1e7, le=1e7)]
Speed = Annotated[float, Meta(ge=-1e3, le=1e3)]
Airspeed = Annotated[float, Meta(ge=1.0, le=1e3)]
Angle = Annotated[float, Meta(ge=-7.0, le=7.0)]
Seconds = Annotated[float, Meta(ge=-1.0, le=1e6)]
SeparationValue = Annotated[float, Meta(ge=0.0, le=1e6)]
Cost = Annotated[float, Meta(ge=-1e12, le=1e12)]
TimeNs = Annotated[int, Meta(ge=0, le=2**63 - 1)]
DifferenceNs = Annotated[int, Meta(ge=-(2**62), le=2**62)]
"""A time by one clock less one by another."""
TickNumber = Annotated[int, Meta(ge=-1, le=2**53)]
Count = Annotated[int, Meta(ge=0, lt=2**53)]
NedVector = tuple[Coordinate, Coordinate, Coordinate]
HeardTerm = Annotated[int, Meta(ge=0, le=2**52)]
"""Leaves room to go on above it."""
Name = Annotated[str, Meta(max_length=64)]
