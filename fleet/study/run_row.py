"""What a study keeps of a run: one row of its results."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


def _column(description: str) -> Meta:
    return Meta(description=description)


class RunRow(Struct, frozen=True, kw_only=True):
    """One run. What could not be flown has its `error`, and no outcome.

    Counts of pairs are of those that lost separation (nearer than both distances that two protected
    zones require): `induced` only with avoidance, `unresolved` with and without, `resolved` only
    without.
    """

    cell: Annotated[int, _column("number of the cell")]
    run: Annotated[int, _column("number of the run in its cell, and so of its encounter")]
    seed: Annotated[int, _column("seed of its fault draws")]
    weight: Annotated[float, _column("how much more often it occurs than it is drawn")] = 1.0
    error: Annotated[str, _column("why it could not be flown; empty if it was")] = ""
    digest: Annotated[str, _column("of all its messages, as `fleet run` has it")] = ""
    uavs: Annotated[int, _column("number of UAVs")] = 0
    lost: Annotated[bool | None, _column("whether any pair lost separation")] = None
    nmac: Annotated[bool | None, _column("whether any pair came into the NMAC volume")] = None
    lost_without: Annotated[bool | None, _column("whether any would have, without avoidance")] = (
        None
    )
    nmac_without: Annotated[bool | None, _column("the same of the NMAC volume")] = None
    least_separation: Annotated[
        float | None, _column("least normalised separation of any pair; lost below 1")
    ] = None
    least_without: Annotated[float | None, _column("the same without avoidance")] = None
    horizontal_m: Annotated[float | None, _column("distance at the least separation, in m")] = None
    vertical_m: Annotated[float | None, _column("the same vertically, in m")] = None
    least_s: Annotated[float | None, _column("when that was, in s")] = None
    pairs_lost: Annotated[int | None, _column("pairs that lost separation")] = None
    pairs_lost_without: Annotated[int | None, _column("the same without avoidance")] = None
    pairs_induced: Annotated[int | None, _column("pairs lost only with avoidance")] = None
    pairs_unresolved: Annotated[int | None, _column("pairs lost with avoidance and without")] = None
    pairs_resolved: Annotated[int | None, _column("pairs lost only without avoidance")] = None
    due: Annotated[int | None, _column("UAVs that would have arrived by plan, within the run")] = (
        None
    )
    not_arrived: Annotated[int | None, _column("of these, those that did not")] = None
    delay_mean_s: Annotated[
        float | None, _column("mean delay of arrival against the plan, in s")
    ] = None
    delay_max_s: Annotated[float | None, _column("the greatest, in s")] = None
    path_deviation_max_m: Annotated[
        float | None, _column("greatest horizontal distance of any UAV from its planned path, in m")
    ] = None
    commands: Annotated[int | None, _column("commands given, repetitions not counted")] = None
    transmissions: Annotated[int | None, _column("commands sent, with repetitions")] = None
    command_latency_s: Annotated[
        float | None, _column("mean time from a command's first sending to its taking effect, in s")
    ] = None
    elections: Annotated[int | None, _column("terms that were used")] = None
    foreseen_losses: Annotated[
        int | None, _column("terms and UAVs for which no candidate was good enough")
    ] = None
    messages: Annotated[int | None, _column("messages sent, of all classes but the record's")] = (
        None
    )


OUTCOMES = tuple(name for name in RunRow.__struct_fields__ if name not in ("cell", "run", "seed"))
