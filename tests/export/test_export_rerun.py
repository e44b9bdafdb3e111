"""The recording for rerun, and the page that shows it; without the library these are skipped."""

from __future__ import annotations

import subprocess
import threading
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.config.loading import read_scenario
from fleet.errors import LogError
from fleet.export import rerun_view
from fleet.export.lines import lines_of
from fleet.export.rerun_file import write_rerun
from fleet.export.rerun_view import POLICY, page
from fleet.export.scene import Scene, scene_of
from tests.conftest import fly

rerun = pytest.importorskip("rerun")


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Two UAVs that avoid each other."""
    settings = ("duration_s=60", "tick_s=0.2")
    return scene_of(read_scenario("head_on", settings).scenario, fly("head_on", *settings).kept)


@pytest.fixture(scope="module")
def recording(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its recording."""
    path = tmp_path_factory.mktemp("rerun") / "head_on.rrd"
    kept = fly("head_on", "duration_s=60", "tick_s=0.2").kept
    write_rerun(path, scene, lines_of(kept, (), scene))
    return path


def chunks(recording: Path) -> dict[str, list[Any]]:
    """The chunks of a recording by entity."""
    reader: Any = pytest.importorskip("rerun.chunk").RrdReader(recording)
    found: dict[str, list[Any]] = {}
    for chunk in reader.stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk)
    return found


def test_everything_is_in_the_recording(recording: Path) -> None:
    entities = set(chunks(recording))
    for number in (1, 2):
        parts = {"", "/zone", "/here", "/command"}
        assert {f"/world/uav/{number}{part}" for part in parts} <= entities
        assert f"/world/trails/{number}" in entities
        assert f"/commanded/heading/{number}" in entities
    assert {"/separation/1-2", "/separation/required", "/log/UAV-1"} <= entities


def test_separations_are_those_of_the_scene(scene: Scene, recording: Path) -> None:
    values = [
        value
        for chunk in chunks(recording)["/separation/1-2"]
        if not chunk.is_static
        for value in chunk.to_record_batch().column("Scalars:scalars").to_pylist()
    ]
    assert np.ravel(values) == pytest.approx(scene.pairs[0].normalised)


def test_what_vanishes_is_taken_away(tmp_path: Path) -> None:
    settings = ("duration_s=20", "tick_s=0.2")
    kept = [m for m in fly("head_on", *settings).kept if m.id != 2 or m.t_ns < 10e9]
    path = tmp_path / "vanished.rrd"
    write_rerun(path, scene_of(read_scenario("head_on", settings).scenario, kept), [])
    cleared = {
        entity: chunk.to_record_batch().column("sim_time").to_pylist()
        for entity, found in chunks(path).items()
        for chunk in found
        if "Clear:is_recursive" in chunk.to_record_batch().schema.names
    }
    assert set(cleared) == {"/world/uav/2", "/world/trails/2"}
    assert {t.total_seconds() for times in cleared.values() for t in times} == {10.0}


def test_a_page_is_for_this_machine_alone_and_reaches_nothing_else(recording: Path) -> None:
    with page(recording, 0) as (address, server):
        assert address.startswith("http://127.0.0.1:")
        assert server.server_address[0] == "127.0.0.1"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            base = address.partition("?")[0]
            with urllib.request.urlopen(address, timeout=30) as reply:
                shown = reply.read()
                assert reply.headers["Content-Security-Policy"] == POLICY
            assert b"re_viewer" in shown
            assert b'href="https://' not in shown
            with urllib.request.urlopen(f"{base}recording.rrd", timeout=30) as reply:
                assert reply.read() == recording.read_bytes()
            with pytest.raises(urllib.error.HTTPError):
                urllib.request.urlopen(f"{base}nothing", timeout=30)
        finally:
            server.shutdown()
            thread.join()


def test_a_port_that_is_taken_is_said_in_words(recording: Path) -> None:
    taken = pytest.raises(LogError, match="use another --port")
    with page(recording, 0) as (_, server), taken, page(recording, server.server_port):
        pass


def test_the_window_is_bound_to_loopback(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {}

    class Done:
        returncode = 0

    def ran(command: list[str], **options: Any) -> Done:
        seen.update(options, command=command)
        return Done()

    monkeypatch.setattr(subprocess, "run", ran)
    assert rerun_view.open_window(recording) == 0
    place = seen["command"].index("--bind")
    assert seen["command"][place + 1] == "127.0.0.1"
    assert seen["env"]["CI"] == "true"  # rerun then does not report its use
