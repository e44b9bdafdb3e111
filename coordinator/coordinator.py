"""The coordinator as a pure node: broadcasts in, elections out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fleet.comms.messages import COORDINATOR, Adsb, Conflict, Election, Message
from fleet.comms.station import Incoming
from fleet.comms.surveillance import report_of
from fleet.model.election import Mandate, lowest_eligible
from fleet.model.groups import Pair, conflicts, connected
from fleet.model.scenario import Scenario
from fleet.model.tracks import Report, Tracks
from fleet.model.units import to_ns


@dataclass(frozen=True, slots=True)
class Standing:
    """An election in force and when it is repeated next."""

    mandate: Mandate
    again_ns: int


class Coordinator:
    """Keeps tracks, and an election in force for every conflict group."""

    def __init__(self, scenario: Scenario) -> None:
        self.id = COORDINATOR
        self.hears = ("adsb/0",)
        c = scenario.coordination
        self._outlook = scenario.outlook()
        self._update_ns = to_ns(c.update_s)
        self._silence_ns = to_ns(c.silence_limit_s)
        self._repeat_ns = to_ns(c.election_repeat_s)
        self._valid_ns = to_ns(c.election_valid_s)
        self._timeout_ns = to_ns(scenario.surveillance.timeout_s)
        self._tracks = Tracks()
        self._term = 0
        self._standing: dict[tuple[int, ...], Standing] = {}
        self._known: tuple[Pair, ...] = ()
        self._seq: Counter[str] = Counter()

    def step(self, now_ns: int, inbox: Sequence[Incoming]) -> list[Message]:
        """Take in broadcasts; at each update find the groups and elect."""
        for item in inbox:
            if isinstance(item.message, Adsb):
                # The counter goes on above any term in use, also after a restart.
                self._term = max(self._term, item.message.highest_term)
                self._tracks.hear(report_of(item.message))
        if now_ns % self._update_ns:
            return []
        reports = self._tracks.fresh(now_ns, self._timeout_ns)
        found = conflicts(reports, now_ns, self._outlook)
        out: list[Message] = []
        pairs = tuple(sorted(found))
        if pairs != self._known:
            self._known = pairs
            times = tuple(found[p] for p in pairs)
            out.append(Conflict(self.id, self._next("conflict"), now_ns, pairs, times))
        return out + self._elect(connected([*pairs, *_commanded(reports)]), reports, now_ns)

    def _elect(
        self, groups: list[tuple[int, ...]], reports: list[Report], now_ns: int
    ) -> list[Message]:
        """Elections that are new or due for repetition; those of past groups are dropped."""
        heard = {r.id: r.t_ns for r in reports}
        standing: dict[tuple[int, ...], Standing] = {}
        out: list[Message] = []
        for members in groups:
            computing = lowest_eligible(members, heard, now_ns, self._silence_ns)
            if computing is None:
                continue
            old = self._standing.get(members)
            if old is None or old.mandate.computing != computing:
                self._term += 1
                old = Standing(Mandate(self._term, members, computing, 0), now_ns)
            if now_ns >= old.again_ns:
                mandate = replace(old.mandate, valid_until_ns=now_ns + self._valid_ns)
                old = Standing(mandate, now_ns + self._repeat_ns)
                out.append(self._announce(mandate, now_ns))
            standing[members] = old
        self._standing = standing
        return out

    def _announce(self, mandate: Mandate, now_ns: int) -> Election:
        return Election(
            self.id,
            self._next("election"),
            now_ns,
            mandate.term,
            mandate.members[0],
            mandate.members,
            mandate.computing,
            mandate.valid_until_ns,
        )

    def _next(self, kind: str) -> int:
        self._seq[kind] += 1
        return self._seq[kind] - 1


def _commanded(reports: list[Report]) -> list[Pair]:
    """A UAV under command stays with its issuer until it is told to resume its plan."""
    present = {r.id for r in reports}
    pairs = [(r.id, r.command.issuer) for r in reports if r.escape and r.command]
    return [p for p in pairs if p[1] in present and p[0] != p[1]]
