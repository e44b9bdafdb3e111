"""The results of a study: a folder with the study, versions, and one row a run as Parquet.

`runs.parquet` has all that is known when a study ends. Until then each batch is a file in `parts/`,
written whole or not at all, so that whatever ends a study costs it the batches on the way alone.
"""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec

from fleet.errors import FailedError, StudyError
from fleet.extras import import_extra
from fleet.study.batches import StudyRuns
from fleet.study.design import Cell, cells_of
from fleet.study.run_row import RunRow
from fleet.study.study_file import Study
from fleet.version import __version__

STUDY, VERSIONS, RUNS, PARTS = "study.json", "versions.json", "runs.parquet", "parts"
FACTOR = "factor."
"""How the column of a factor is named: its numbers, or its labels where one has none."""


class ResultsFolder:
    """Results on disk, of a study that is on or has ended."""

    def __init__(self, folder: Path, study: Study) -> None:
        """Of the results that are there, or will be; `create` or `open_results` makes one."""
        self.folder, self.study = folder, study
        self.cells = cells_of(study)
        self._pa = import_extra("pyarrow", "study", "a study")
        self._parquet = import_extra("pyarrow.parquet", "study", "a study")
        self._schema = self._pa.schema([*_factor_fields(self._pa, self.cells), *_fields(self._pa)])

    def __repr__(self) -> str:
        return f"<results of {self.study.name}: {len(self.cells)} cells in {self.folder}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: losses of separation, a row a cell."""
        return str(import_module("fleet.study.summary_html").summary_html(self))

    @classmethod
    def create(cls, folder: Path, study: Study) -> ResultsFolder:
        """Begin a folder, or go on with that of the same study, which may now have more runs.

        Raises:
            StudyError: the folder has the results of another study, or is something else.
            MissingExtraError: what a study needs is not installed; then there is no folder.

        """
        results = cls(folder, study)
        try:
            if not (folder / STUDY).exists() and folder.is_dir():
                _check_empty(folder)
            (folder / PARTS).mkdir(parents=True, exist_ok=True)
            if (folder / STUDY).exists():
                before = _study_in(folder)
                if _apart_from_size(before) != _apart_from_size(study):
                    raise StudyError(
                        f"{folder} has results of another study, or of another version of it: "
                        "choose another --out, or delete it"
                    )
            write_whole(folder / STUDY, msgspec.json.format(msgspec.json.encode(study)))
            if not (folder / VERSIONS).exists():
                write_whole(folder / VERSIONS, msgspec.json.format(msgspec.json.encode(versions())))
        except OSError as error:
            raise StudyError(f"{folder}: cannot be written: {error.strerror}") from error
        return results

    @contextmanager
    def alone(self) -> Iterator[None]:
        """While rows are added: raises StudyError if another command adds some to this folder."""
        try:
            place = os.open(self.folder / PARTS, os.O_RDONLY)
        except OSError as error:
            raise StudyError(f"{self.folder / PARTS}: cannot be read: {error.strerror}") from error
        try:
            fcntl.flock(place, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as error:
            os.close(place)
            raise StudyError(
                f"{self.folder} is being flown by another command: wait for it, or choose another "
                "--out"
            ) from error
        except OSError:  # some file systems have no locks
            pass
        try:
            yield
        finally:
            os.close(place)

    @property
    def begun_with(self) -> dict[str, str]:
        """The versions with which the study was begun."""
        try:
            return msgspec.json.decode((self.folder / VERSIONS).read_bytes(), type=dict[str, str])
        except (OSError, msgspec.MsgspecError) as error:
            raise StudyError(
                f"{self.folder / VERSIONS}: cannot be read: {error}; delete it, and run the study "
                "again: nothing else is lost"
            ) from error

    def known(self) -> StudyRuns:
        """The runs of which there are rows."""
        table = self.table(["cell", "run"])
        return set(zip(table["cell"].to_pylist(), table["run"].to_pylist(), strict=True))

    def add(self, rows: Sequence[RunRow]) -> None:
        """Keep the rows of a batch; raises FailedError if they cannot be written."""
        first = rows[0]
        path = self.folder / PARTS / f"{first.run:08d}-{first.cell:06d}.parquet"
        self._write_table(self._table_of(rows), path)

    def table(self, columns: Sequence[str] | None = None) -> Any:
        """All rows as a pyarrow table, by cell and run; raises StudyError if they are damaged."""
        chosen = None if columns is None else list(dict.fromkeys(["cell", "run", *columns]))
        paths = [self.folder / RUNS, *sorted((self.folder / PARTS).glob("*.parquet"))]
        tables = [self._read(path, chosen) for path in paths if path.exists()]
        if not tables:
            empty = self._schema.empty_table()
            return empty if chosen is None else empty.select(chosen)
        found = self._pa.concat_tables(tables).combine_chunks()
        return _once(found.sort_by([("cell", "ascending"), ("run", "ascending")]))

    def close(self) -> Path:
        """Put all rows into one file, which is returned."""
        self._write_table(self.table(), self.folder / RUNS)
        for path in (self.folder / PARTS).glob("*.parquet"):
            path.unlink()
        return self.folder / RUNS

    def _table_of(self, rows: Iterable[RunRow]) -> Any:
        columns: dict[str, list[Any]] = {name: [] for name in self._schema.names}
        factors = [name for name in self._schema.names if name.startswith(FACTOR)]
        for row in rows:
            levels = self.cells[row.cell].levels
            for name, level in zip(factors, levels, strict=True):
                numeric = self._schema.field(name).type == self._pa.float64()
                columns[name].append(level.number if numeric else level.label)
            for name in RunRow.__struct_fields__:
                columns[name].append(getattr(row, name))
        return self._pa.table(columns, schema=self._schema)

    def _write_table(self, table: Any, path: Path) -> None:
        beside = path.with_suffix(".new")
        try:
            self._parquet.write_table(table, beside, compression="zstd")
            beside.replace(path)
        except OSError as error:
            beside.unlink(missing_ok=True)
            raise FailedError(
                f"{path}: cannot be written: {error.strerror or error}; make room, and run the "
                "same command again to go on"
            ) from error

    def _read(self, path: Path, columns: list[str] | None) -> Any:
        try:
            there = self._parquet.read_schema(path).names
            found = self._parquet.read_table(path, columns=columns, schema=self._schema)
        except (OSError, self._pa.ArrowException) as error:
            raise StudyError(
                f"{path} cannot be read ({type(error).__name__}): delete it, and run it again"
            ) from error
        missing = [name for name in self._schema.names if name not in there]
        cells = [] if missing else found["cell"].unique().to_pylist()
        if missing or not set(cells) <= set(range(len(self.cells))):
            what = f"no column {missing[0]}" if missing else f"cells that are not of {STUDY}"
            raise StudyError(
                f"{path} has {what}: it is of another study or version; fly it again with another "
                "--out"
            )
        return found


def open_results(folder: Path) -> ResultsFolder:
    """The results in a folder; raises StudyError if it has none."""
    if not (folder / STUDY).is_file():
        raise StudyError(f"{folder} has no results of a study: name the folder that it was told to")
    return ResultsFolder(folder, _study_in(folder))


def versions() -> dict[str, str]:
    """What has flown a study: versions of this package, of Python and of libraries, and where."""
    found = {name: version(name) for name in ("eclipse-zenoh", "numpy", "msgspec")}
    return {
        "zenoh-fleet": __version__,
        "python": platform.python_version(),
        **found,
        "machine": f"{platform.system()} {platform.machine()}",
    }


def _study_in(folder: Path) -> Study:
    try:
        return msgspec.json.decode((folder / STUDY).read_bytes(), type=Study)
    except (OSError, msgspec.MsgspecError) as error:
        raise StudyError(
            f"{folder / STUDY}: cannot be read: {error}; begin again with another --out"
        ) from error


def _check_empty(folder: Path) -> None:
    """Raises StudyError if there are files that no study that was just begun has left."""
    others = sorted(path.name for path in folder.iterdir() if path.stem not in (PARTS, "study"))
    if others:
        raise StudyError(
            f"{folder} has no {STUDY}, but other files ({others[0]}): choose another --out"
        )


def _apart_from_size(study: Study) -> Study:
    """A study without what may change from one command to the next: how many runs are flown."""
    return msgspec.structs.replace(study, runs=1, stop=None, zenoh_share=0.0, description="")


def write_whole(path: Path, text: bytes) -> None:
    """Write a small file so that it is there as before, or whole; raises OSError."""
    beside = path.with_suffix(".new")
    beside.write_bytes(text)
    beside.replace(path)


def _once(table: Any) -> Any:
    """The rows of a sorted table, each run once."""
    cell, run = table["cell"].to_numpy(), table["run"].to_numpy()
    same = (cell[1:] == cell[:-1]) & (run[1:] == run[:-1])
    return table.filter([True, *(~same).tolist()]) if same.any() else table


def _factor_fields(pa: Any, cells: Sequence[Cell]) -> list[Any]:
    names = [level.factor for level in cells[0].levels]
    numeric = [all(cell.levels[n].number is not None for cell in cells) for n in range(len(names))]
    return [
        pa.field(f"{FACTOR}{name}", pa.float64() if number else pa.string())
        for name, number in zip(names, numeric, strict=True)
    ]


def _fields(pa: Any) -> list[Any]:
    types = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), str: pa.string()}
    hints = get_type_hints(RunRow)
    return [pa.field(n, types[_plain(hints[n])]) for n in RunRow.__struct_fields__]


def _plain(hint: Any) -> type:
    """The type of values that are not missing."""
    kind: type = next((k for k in get_args(hint) if k is not type(None)), hint)
    return kind
