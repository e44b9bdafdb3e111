"""Memory of the processes of a run, sampled, and whether it stays flat."""

from __future__ import annotations

import csv
import statistics
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

WARM_UP = 0.1
"""This share of the samples of a process, from its beginning, is not judged."""
MOST_GROWTH = 1.05
SLACK_MIB = 1.0
LEAST_SAMPLES = 12


@dataclass
class Role:
    """Samples of one process: seconds, and PSS and RSS in MiB."""

    name: str
    pid: int
    samples: list[tuple[float, float, float]] = field(default_factory=list)

    def halves(self) -> tuple[float, float]:
        """The median PSS of the first half after the warm-up, and of the second."""
        judged = [pss for _, pss, _ in self.samples[int(WARM_UP * len(self.samples)) :]]
        middle = len(judged) // 2
        return statistics.median(judged[:middle]), statistics.median(judged[middle:])

    def told(self) -> str:
        """A line."""
        most = max(pss for _, pss, _ in self.samples)
        rss = max(rss for _, _, rss in self.samples)
        line = f"{self.name} ({self.samples[-1][0] - self.samples[0][0]:.0f} s): "
        if len(self.samples) >= LEAST_SAMPLES:
            first, second = self.halves()
            line += f"{first:.1f} -> {second:.1f} MiB PSS, "
        return f"{line}most {most:.1f} MiB PSS, {rss:.1f} MiB RSS"


def flat(role: Role) -> bool:
    """Whether the second half's median is within 5 % (and 1 MiB) of the first one's.

    Processes that have not been there for long are not judged.
    """
    if len(role.samples) < LEAST_SAMPLES:
        return True
    first, second = role.halves()
    return second <= first * MOST_GROWTH + SLACK_MIB


class MemorySamples:
    """A thread that takes samples of processes for as long as the context lasts."""

    def __init__(self, processes: Callable[[], dict[str, int]], every_s: float, path: Path) -> None:
        """They are written to a file as they are taken, as CSV."""
        self._processes, self._every_s, self._path = processes, every_s, path
        self._roles: dict[tuple[str, int], Role] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="memory samples", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _value: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()

    def roles(self) -> list[Role]:
        """All that were sampled, in order of name."""
        return [self._roles[key] for key in sorted(self._roles)]

    def _run(self) -> None:
        begun_s = time.monotonic()
        with self._path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("name", "pid", "t_s", "pss_mib", "rss_mib"))
            while not self._ended.wait(self._every_s):
                for name, pid in self._processes().items():
                    taken = memory_mib(pid)
                    if taken is not None:
                        role = self._roles.setdefault((name, pid), Role(name, pid))
                        role.samples.append((time.monotonic() - begun_s, *taken))
                        rows.writerow((name, pid, *role.samples[-1]))
                file.flush()


def memory_mib(pid: int) -> tuple[float, float] | None:
    """PSS and RSS of a process in MiB; None if it has gone."""
    try:
        text = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii")
    except OSError:
        return None
    rows = {name: rest for name, _, rest in (line.partition(":") for line in text.splitlines())}
    if "Pss" not in rows:
        return None
    return int(rows["Pss"].split()[0]) / 1024.0, int(rows["Rss"].split()[0]) / 1024.0
