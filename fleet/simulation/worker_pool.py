"""A pool of worker processes that no command leaves behind, and what a signal does to it."""

from __future__ import annotations

import multiprocessing as mp
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from types import TracebackType
from typing import Self, TypeVar

from fleet.simulation.interrupts import Interrupts
from fleet.simulation.orphans import start_fork_server, tie_worker
from fleet.simulation.os_limits import check_room

Work = TypeVar("Work")
Made = TypeVar("Made")


class WorkerPool:
    """A context: worker processes, or with one job this process itself.

    To leave it by an error, as by an interruption, kills what is still at work. It raises
    NoRoomError if the limits of the operating system are too low.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool: ProcessPoolExecutor | None = None
        self._interrupts = Interrupts()

    def __enter__(self) -> Self:
        """Start the workers' server."""
        if self._jobs > 1:
            check_room(self._jobs)
            start_fork_server([])
            self._before = mp.active_children()
            self._interrupts.install()
            context = mp.get_context("forkserver")
            self._pool = ProcessPoolExecutor(self._jobs, context, tie_worker)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _error: object, _trace: TracebackType | None
    ) -> None:
        """End the workers."""
        if self._pool is None:
            return
        if kind is not None:  # given up: what is still being worked at is of no use
            self._pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(mp.active_children()).difference(self._before):
                worker.kill()
        self._pool.shutdown()
        self._interrupts.restore()

    def each(
        self, work: Callable[[Work], Made], items: Iterable[Work], ahead: int
    ) -> Iterator[tuple[Work, Made]]:
        """Each item with what the work makes of it, as it is done: in any order.

        At most `ahead` items a worker are handed out in advance. Raises BrokenProcessPool if a
        worker is killed.
        """
        pool = self._pool
        if pool is None:
            for item in items:
                yield item, work(item)
            return
        waiting: dict[Future[Made], Work] = {}
        left = iter(items)
        while True:
            for item in left:
                with self._interrupts:  # a worker that is just being started is to be known
                    waiting[pool.submit(work, item)] = item
                if len(waiting) >= ahead * self._jobs:
                    break
            if not waiting:
                return
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                yield waiting.pop(future), future.result()
