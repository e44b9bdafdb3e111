"""Runs on this machine: a small file for each, so that `fleet fault RUN` finds its endpoint."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from msgspec import Struct


class ActiveRun(Struct, frozen=True):
    """One run: its name, where its router listens, what it flies, where certificates are.

    `zenoh_config` is the file of zenoh's own configuration.
    """

    run: str
    endpoint: str
    scenario: str
    secure: str = ""
    zenoh_config: str = ""


def _folder() -> Path:
    base = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(base) / f"fleet-{os.getuid()}"


@contextmanager
def advertised(run: ActiveRun) -> Iterator[None]:
    """List a run for as long as the context lasts; a machine without room for it does without."""
    path = _folder() / f"{run.run}.json"
    with suppress(OSError):
        _folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        entry = {"endpoint": run.endpoint, "scenario": run.scenario, "pid": os.getpid()}
        places = {"secure": run.secure, "zenoh_config": run.zenoh_config}
        entry |= {name: str(Path(place).absolute()) for name, place in places.items() if place}
        path.write_text(json.dumps(entry), encoding="utf-8")
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def active_runs() -> list[ActiveRun]:
    """Runs that are on, in order of name; what a killed simulation left behind is removed."""
    found = []
    for path in sorted(_folder().glob("*.json")):
        with suppress(OSError, ValueError, KeyError):
            entry = json.loads(path.read_text(encoding="utf-8"))
            if _alive(int(entry["pid"])):
                places = entry.get("secure", ""), entry.get("zenoh_config", "")
                found.append(ActiveRun(path.stem, entry["endpoint"], entry["scenario"], *places))
            else:
                path.unlink(missing_ok=True)
    return found


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
