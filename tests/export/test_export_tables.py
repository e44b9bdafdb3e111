"""CSV and Parquet: every class, every field, every message."""

from __future__ import annotations

import csv
import json
from collections import Counter
from pathlib import Path

import msgspec
import pytest

import fleet.log
from fleet.analysis.recorded_run import RecordedRun
from fleet.config.loading import read_scenario
from fleet.export.columns import rows_of, table_columns
from fleet.export.tables import Csv, Parquet, write_tables
from fleet.protocol.classes import LOGGED_CLASSES
from fleet.protocol.codec import decode, kind_of
from fleet.protocol.messages import Conflict, Decision, DeliveryReport
from fleet.simulation.simulation import RunOptions, run_fleet

Rows = list[dict[str, str]]


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with commands, and messages lost."""
    settings = ["duration_s=60", "tick_s=0.2"]
    scenario = read_scenario("head_on", settings).scenario
    path = tmp_path_factory.mktemp("log") / "head_on.mcap"
    assert (
        run_fleet(RunOptions(scenario, bus="memory", out=path), lambda _: None).status == "complete"
    )
    return path


@pytest.fixture(scope="module")
def recorded_run(logged: Path) -> RecordedRun:
    return RecordedRun.of_log(logged)


@pytest.fixture(scope="module")
def folder(logged: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its tables as CSV."""
    path = tmp_path_factory.mktemp("csv")
    write_tables(path, fleet.log.open(logged).messages(), Csv)
    return path


def table(folder: Path, kind: str) -> Rows:
    with (folder / f"{kind}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_there_is_a_table_for_each_class_and_none_else(folder: Path) -> None:
    kinds = {cls.kind for cls in LOGGED_CLASSES}
    assert {path.name for path in folder.iterdir()} == {f"{kind}.csv" for kind in kinds}
    header = "log_ns,log_s,id,seq,t_ns,t_s,late_ns,late_s\n"
    assert (folder / "late.csv").read_text(encoding="utf-8") == header


@pytest.mark.parametrize("cls", LOGGED_CLASSES, ids=lambda cls: cls.__name__)
def test_every_field_has_columns(cls: type[msgspec.Struct]) -> None:
    names = [column.name for column in table_columns(cls)]
    assert len(set(names)) == len(names)
    for field in msgspec.structs.fields(cls):
        stem = field.name.partition("_ned_")[0]
        if field.name != "encounters":  # its own fields stand for it
            assert any(name.startswith(stem) for name in names), field.name
        if field.name.endswith("_ns"):
            place = names.index(field.name)
            assert names[place + 1] == f"{field.name.removesuffix('_ns')}_s"


def test_every_message_is_there(recorded_run: RecordedRun, folder: Path) -> None:
    counts = Counter(kind_of(record.topic) for record in recorded_run.records)
    for cls in LOGGED_CLASSES:
        if cls not in (Conflict, Decision, DeliveryReport):
            assert len(table(folder, cls.kind)) == counts[cls.kind]
    entries = sum(
        max(1, len(message.src))
        for record in recorded_run.records
        if kind_of(record.topic) == "delivery"
        and isinstance(message := decode(record.topic, record.payload), DeliveryReport)
    )
    assert len(table(folder, "delivery")) == entries


def test_values_are_those_of_the_messages(recorded_run: RecordedRun, folder: Path) -> None:
    records = [r for r in recorded_run.records if kind_of(r.topic) == "truth"]
    for record, row in zip(records, table(folder, "truth"), strict=True):
        message = msgspec.to_builtins(decode(record.topic, record.payload))
        north, east, down = message["position_ned_m"]
        assert float(row["position_north_m"]) == north
        assert float(row["position_east_m"]) == east
        assert float(row["position_down_m"]) == down
        assert int(row["t_ns"]) == message["t_ns"]
        assert float(row["t_s"]) == message["t_ns"] / 1e9
        assert int(row["log_ns"]) == record.log_ns
        assert row["mode"] == message["mode"]


def test_lists_are_rows_or_json(folder: Path) -> None:
    assert json.loads(table(folder, "election")[0]["members"]) == [1, 2]
    assert table(folder, "decision")[0]["target"] == "2"
    assert {row["entry"] for row in table(folder, "delivery")} >= {"0", "1"}
    assert {row["arrived"] for row in table(folder, "adsb")} == {"false"}


def test_a_message_without_entries_has_one_row() -> None:
    columns = table_columns(Conflict)
    (row,) = rows_of(Conflict(0, 3, 10, (), (), ()), columns)
    assert dict(zip([c.name for c in columns], row, strict=True)) == {
        "entry": None,
        "id": 0,
        "seq": 3,
        "t_ns": 10,
        "t_s": 1e-8,
        "pairs_0": None,
        "pairs_1": None,
        "time_to_violation_s": None,
        "leaderless": None,
    }


def test_what_was_not_measured_is_empty() -> None:
    columns = table_columns(DeliveryReport)
    delivery = DeliveryReport(
        1, 0, 0, (2, 3), ("adsb",) * 2, (0, 1), (0, 0), (5, 6), ("received",) * 2
    )
    names = [column.name for column in columns]
    rows = [dict(zip(names, row, strict=True)) for row in rows_of(delivery, columns)]
    assert [(r["entry"], r["src"], r["delivered_ns"], r["transit_ns"]) for r in rows] == [
        (0, 2, 5, None),
        (1, 3, 6, None),
    ]


def test_parquet_has_the_same(logged: Path, folder: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    write_tables(tmp_path, fleet.log.open(logged).messages(), Parquet)
    for cls in LOGGED_CLASSES:
        rows = parquet.read_table(tmp_path / f"{cls.kind}.parquet").to_pylist()
        as_text = [{name: _text(value) for name, value in row.items()} for row in rows]
        assert as_text == table(folder, cls.kind)


def _text(value: object) -> str:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
