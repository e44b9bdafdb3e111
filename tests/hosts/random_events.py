"""What happens to a fleet that is spread over hosts: drawn from a seed, one thing at a time."""

from __future__ import annotations

import random
import subprocess
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tests.hosts.namespaces import Hosts
from tests.hosts.spread_fleet import ROUTER_HOST, SpreadFleet

SILENCES_S = (0.5, 40.0)
DOWN_S = (0.5, 10.0)
ASK_S, ATTEMPTS = 60.0, 3
LINK_FAULTS = (
    ("--latency", "300ms"),
    ("--latency", "1s", "--jitter", "500ms"),
    ("--loss", "20%"),
    ("--loss", "50%"),
    ("--loss", "30%", "--burst", "10"),
    ("--duplicate", "20%"),
    ("--reorder", "10%"),
    ("--corrupt", "5%"),
    ("--rate", "100kbit"),
    ("--latency", "200ms", "--loss", "30%", "--duplicate", "10%"),
)


@dataclass(frozen=True)
class Event:
    """Something that was done to a fleet."""

    what: str
    seconds: float

    def __str__(self) -> str:
        return f"{self.what}, {self.seconds:.1f} s" if self.seconds else self.what


class RandomEvents:
    """Lets things happen to a fleet that flies in realtime."""

    def __init__(self, fleet: SpreadFleet, uavs: int, hosts: Sequence[int], seed: int) -> None:
        self.rng = random.Random(f"events {seed}")
        self._fleet, self._uavs, self._cut = fleet, uavs, tuple(hosts)
        self.unanswered: list[str] = []
        self._kinds: tuple[Callable[[], Event], ...] = (
            self._change_links,
            self._change_links,
            self._part,
            self._restart,
            self._silence,
        )

    def happen(self) -> Event:
        """One event, to its end."""
        return self.rng.choice(self._kinds)()

    def calm(self) -> None:
        """End all faults."""
        self._ask("--clear")

    def _change_links(self) -> Event:
        words = self.rng.choice(LINK_FAULTS)
        self._ask("--clear", *words)
        return Event(" ".join(words), 0.0)

    def _part(self) -> Event:
        """Cut the fleet in two."""
        names = [*map(str, range(1, self._uavs + 1)), "coordinator"]
        self.rng.shuffle(names)
        here = self.rng.randint(1, len(names) - 1)
        groups = "/".join(",".join(part) for part in (names[:here], names[here:]))
        length_s = self.rng.uniform(*SILENCES_S)
        self._ask("--clear", "--partition", groups)
        time.sleep(length_s)
        self._ask("--clear")
        return Event(f"--partition {groups}", length_s)

    def _restart(self) -> Event:
        """Kill a process, and start another one in its place."""
        name = self.rng.choice([*map(str, range(1, self._uavs + 1)), "coordinator"])
        length_s = self.rng.uniform(*DOWN_S)
        self._fleet.kill(self._fleet.processes[name])
        time.sleep(length_s)
        self._fleet.join(name)
        return Event(f"{name} killed, started again", length_s)

    def _silence(self) -> Event:
        """Cut the link to a host."""
        host = self.rng.choice(self._cut)
        length_s = self.rng.uniform(*SILENCES_S)
        self._fleet.hosts.cut(host)
        time.sleep(length_s)
        self._fleet.hosts.heal(host)
        return Event(f"link to host {host} cut", length_s)

    def _ask(self, *words: str) -> None:
        """Ask the simulation for other faults; on a busy machine it may not answer in time."""
        for _ in range(ATTEMPTS):
            hosts: Hosts = self._fleet.hosts
            asking = hosts.start(ROUTER_HOST, "fault", *words, "--connect", self._fleet.where)
            try:
                out, err = asking.communicate(timeout=ASK_S)
            except subprocess.TimeoutExpired:
                asking.kill()
                out, err = asking.communicate()
            if asking.returncode == 0:
                return
            self.unanswered.append((out + err).strip())
