"""A run that moves in a notebook: the plan view of the live page, with all that it needs inside."""

from __future__ import annotations

import html
import json
from importlib.resources import files
from typing import Any

from fleet.analysis.recorded_run import RecordedRun
from fleet.live.log_source import LogSource
from fleet.live.source import Change
from fleet.live.view import LiveView

MOST_FRAMES = 400
HEIGHT_PX = 520


class Animation:
    """A page of its own as HTML; a notebook shows it in a frame."""

    def __init__(self, page: str) -> None:
        self.html = page

    def _repr_html_(self) -> str:
        """What Jupyter and marimo show."""
        source = html.escape(self.html, quote=True)
        look = f'width="100%" height="{HEIGHT_PX}" style="border:0"'
        return f'<iframe srcdoc="{source}" {look}></iframe>'


def animated(run: RecordedRun, speed: float) -> Animation:
    """The plan view of a run over all of its time, at so many times real time."""
    source, view = LogSource(run, run.scenario.name), LiveView(run.scenario, recorded=True)
    step_s = max(run.scenario.surveillance.broadcast_s, source.end_s / MOST_FRAMES)
    views: list[dict[str, Any]] = []
    for n in range(int(source.end_s / step_s) + 1):
        source.change(Change(to_s=n * step_s, paused=True))
        frame = source.frame(0)
        if frame is not None:
            shown = view.take(frame)
            kept = {name: shown[name] for name in ("t_s", "uavs", "pairs")}
            views.append({**kept, "paths": {}})
    about = view.about(title=run.scenario.name, read_only=True)
    data = json.dumps({"about": about, "views": views}, separators=(",", ":"))
    page = _static("animation.html").replace("__STEP_MS__", str(round(1000 * step_s / speed)))
    page = page.replace("__PLAN__", _static("plan.js"))
    return Animation(page.replace("__DATA__", data.replace("<", "\\u003c")))


def _static(name: str) -> str:
    return files("fleet.live").joinpath("static", name).read_text(encoding="utf-8")
