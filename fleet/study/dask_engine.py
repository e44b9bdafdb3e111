"""A study flown by the workers of a Dask cluster, where one machine is not enough."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fleet.errors import FailedError
from fleet.extras import import_extra
from fleet.study.batches import BatchOrder, fly_batch
from fleet.study.run_row import RunRow

AHEAD_EACH = 3
"""So many batches a thread of the cluster are handed out in advance."""
WAIT_S = 10.0


class DaskCluster:
    """The cluster whose scheduler is at this address, as `tcp://10.0.0.1:8786`: an engine.

    A batch of a worker that dies is flown by another one. Workers need this package with the same
    version, and the same own kinds and resolvers.
    """

    def __init__(self, address: str) -> None:
        """Connect; raises FailedError if no scheduler answers."""
        distributed = import_extra("distributed", "dask", "--dask")
        try:
            self._client: Any = distributed.Client(
                address, timeout=WAIT_S, set_as_default=False, name="fleet study"
            )
        except (OSError, ValueError, TimeoutError) as error:
            raise FailedError(
                f"no Dask scheduler answers at {address}: start one with 'dask scheduler', and "
                "workers with 'dask worker'"
            ) from error
        self._completed = distributed.as_completed
        self._failures: tuple[type[Exception], ...] = (
            distributed.KilledWorker,
            distributed.CancelledError,
            distributed.comm.CommClosedError,
            OSError,
        )

    def close(self) -> None:
        """Leave the cluster; what is still on the way is not flown."""
        self._client.close()

    def fly(self, orders: Iterator[BatchOrder]) -> Iterator[tuple[BatchOrder, list[RunRow]]]:
        """Each with its rows, as they are done."""
        ahead = AHEAD_EACH * max(1, sum(self._client.nthreads().values()))
        of: dict[str, BatchOrder] = {}
        done = self._completed(with_results=True, loop=self._client.loop)
        try:
            for order in orders:
                self._submit(order, done, of)
                if len(of) >= ahead:
                    yield self._next(done, of)
            while of:
                yield self._next(done, of)
        except self._failures as error:
            raise FailedError(
                f"the Dask cluster gave up ({type(error).__name__}): what was flown is kept; run "
                "the same command again to go on"
            ) from error

    def _submit(self, order: BatchOrder, done: Any, of: dict[str, BatchOrder]) -> None:
        future = self._client.submit(fly_batch, order, pure=False)
        of[future.key] = order
        done.add(future)

    def _next(self, done: Any, of: dict[str, BatchOrder]) -> tuple[BatchOrder, list[RunRow]]:
        future, rows = next(done)
        return of.pop(future.key), rows
