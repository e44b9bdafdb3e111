"""What docs/results.md says of a study whose rows are published is what its rows say."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from benchmarks.study_tables import rows
from fleet.study.batches import Batch, BatchOrder, fly_batch
from fleet.study.loading import load_study
from fleet.study.results import open_results
from fleet.study.study_file import Study

ROOT = Path(__file__).parent.parent.parent
PUBLISHED = sorted((ROOT / "studies" / "results").glob("*.study"))
OUTCOME = [
    "lost",
    "nmac",
    "lost_without",
    "least_separation",
    "delay_max_s",
    "commands",
    "messages",
]

each = pytest.mark.parametrize("folder", PUBLISHED, ids=lambda folder: str(folder.stem))


def flies(study: Study) -> Study:
    """The study without what says how much of it is flown."""
    return msgspec.structs.replace(study, runs=1, stop=None, zenoh_share=0.0, description="")


@each
def test_published_rows_are_of_the_study_file_that_is_here(folder: Path) -> None:
    study = load_study(ROOT / "studies" / f"{folder.stem}.toml")
    assert flies(open_results(folder).study) == flies(study)


@each
def test_the_table_in_the_docs_is_that_of_the_published_rows(folder: Path) -> None:
    told = (ROOT / "docs" / "results.md").read_text().splitlines()
    assert [row for row in rows(open_results(folder)) if row not in told] == []


@each
def test_a_run_that_is_flown_now_comes_to_the_published_row(folder: Path) -> None:
    """The first cell's, and the last one's of another encounter."""
    results = open_results(folder)
    chosen = ((7, (0,)), (11, (len(results.cells) - 1,)))
    flown = fly_batch(BatchOrder(msgspec.json.encode(results.study), Batch(chosen)))
    published = {(row["cell"], row["run"]): row for row in results.table().to_pylist()}
    for row in flown:
        told = published[row.cell, row.run]
        assert {name: getattr(row, name) for name in OUTCOME} == {n: told[n] for n in OUTCOME}
