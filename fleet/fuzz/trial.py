"""One trial: fly a case on the in-memory bus, and check it by the invariants."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from msgspec import Struct

from fleet.analysis.invariants import RecordedRun, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.loading import convert
from fleet.errors import FleetStoppedError
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder

HANG_S = 60.0


class Trial(Struct, frozen=True):
    """What came of a case: its verdict by invariant, or why it could not be flown to its end."""

    seed: int
    verdicts: dict[str, str]
    crash: str = ""
    digest: str = ""
    lost_separation: bool = False
    due: int = 0
    not_arrived: int = 0
    wall_s: float = 0.0

    @property
    def failures(self) -> tuple[str, ...]:
        """Names of the violated invariants; `crash` or `hang` where it came to that."""
        found = [name for name, verdict in self.verdicts.items() if verdict == "invalid"]
        if self.crash:
            found.append("hang" if self.crash.startswith("hang") else "crash")
        return tuple(sorted(found))


class HangError(BaseException):
    """A trial took far longer than any should; no error of a node's, to be caught as such."""


def fly_case(table: dict[str, Any], hang_s: float = HANG_S) -> Trial:
    """Fly a case and check it; what goes wrong in it is in the trial, not raised.

    Raises:
        ScenarioError: the table is no possible scenario.

    """
    scenario = convert(table, f"case {table['seed']}")
    kept = RecordCollector()
    run_recorder = RunRecorder(scenario, kept)
    begun_s = time.monotonic()
    verdicts: dict[str, str] = {}
    crash = ""
    try:
        with _limit(hang_s):
            for _ in run_in_memory(scenario, run_recorder):
                pass
            found = check(RecordedRun.of_records(scenario, kept.kept)).findings
            verdicts = {finding.name: str(finding.verdict) for finding in found}
    except FleetStoppedError as error:
        crash = str(error)
    except Exception as error:  # noqa: BLE001 (whatever it is, it is what came of this case)
        crash = f"{type(error).__name__}: {error}"
    except HangError:
        crash = f"hang: more than {hang_s:g} s of computing"
    wall_s = time.monotonic() - begun_s
    lost, told = run_recorder.separation.lost(), run_recorder.arrivals.arrivals().totals()
    arrival = told["due"], len(told["not_arrived"])
    return Trial(scenario.seed, verdicts, crash, run_recorder.digest, lost, *arrival, wall_s)


@contextmanager
def _limit(seconds: float) -> Iterator[None]:
    """Raise HangError after so long on a processor, however busy that is with others."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise HangError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
