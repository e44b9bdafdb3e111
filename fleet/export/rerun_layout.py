"""How rerun shows a recording: the scene, and beside it separation, commands and log lines."""

from __future__ import annotations

from typing import Any

from fleet.export.scene import Scene
from fleet.extras import import_extra
from fleet.model.units import to_s

BACKGROUND, GRID = (14, 17, 23), (255, 255, 255, 6)
GRID_M, SPEED = 500.0, 5.0
"""Metres between grid lines on the ground, and playback in times real time."""
SEPARATIONS = (0.0, 6.0)
"""What the plot of normalised separations shows at first."""


def blueprint(scene: Scene, timeline: str) -> Any:
    """The blueprint. It looks at the encounter from the south, and at the whole run in time."""
    rr, rrb = import_extra("rerun", "rerun"), import_extra("rerun.blueprint", "rerun")
    limits = scene.scenario.resolution
    climbs = (-limits.max_dive_mps - 1.0, limits.max_climb_mps + 1.0)
    boundary = rr.TimeRangeBoundary
    whole = rrb.TimeRange(
        start=boundary.absolute(seconds=0.0), end=boundary.absolute(seconds=to_s(scene.end_ns))
    )

    def plot(entity: str, name: str, span: tuple[float, float] | None = None) -> Any:
        return rrb.TimeSeriesView(
            origin=entity,
            name=name,
            axis_x=rrb.TimeAxis(view_range=whole),
            axis_y=rrb.ScalarAxis(range=span) if span else None,
            plot_legend=rrb.PlotLegend("RightTop"),
        )

    plots = rrb.Vertical(
        plot("separation", "Normalised separation: lost below 1", SEPARATIONS),
        plot("commanded/heading", "Commanded heading (deg)"),
        plot("commanded/climb", "Commanded climb (m/s)", climbs),
        row_shares=[4, 3, 3],
    )
    said = rrb.TextLogView(
        origin="log",
        name="Elections, commands, refusals, faults",
        columns=rrb.TextLogColumns(
            timeline_columns=[timeline], text_log_columns=["loglevel", "body"]
        ),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_world(scene, rrb), said, row_shares=[3, 1]),
            plots,
            column_shares=[3, 2],
        ),
        rrb.TimePanel(
            state="collapsed",
            timeline=timeline,
            play_state="playing",
            loop_mode="all",
            playback_speed=SPEED,
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _world(scene: Scene, rrb: Any) -> Any:
    """The 3-D view, its eye where the encounter fills it."""
    (east, north, up), radius_m = scene.focus()
    eye = rrb.EyeControls3D(
        position=(east - 0.9 * radius_m, north - 1.6 * radius_m, up + 1.2 * radius_m),
        look_target=(east, north, up),
        eye_up=(0.0, 0.0, 1.0),
    )
    return rrb.Spatial3DView(
        origin="world",
        name="Scene: x east, y north, z up (m)",
        eye_controls=eye,
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(spacing=GRID_M, color=GRID),
    )
