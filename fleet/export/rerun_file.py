"""A native recording for rerun: the same scene, series and lines, on the timeline `sim_time`.

Positions are east, north, up (ENU) in m. rerun is an extra of this package: it is loaded here and
nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from fleet.analysis.palette import rgb_of
from fleet.errors import LogError
from fleet.export.lines import Line, LineLevel
from fleet.export.rerun_layout import blueprint
from fleet.export.scene import AHEAD_S, TRAIL_NS, Scene, Times, Track, every
from fleet.extras import import_extra
from fleet.model.types import Array
from fleet.model.units import NS_PER_S, to_ns, to_s
from fleet.model.words import AS_PLANNED, AVOIDING, Mode

TIMELINE = "sim_time"
RECORDING_STEP_NS = to_ns(0.1)
"""Positions and series are written at most so often."""
TRAIL_STEP_NS = to_ns(1.0)
CALM, LOST, FLOWN, ROUTE = 130, 255, 120, 60
"""Opacities, to 255: of a zone, of one that another overlaps, of the whole track, of routes."""
GREY = (150, 150, 150)
LEVELS = {LineLevel.INFO: "INFO", LineLevel.WARNING: "WARN", LineLevel.ERROR: "ERROR"}


def write_rerun(path: Path, scene: Scene, lines: Sequence[Line]) -> None:
    """Write the recording; raises MissingExtraError without rerun, LogError if it cannot."""
    rr = import_extra("rerun", "rerun")
    recording = rr.RecordingStream(f"fleet {scene.scenario.name}")
    try:
        recording.save(path, default_blueprint=blueprint(scene, TIMELINE))
    except RuntimeError as error:
        raise LogError(f"cannot write {path}: {error}") from error
    _Recording(rr, recording, scene).add(lines)
    recording.flush()
    recording.disconnect()


class _Recording:
    """Adds what a scene has to a recording."""

    def __init__(self, rr: Any, recording: Any, scene: Scene) -> None:
        self._rr = rr
        self._recording = recording
        self._scene = scene

    def add(self, lines: Sequence[Line]) -> None:
        """All of it."""
        self._static("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for track in self._scene.tracks:
            self._flight(track)
            self._zone(track)
            self._label_and_command(track)
            self._trail(track)
            self._commanded(track)
            self._gone(track)
        self._separations()
        for line in lines:
            text = self._rr.TextLog(f"{line.who}: {line.text}", level=LEVELS[line.level])
            self._at(line.t_ns, f"log/{line.who.replace(' ', '-')}", text)

    def _flight(self, track: Track) -> None:
        """Route and whole track, faint, and where the UAV is."""
        rr, name = self._rr, track.uav
        paint = rgb_of(track.index)
        route = self._scene.routes_enu_m[name]
        faint = rr.LineStrips3D([route], colors=[(*paint, ROUTE)], radii=rr.Radius.ui_points(0.7))
        self._static(f"world/routes/{name}", faint)
        flown = track.position_enu_m[every(track.t_ns, TRAIL_STEP_NS)]
        line = rr.LineStrips3D([flown], colors=[(*paint, FLOWN)], radii=rr.Radius.ui_points(1.0))
        self._static(f"world/tracks/{name}", line)
        rows = every(track.t_ns, RECORDING_STEP_NS)
        places = rr.Transform3D.columns(translation=track.position_enu_m[rows])
        self._columns(f"world/uav/{name}", track.t_ns[rows], places)

    def _zone(self, track: Track) -> None:
        """The protected cylinder, more opaque while another zone overlaps it."""
        rr, zone = self._rr, self._scene.scenario.zone_of(track.uav)
        cylinder = rr.Cylinders3D(
            lengths=[2.0 * zone.half_height_m],
            radii=[zone.radius_m],
            fill_mode="transparentfillmajorwireframe",
            line_radii=rr.Radius.ui_points(1.0),
        )
        entity = f"world/uav/{track.uav}/zone"
        self._static(entity, cylinder)
        lost = self._scene.lost()
        over = [track.uav in lost.get(t_ns, ()) for t_ns in track.t_ns.tolist()]
        dead = [mode == Mode.UNMANNED for mode in track.modes]
        for row in _changes(list(zip(over, dead, strict=True))):
            colour = GREY if dead[row] else rgb_of(track.index)
            paint = (*colour, LOST if over[row] else CALM)
            self._at(int(track.t_ns[row]), entity, rr.Cylinders3D.from_fields(colors=[paint]))

    def _label_and_command(self, track: Track) -> None:
        """Number and mode, and while a command is flown the arrow of where it leads."""
        rr, paint = self._rr, rgb_of(track.index)
        for row in _changes(track.modes):
            mode = track.modes[row]
            text = f"{track.uav}" if mode in AS_PLANNED else f"{track.uav} {mode}"
            point = rr.Points3D(
                [(0.0, 0.0, 0.0)], radii=rr.Radius.ui_points(4.0), colors=[paint], labels=[text]
            )
            self._at(int(track.t_ns[row]), f"world/uav/{track.uav}/here", point)
        for row in _changes(track.commands):
            intents = [AHEAD_S * track.intent_enu_mps(row)] if track.modes[row] in AVOIDING else []
            arrow = rr.Arrows3D(vectors=intents, colors=[paint], radii=rr.Radius.ui_points(2.5))
            self._at(int(track.t_ns[row]), f"world/uav/{track.uav}/command", arrow)

    def _trail(self, track: Track) -> None:
        """The last minute, bright."""
        rr, rows = self._rr, every(track.t_ns, TRAIL_STEP_NS)
        points, entity = track.position_enu_m[rows], f"world/trails/{track.uav}"
        paint = rr.LineStrips3D.from_fields(
            colors=[rgb_of(track.index)], radii=rr.Radius.ui_points(3.0)
        )
        self._static(entity, paint)
        times = track.t_ns[rows]
        begins = np.searchsorted(times, times - TRAIL_NS, "right").tolist()
        strips = [points[begin : n + 1] for n, begin in enumerate(begins)]
        self._columns(entity, times, rr.LineStrips3D.columns(strips=strips))

    def _gone(self, track: Track) -> None:
        """A viewer shows the last that it was told: a UAV that vanishes is taken away."""
        for t_ns in self._scene.t_ns[self._scene.t_ns > track.t_ns.max(initial=0)][:1].tolist():
            for entity in ("uav", "trails"):
                path = f"world/{entity}/{track.uav}"
                self._at(t_ns, path, self._rr.Clear(recursive=True))

    def _commanded(self, track: Track) -> None:
        """What the flight controller aims at; headings unwrapped, so that no line jumps."""
        rows = every(track.t_ns, RECORDING_STEP_NS)
        heading = np.degrees(np.unwrap(track.commanded_heading_rad[rows]))
        name, paint = f"UAV {track.uav}", rgb_of(track.index)
        times = track.t_ns[rows]
        self._series(f"commanded/heading/{track.uav}", times, heading, name, paint)
        climb = track.commanded_climb_mps[rows]
        self._series(f"commanded/climb/{track.uav}", times, climb, name, paint)

    def _separations(self) -> None:
        """Each pair, and the value that is required."""
        for rank, pair in enumerate(self._scene.pairs):
            rows = np.union1d(every(pair.t_ns, RECORDING_STEP_NS), [pair.nearest])
            name = f"{pair.minimum.a}-{pair.minimum.b}"
            paint = rgb_of(rank)
            self._series(f"separation/{name}", pair.t_ns[rows], pair.normalised[rows], name, paint)
        ends = self._scene.t_ns[[0, -1]] if len(self._scene.t_ns) else self._scene.t_ns
        self._series("separation/required", ends, np.ones(len(ends)), "required", GREY, 3.0)

    def _series(
        self,
        entity: str,
        t_ns: Times,
        values: Array,
        name: str,
        paint: tuple[int, int, int],
        width: float = 1.5,
    ) -> None:
        rr = self._rr
        self._static(entity, rr.SeriesLines(colors=[paint], names=[name], widths=[width]))
        self._columns(entity, t_ns, rr.Scalars.columns(scalars=values))

    def _static(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what, static=True)

    def _at(self, t_ns: int, entity: str, what: Any) -> None:
        self._recording.set_time(TIMELINE, duration=to_s(t_ns))
        self._recording.log(entity, what)

    def _columns(self, entity: str, t_ns: Times, columns: Any) -> None:
        times = self._rr.TimeColumn(TIMELINE, duration=t_ns / NS_PER_S)
        self._recording.send_columns(entity, indexes=[times], columns=columns)


def _changes(values: Sequence[object]) -> list[int]:
    """The first row of each run of equal values."""
    return [next(run)[0] for _, run in groupby(enumerate(values), key=lambda item: item[1])]
