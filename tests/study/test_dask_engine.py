"""A study on a Dask cluster: the same rows, and one line where the cluster cannot go on."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fleet.errors import FailedError
from fleet.study.batches import Batch, BatchOrder
from fleet.study.dask_engine import DaskCluster
from fleet.study.loading import load_study
from fleet.study.results import ResultsFolder
from fleet.study.running import StudyProgress, fly_missing
from tests.study.test_study_runs import SMALL, flown


def test_a_dask_cluster_flies_the_same_rows_though_a_worker_is_killed(tmp_path: Path) -> None:
    """A real cluster of two worker processes on this machine."""
    distributed = pytest.importorskip("distributed")
    table = {**SMALL, "runs": 40, "set": {"duration_s": 2.0}}
    alone = flown(tmp_path / "alone", table)
    with (
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            host="127.0.0.1",
        ) as cluster,
    ):
        engine = DaskCluster(cluster.scheduler_address)
        results = ResultsFolder.create(tmp_path / "dask", load_study(table))
        killed: list[int] = []

        def kill(progress: StudyProgress) -> None:
            if progress.known and not killed:
                victim = next(iter(cluster.workers.values()))
                killed.append(victim.pid)
                os.kill(victim.pid, signal.SIGKILL)

        fly_missing(results, engine, kill)
        engine.close()
    assert killed
    assert results.table().equals(alone.table())


def test_where_no_scheduler_answers_it_is_said_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fleet.study.dask_engine.WAIT_S", 0.2)
    with pytest.raises(FailedError, match="no Dask scheduler answers at tcp://127"):
        DaskCluster("tcp://127.0.0.1:9")


@pytest.mark.parametrize("address", ["nonsense", "tcp://127.0.0.1", "127.0.0.1:port"])
def test_what_is_no_address_is_said_in_a_line(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(FailedError, match=f"no Dask scheduler answers at {address}:"):
        DaskCluster(address)


def test_a_scheduler_without_workers_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("fleet.study.dask_engine.WAIT_S", 2.0)
    with (
        distributed.LocalCluster(
            n_workers=0, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        pytest.raises(FailedError, match="has no workers: start some with 'dask worker'"),
    ):
        DaskCluster(cluster.scheduler_address)


@pytest.mark.parametrize("ends_by", ["a result", "an error"])
def test_a_batch_that_is_cancelled_is_one_line(ends_by: str) -> None:
    """So batches end whose scheduler is killed: its clients are told that they were cancelled."""

    class Client:
        loop = None

        def nthreads(self) -> dict[str, int]:
            return {"one": 1}

        def submit(self, *_: Any, **__: Any) -> Any:
            return type("Future", (), {"key": "one"})()

    class Completed:
        def __init__(self, **_: Any) -> None:
            self.futures: list[Any] = []

        def add(self, future: Any) -> None:
            self.futures.append(future)

        def __next__(self) -> tuple[Any, Any]:
            cancelled = RuntimeError("one cancelled for reason: scheduler-connection-lost.")
            if ends_by == "an error":
                raise cancelled
            return self.futures.pop(), cancelled

    engine = DaskCluster.__new__(DaskCluster)
    engine._client, engine._completed = Client(), Completed
    orders: Iterator[BatchOrder] = iter([BatchOrder(b"", Batch(()))])
    with pytest.raises(FailedError, match=r"gave up \(RuntimeError: one cancelled.*to go on"):
        list(engine.fly(orders))
