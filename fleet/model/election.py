"""Elections: the rule, the terms, and an elector; the coordinator and the UAVs share them.

The computing UAV of a group is its lowest eligible ID. The term is one counter that only rises. So
that two electors which cannot hear each other never use the same one, each has its own terms: the
remainder of a term by the number of possible electors tells whose it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

COORDINATOR = 0


@dataclass(frozen=True, slots=True)
class Mandate:
    """One election: in this term this UAV computes for these members, until then.

    `valid_from_ns` is when a member heard it. All by the member's own clock: if that is set back,
    the mandate is void until it is heard again, or it would last too long.
    """

    term: int
    members: tuple[int, ...]
    computing: int
    valid_until_ns: int
    valid_from_ns: int = 0

    def in_force(self, now_ns: int) -> bool:
        """Whether it is valid at a time."""
        return self.valid_from_ns <= now_ns <= self.valid_until_ns


def lowest_eligible(
    members: Iterable[int], last_heard_ns: Mapping[int, int], now_ns: int, silence_limit_ns: int
) -> int | None:
    """The lowest ID among the members not silent for longer than the limit, if any."""
    eligible = (
        m for m in members if m in last_heard_ns and now_ns - last_heard_ns[m] <= silence_limit_ns
    )
    return min(eligible, default=None)


class Terms:
    """Whose term is whose: the coordinator's, 0, and those of the UAVs in order of ID."""

    def __init__(self, uav_ids: Iterable[int]) -> None:
        self._electors = (COORDINATOR, *sorted(uav_ids))
        self._rank = {elector: n for n, elector in enumerate(self._electors)}

    def after(self, highest: int, elector: int) -> int:
        """The elector's lowest term above `highest`; raises KeyError for a stranger."""
        count, rank = len(self._electors), self._rank[elector]
        return highest + 1 + (rank - highest - 1) % count

    def elector_of(self, term: int) -> int:
        """Whose term it is."""
        return self._electors[term % len(self._electors)]


@dataclass(frozen=True, slots=True)
class ElectionTiming:
    """When an election is repeated, for how long each lasts, and what counts as silence."""

    repeat_ns: int
    valid_ns: int
    silence_ns: int


@dataclass(frozen=True, slots=True)
class Standing:
    """An election in force and when it is repeated next."""

    mandate: Mandate
    again_ns: int


class Elector:
    """Keeps an election in force for every group that it is given; forgets those of past groups."""

    def __init__(self, own: int, terms: Terms, timing: ElectionTiming, highest_term: int) -> None:
        self.highest_term = highest_term
        self._own = own
        self._terms = terms
        self._timing = timing
        self._standing: dict[tuple[int, ...], Standing] = {}

    def learn(self, term: int) -> None:
        """Somebody has seen this term: own ones go on above it."""
        self.highest_term = max(self.highest_term, term)

    def elect(
        self,
        groups: Sequence[tuple[int, ...]],
        last_heard_ns: Mapping[int, int],
        mandate_terms: Mapping[int, int],
        now_ns: int,
    ) -> list[Mandate]:
        """Elections to announce now: new, due for repetition, or overtaken by another elector's.

        `mandate_terms` has the term that each UAV says it is under: one above that of the standing
        election means that its members no longer obey that one.
        """
        standing: dict[tuple[int, ...], Standing] = {}
        announced: list[Mandate] = []
        for members in groups:
            computing = lowest_eligible(members, last_heard_ns, now_ns, self._timing.silence_ns)
            if computing is None:
                continue
            old = self._standing.get(members)
            overtaken = max((mandate_terms.get(m, 0) for m in members), default=0)
            if old is None or old.mandate.computing != computing or overtaken > old.mandate.term:
                self.highest_term = self._terms.after(max(self.highest_term, overtaken), self._own)
                old = Standing(Mandate(self.highest_term, members, computing, 0), now_ns)
            if now_ns >= old.again_ns:
                until = now_ns + self._timing.valid_ns
                mandate = replace(old.mandate, valid_until_ns=until)
                old = Standing(mandate, now_ns + self._timing.repeat_ns)
                announced.append(mandate)
            standing[members] = old
        self._standing = standing
        return announced

    def resign(self) -> None:
        """Let all elections run out."""
        self._standing = {}
