"""A pool of worker processes that no command leaves behind, and what a signal does to it."""

from __future__ import annotations

import multiprocessing as mp
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import TypeVar

from fleet.simulation.interrupts import Interrupts
from fleet.simulation.orphans import start_fork_server, tie_worker
from fleet.simulation.os_limits import check_room

Work = TypeVar("Work")
Made = TypeVar("Made")


def worked(
    work: Callable[[Work], Made], items: Iterable[Work], jobs: int, ahead: int
) -> Iterator[tuple[Work, Made]]:
    """Each item with what the work makes of it, as it is done: in any order.

    At most `ahead` items a process are handed out in advance; with one job all is done here. An
    interruption, and giving up, kill what is still at work.

    Raises:
        BrokenProcessPool: a worker was killed.
        NoRoomError: the limits of the operating system are too low.

    """
    if jobs == 1:
        for item in items:
            yield item, work(item)
        return
    context = mp.get_context("forkserver")
    check_room(jobs)
    start_fork_server([])
    before = mp.active_children()
    interrupts = Interrupts()
    interrupts.install()
    left = iter(items)
    with ProcessPoolExecutor(jobs, context, tie_worker) as pool:
        waiting: dict[Future[Made], Work] = {}
        try:
            while True:
                for item in left:
                    with interrupts:  # a worker that is just being started is to be known
                        waiting[pool.submit(work, item)] = item
                    if len(waiting) >= ahead * jobs:
                        break
                if not waiting:
                    return
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                for future in done:
                    yield waiting.pop(future), future.result()
        except BaseException:  # given up: what is still being worked at is of no use
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(mp.active_children()).difference(before):
                worker.kill()
            raise
        finally:
            interrupts.restore()
