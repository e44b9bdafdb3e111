"""Elections: the rule, the terms, and an elector; the coordinator and the UAVs share them.

The computing UAV of a group is its lowest ID that acts as one. The term is one counter that only
rises. So that two electors which cannot hear each other never use the same one, each has its own
terms: the remainder of a term by the number of possible electors tells whose it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fleet.model.types import COORDINATOR


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


def lowest_eligible(members: Sequence[int], *ranks: Collection[int]) -> int | None:
    """The lowest member in the first of these sets that has any of them; None if none has."""
    for rank in ranks:
        eligible = [m for m in members if m in rank]
        if eligible:
            return min(eligible)
    return None


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

    def are_of(self, elector: int, terms: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which of many terms are this elector's; raises KeyError for a stranger."""
        mine: NDArray[np.bool_] = terms % len(self._electors) == self._rank[elector]
        return mine


@dataclass(frozen=True, slots=True)
class ElectionTiming:
    """When an election is repeated, for how long each lasts, and what counts as silence."""

    repeat_ns: int
    valid_ns: int
    silence_ns: int

    @property
    def answer_ns(self) -> int:
        """How long a UAV may leave elections unanswered.

        One that takes longer than `valid_ns` is void on arrival; so long an answer may take, too.
        """
        return 2 * self.valid_ns


class Answers:
    """Who answers the elections that name it: by broadcasts that say it is under a mandate.

    Asked is who has been named without a break longer than a mandate lasts.
    """

    def __init__(self, timing: ElectionTiming) -> None:
        self._timing = timing
        self._asked_ns: dict[int, int] = {}
        self._since_ns: dict[int, int] = {}

    def ask(self, members: Iterable[int], now_ns: int) -> None:
        """These have been named."""
        for uav in members:
            if not self.asked(uav, now_ns):
                self._since_ns[uav] = now_ns
            self._asked_ns[uav] = now_ns

    def missing(self, uav: int, answered_ns: int, limit_ns: int, now_ns: int) -> bool:
        """Whether it has been asked for too long, and has not answered since `answered_ns`.

        `limit_ns` is how long its silence may last: on a lossy link an answer may take longer too.
        """
        limit_ns = self._timing.answer_ns * limit_ns // self._timing.silence_ns
        since_ns = max(answered_ns, self._since_ns.get(uav, now_ns))
        return now_ns - since_ns > limit_ns and self.asked(uav, now_ns)

    def asked(self, uav: int, now_ns: int) -> bool:
        """Whether it has been named, lately."""
        asked_ns = self._asked_ns.get(uav)
        return asked_ns is not None and now_ns - asked_ns <= self._timing.valid_ns


class ComputingChoice:
    """Whom the coordinator chooses: the lowest of those who act, as far as it hears.

    One that was passed over because it was not fit comes back when it has been fit for a while, or
    every moment of silence would make two new terms. If nobody is fit, one that is at least heard
    and equipped is tried.
    """

    def __init__(self, timing: ElectionTiming) -> None:
        self._steady_ns = timing.answer_ns
        self._passed_ns: dict[int, int] = {}

    def leader(
        self, members: Sequence[int], fit: Collection[int], equipped: Collection[int], now_ns: int
    ) -> int | None:
        """Who is to lead, given who is fit to, and who is heard and can compute at all."""
        late = {m for m, t_ns in self._passed_ns.items() if now_ns - t_ns <= self._steady_ns}
        return lowest_eligible(members, {*fit} - late, fit, equipped)

    def announced(self, mandate: Mandate, fit: Collection[int], now_ns: int) -> None:
        """An election is announced, by which some may have been passed over."""
        for uav in mandate.members:
            if uav < mandate.computing and uav not in fit:
                self._passed_ns[uav] = now_ns


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
        leaders: Mapping[tuple[int, ...], int],
        mandate_terms: Mapping[int, int],
        share: Callable[[Iterable[int]], float],
        now_ns: int,
    ) -> list[Mandate]:
        """Elections to announce now: new, due for repetition, or overtaken by another elector's.

        `leaders` says who is to lead each group. `mandate_terms` has the term that each UAV says it
        is under: one above that of the standing election means that its members no longer obey it.
        `share` says how much of what some members send comes through: the less, the more often an
        election is repeated.
        """
        standing: dict[tuple[int, ...], Standing] = {}
        announced: list[Mandate] = []
        for members, computing in leaders.items():
            old = self._standing.get(members)
            overtaken = max((mandate_terms.get(m, 0) for m in members), default=0)
            if old is None or old.mandate.computing != computing or overtaken > old.mandate.term:
                self.highest_term = self._terms.after(max(self.highest_term, overtaken), self._own)
                old = Standing(Mandate(self.highest_term, members, computing, 0), now_ns)
            if now_ns >= old.again_ns:
                until = now_ns + self._timing.valid_ns
                mandate = replace(old.mandate, valid_until_ns=until)
                old = Standing(mandate, now_ns + int(self._timing.repeat_ns * share(members)))
                announced.append(mandate)
            standing[members] = old
        self._standing = standing
        return announced

    def resign(self) -> None:
        """Let all elections run out."""
        self._standing = {}
