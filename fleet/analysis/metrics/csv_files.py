"""The metrics of a run as CSV files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from fleet.analysis.metrics.results import RunMetrics
from fleet.errors import LogError


def write_csv(run: RunMetrics, folder: Path, *, overwrite: bool) -> None:
    """One file a table in this folder; raises LogError if one cannot be written."""
    columns = run.columns()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise LogError(f"{folder} is a file; name a folder") from error
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror}") from error
    for name, rows in run.tables().items():
        path = folder / f"{name}.csv"
        try:
            with path.open("w" if overwrite else "x", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, columns[name])
                writer.writeheader()
                writer.writerows({k: _cell(v) for k, v in row.items()} for row in rows)
        except FileExistsError as error:
            raise LogError(
                f"{path} exists already, not overwriting; use --force or another folder"
            ) from error
        except OSError as error:
            raise LogError(f"cannot write {path}: {error.strerror}") from error


def _cell(value: Any) -> Any:
    """A value as `fleet export --csv` has it, too."""
    return str(value).lower() if isinstance(value, bool) else value
