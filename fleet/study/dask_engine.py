"""A study flown by the workers of a Dask cluster, where one machine is not enough."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
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
        """Connect; raises FailedError if no scheduler answers, or if it has no workers."""
        distributed = import_extra("distributed", "dask", "--dask")
        try:
            _knock(distributed.comm.addressing, address)
            self._client: Any = distributed.Client(
                address, timeout=WAIT_S, set_as_default=False, name="fleet study"
            )
        except (OSError, ValueError, TimeoutError) as error:
            raise FailedError(
                f"no Dask scheduler answers at {address}: start one with 'dask scheduler', and "
                "workers with 'dask worker'"
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=WAIT_S)
        except TimeoutError as error:
            self.close()
            raise FailedError(
                f"the Dask scheduler at {address} has no workers: start some with 'dask worker'"
            ) from error
        self._completed = distributed.as_completed

    def close(self) -> None:
        """Leave the cluster; what is still on the way is not flown."""
        self._client.close()

    def fly(self, orders: Iterator[BatchOrder]) -> Iterator[tuple[BatchOrder, list[RunRow]]]:
        """Each with its rows, as they are done."""
        ahead = AHEAD_EACH * max(1, sum(self._client.nthreads().values()))
        of: dict[str, BatchOrder] = {}
        done = self._completed(with_results=True, loop=self._client.loop)
        for order in orders:
            self._submit(order, done, of)
            if len(of) >= ahead:
                yield self._next(done, of)
        while of:
            yield self._next(done, of)

    def _submit(self, order: BatchOrder, done: Any, of: dict[str, BatchOrder]) -> None:
        with _giving_up():
            future = self._client.submit(fly_batch, order, pure=False)
            of[future.key] = order
            done.add(future)

    def _next(self, done: Any, of: dict[str, BatchOrder]) -> tuple[BatchOrder, list[RunRow]]:
        with _giving_up():
            future, rows = next(done)
            if isinstance(rows, Exception):  # so a batch ends that was cancelled
                raise rows
        return of.pop(future.key), rows


@contextmanager
def _giving_up() -> Iterator[None]:
    """Whatever a cluster raises, of its own or of a worker that lacks something, is FailedError."""
    try:
        yield
    except Exception as error:
        why = f"{type(error).__name__}: {error}".strip().splitlines()[0]
        raise FailedError(
            f"the Dask cluster gave up ({why}): what was flown is kept; see that scheduler and "
            "workers are there with this version of zenoh-fleet, and run the same command again "
            "to go on"
        ) from error


def _knock(addressing: Any, address: str) -> None:
    """Raises OSError or ValueError unless somebody listens at an address.

    A client that finds nobody leaves tasks behind, of which it complains when the process ends.
    """
    _, place = addressing.parse_address(address)
    host, port = addressing.parse_host_port(place)
    socket.create_connection((host, port), timeout=WAIT_S).close()
