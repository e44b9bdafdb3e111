"""Local election: when a UAV elects itself, when it yields, and which elections count at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.agents.voting import Voter
from fleet.config.scenario import Coordination
from fleet.model.conflict.tracks import StateReport, Tracks
from fleet.model.election import Mandate, Terms
from fleet.protocol.messages import Election, PersistentState
from fleet.protocol.surveillance import report_of
from tests.support.samples import MS, S, adsb, election, head_on, heartbeat

UPDATE_NS = 200 * MS
SILENCE_NS = 1500 * MS
TERMS = Terms((1, 2, 3))
COORDINATORS, ONES, TWOS, THREES = 8, 9, 10, 11
"""One term of each elector."""
fast = settings(deadline=None, derandomize=True, max_examples=100)

Under = dict[int, int]
"""Terms of the valid mandates that UAVs say they are under."""


def voter(own: int = 1, memory: PersistentState | None = None, **changes: Any) -> Voter:
    scenario = head_on(coordination=Coordination(**changes))
    return Voter(scenario.uav[own - 1], scenario, memory)


def tracks(*heard: StateReport, silent: Iterable[int] = ()) -> Tracks:
    """What is known of others, who have been heard just now, but for the silent ones."""
    made = Tracks(head_on().track_rules())
    for report in heard:
        made.hear(report, report.t_ns - (2 * S if report.id in silent else 0))
    return made


def reports(now_ns: int, *, meet: bool = True) -> dict[int, StateReport]:
    """UAV 1 flies north and UAV 2 south towards it; 3 is far away."""
    north_m = 25.0 * now_ns / S
    heading = 3.14159265 if meet else 0.0
    made = [
        adsb(1, (north_m, 0.0, -300.0), 0.0, now_ns),
        adsb(2, (1500.0 - north_m if meet else 1500.0 + north_m, 0.0, -300.0), heading, now_ns),
        adsb(3, (north_m, 90_000.0, -300.0), 0.0, now_ns),
    ]
    return {m.id: report_of(m) for m in made}


def ask(
    of: Voter,
    own: int,
    now_ns: int,
    under: Under | None = None,
    silent: Iterable[int] = (),
    *,
    meet: bool = True,
) -> Mandate | None:
    """Whether it elects itself at an update, having heard all but the silent ones just now."""
    found = reports(now_ns, meet=meet)
    for uav, term in (under or {}).items():
        found[uav] = msgspec.structs.replace(found[uav], mandate_term=term, mandate_valid=True)
    me = msgspec.structs.replace(
        found.pop(own), mandate_term=of.minimum_term, mandate_valid=of.valid(now_ns)
    )
    if not of.stands(now_ns):
        return None
    return of.elect(me, tracks(*found.values(), silent=silent), now_ns)


def updates(until_ns: int, from_ns: int = 0) -> range:
    return range(from_ns, until_ns + 1, UPDATE_NS)


def votes(of: Voter, own: int, until_ns: int, from_ns: int = 0, **given: Any) -> list[Mandate]:
    """Its elections of itself at all updates, which it takes as its mandates as a UAV does."""
    out = []
    for now_ns in updates(until_ns, from_ns):
        mandate = ask(of, own, now_ns, **given)
        if mandate is not None:
            out.append(mandate)
            of.on_election(local(mandate), now_ns)
    return out


def local(mandate: Mandate) -> Election:
    return election(
        mandate.term,
        mandate.members,
        mandate.computing,
        mandate.valid_until_ns,
        elector=mandate.computing,
    )


# When


@given(st.lists(st.integers(1, SILENCE_NS), min_size=1, max_size=30), st.booleans())
@fast
def test_there_is_no_local_election_while_the_coordinator_is_heard(
    gaps_ns: list[int], elects: bool
) -> None:
    """As long as its heartbeats, or elections of anybody, come no further apart than the limit."""
    made, heard_ns = voter(), 0
    for n, gap_ns in enumerate(gaps_ns):
        for now_ns in updates(heard_ns + gap_ns, from_ns=-(-heard_ns // UPDATE_NS) * UPDATE_NS):
            assert ask(made, 1, now_ns) is None
        heard_ns += gap_ns
        if elects and n % 2:
            others = election(4 * n + 4, (2, 3), 2, 0, heard_ns)
            made.on_election(msgspec.structs.replace(others, seq=n), heard_ns)
        else:
            made.on_heartbeat(heartbeat(heard_ns, seq=n), heard_ns)


@pytest.mark.parametrize("last_ns", [0, 400 * MS, 2 * S])
def test_after_the_limit_of_silence_the_lowest_of_the_group_elects_itself(last_ns: int) -> None:
    made = voter()
    made.on_heartbeat(heartbeat(last_ns), last_ns)
    first, *more = votes(made, 1, 8 * S)
    at_ns = first.valid_until_ns - 2 * S
    assert (first.term, first.members, first.computing) == (1, (1, 2), 1)
    assert at_ns == next(t for t in updates(8 * S) if t > last_ns + SILENCE_NS)
    assert {(m.term, m.members, m.computing) for m in more} == {(1, (1, 2), 1)}
    until = [first.valid_until_ns, *(m.valid_until_ns for m in more)]
    assert until == list(range(until[0], until[0] + len(until) * 600 * MS, 600 * MS))


def test_a_coordinator_never_heard_has_as_long_to_make_itself_heard() -> None:
    """A UAV that is started in the middle of a run does not elect itself at once."""
    first = votes(voter(), 1, 20 * S, from_ns=10 * S)[0]
    assert first.valid_until_ns == 10 * S + 1600 * MS + 2 * S


def test_with_local_electors_the_lowest_elects_itself_at_once() -> None:
    made = voter(electors="local")
    assert votes(made, 1, 0) == [Mandate(1, (1, 2), 1, 2 * S)]
    made.on_heartbeat(heartbeat(0), 0)
    assert ask(made, 1, 600 * MS) == Mandate(1, (1, 2), 1, 2600 * MS)


def test_one_that_is_not_the_lowest_does_not_elect_itself_unless_the_lower_are_silent() -> None:
    assert votes(voter(2), 2, 8 * S) == []
    assert [m.computing for m in votes(voter(2), 2, 8 * S, silent=[1])] != []
    assert {(m.term, m.computing) for m in votes(voter(2), 2, 8 * S, silent=[1])} == {(2, 2)}


def test_one_without_a_conflict_does_not_elect_itself() -> None:
    assert votes(voter(3), 3, 8 * S) == []
    assert votes(voter(1), 1, 8 * S, meet=False) == []


@pytest.mark.parametrize("kind", ["heartbeat", "election"])
def test_a_replay_is_no_sign_of_life_of_the_coordinator(kind: str) -> None:
    made = voter()
    last = heartbeat(0, seq=5), msgspec.structs.replace(election(4, (2, 3), 2, 0), seq=5)
    found = []
    for now_ns in updates(4 * S):
        for seq in {5, now_ns // UPDATE_NS % 5}:  # the last one again and again, and older ones
            if kind == "heartbeat":
                made.on_heartbeat(msgspec.structs.replace(last[0], seq=seq), now_ns)
            else:
                made.on_election(msgspec.structs.replace(last[1], seq=seq), now_ns)
        mandate = ask(made, 1, now_ns)
        if mandate:
            found.append(now_ns)
    assert found
    assert found[0] == 1600 * MS


def test_the_heartbeats_of_a_coordinator_that_returns_are_new() -> None:
    """They count from the next thousand million on."""
    made = voter()
    made.on_heartbeat(heartbeat(0, seq=900), 0)
    assert votes(made, 1, 3 * S)
    made.on_heartbeat(heartbeat(0, seq=10**9), 3 * S)
    assert votes(made, 1, 4400 * MS, from_ns=3200 * MS) == []


def test_a_heartbeat_of_a_uav_is_no_sign_of_life() -> None:
    made = voter()
    for now_ns in updates(1400 * MS):
        made.on_heartbeat(msgspec.structs.replace(heartbeat(now_ns), id=2, highest_term=99), now_ns)
        assert ask(made, 1, now_ns) is None
    assert made.highest_term == 0
    assert ask(made, 1, 1600 * MS) is not None


# Yielding


LATE = 10 * S


def alone(own: int = 1, memory: PersistentState | None = None) -> Voter:
    """One that has not heard the coordinator for long."""
    made = voter(own, memory)
    ask(made, own, 0)
    return made


@pytest.mark.parametrize(
    ("own", "under", "elects"),
    [
        (1, {}, True),
        (1, {2: COORDINATORS}, False),
        (1, {2: TWOS}, True),  # a higher one's: that one yields
        (1, {2: THREES}, True),
        (1, {3: COORDINATORS}, True),  # not of its group
        (2, {1: ONES}, False),
        (2, {1: COORDINATORS}, False),
    ],
)
def test_who_is_next_yields_to_a_valid_mandate_of_the_coordinator_or_of_a_lower_uav(
    own: int, under: Under, elects: bool
) -> None:
    if own == 2:  # the lower one is there, but cannot compute
        made = alone(2)
        found = reports(LATE)
        one = msgspec.structs.replace(
            found[1], mandate_term=under[1], mandate_valid=True, equipment="no_compute"
        )
        heard = made.elect(found[2], tracks(one), LATE)
    else:
        heard = ask(alone(1), 1, LATE, under)
    assert (heard is not None) is elects


def test_a_mandate_that_has_run_out_is_no_obstacle() -> None:
    found = reports(LATE)
    other = msgspec.structs.replace(found[2], mandate_term=COORDINATORS, mandate_valid=False)
    assert alone().elect(found[1], tracks(other), LATE) is not None


@pytest.mark.parametrize(("until_ns", "elects"), [(LATE, False), (LATE - 1, True)])
def test_its_own_mandate_under_another_is_an_obstacle_until_it_runs_out(
    until_ns: int, elects: bool
) -> None:
    made = alone()
    made.on_election(election(COORDINATORS, (1, 3), 3, until_ns), until_ns - 2 * S)
    assert (ask(made, 1, LATE) is not None) is elects


def test_one_that_the_coordinator_elected_carries_on_when_it_falls_silent() -> None:
    """Its members are under that mandate still: that is its own."""
    made = alone()
    made.on_election(election(COORDINATORS, (1, 2), 1, LATE + S), LATE - 2 * S)
    found = ask(made, 1, LATE, {2: COORDINATORS})
    assert found == Mandate(ONES, (1, 2), 1, LATE + 2 * S)


def test_one_that_carries_on_does_so_in_one_term_though_others_hear_of_it_later() -> None:
    """Until they do, they say that they are under the old mandate."""
    made = alone()
    made.on_election(election(COORDINATORS, (1, 2), 1, LATE + 5 * S), LATE - 2 * S)
    found = []
    for n, now_ns in enumerate(updates(LATE + 3 * S, from_ns=LATE)):
        mandate = ask(made, 1, now_ns, {2: COORDINATORS if n < 3 else ONES})
        if mandate:
            found.append(mandate)
            made.on_election(local(mandate), now_ns)
    assert {m.term for m in found} == {ONES}


def test_what_a_silent_uav_last_said_of_its_mandate_is_no_obstacle() -> None:
    """The computing UAV is dead: its last broadcast says for ever that it computes."""
    made = alone(2)
    found = ask(made, 2, LATE, {1: ONES}, silent=[1])
    assert found is not None
    assert (found.term, found.computing) == (TWOS, 2)


def test_one_that_elected_itself_yields_when_a_lower_one_is_heard() -> None:
    made = alone(2)
    assert votes(made, 2, LATE, from_ns=LATE, silent=[1])
    assert votes(made, 2, LATE + 4 * S, from_ns=LATE + UPDATE_NS) == []


def test_one_that_elected_itself_yields_when_the_coordinator_is_heard_again() -> None:
    made = alone()
    assert votes(made, 1, LATE, from_ns=LATE)
    made.on_heartbeat(heartbeat(LATE), LATE)
    assert votes(made, 1, LATE + 1400 * MS, from_ns=LATE + UPDATE_NS) == []


def test_one_that_elected_itself_obeys_the_next_election_of_the_coordinator() -> None:
    made = alone()
    (mandate, *_) = votes(made, 1, LATE, from_ns=LATE)
    later = election(TERMS.after(mandate.term, 0), (1, 2), 2, LATE + 2 * S)
    assert made.on_election(later, LATE + 100 * MS)
    assert made.mandate == Mandate(later.term, (1, 2), 2, LATE + 2 * S, LATE + 100 * MS)


def test_a_mandate_never_lasts_longer_than_any_can() -> None:
    """The elector's clock is ahead: its mandates must not outlive it."""
    made = alone()
    made.on_election(election(COORDINATORS, (1, 2), 2, LATE + 60 * S), LATE)
    assert made.valid(LATE + 2 * S)
    assert not made.valid(LATE + 2 * S + 1)


def test_a_mandate_is_void_when_the_own_clock_is_set_back() -> None:
    made = alone()
    made.on_election(election(COORDINATORS, (1, 2), 2, LATE + 2 * S), LATE)
    assert not made.valid(LATE - 5 * S)
    made.on_election(election(COORDINATORS, (1, 2), 2, LATE + 2 * S), LATE - 5 * S)
    assert made.valid(LATE - 5 * S)
    assert not made.valid(LATE - 2 * S)


# Which elections count


def test_a_misattributed_term_is_ignored() -> None:
    for term in range(1, 12):
        for elector in (0, 1, 2, 3):
            made = voter(2)
            computing = elector or 1
            members = (1, 2, 3)
            taken = made.on_election(election(term, members, computing, S, elector=elector), 0)
            assert taken == (TERMS.elector_of(term) == elector)
            assert made.highest_term == (term if taken else 0)
            assert (made.mandate is not None) == taken


def test_a_uav_can_elect_only_itself() -> None:
    made = voter(2)
    assert not made.on_election(election(ONES, (1, 2, 3), 3, S, elector=1), 0)
    assert not made.on_election(election(THREES, (2, 3), 2, S, elector=3), 0)
    assert (made.mandate, made.highest_term) == (None, 0)
    assert made.on_election(election(ONES, (1, 2, 3), 1, S, elector=1), 0)


def test_there_is_no_election_of_term_zero() -> None:
    assert not voter(2).on_election(election(0, (1, 2), 1, S), 0)


def test_a_misattributed_election_is_no_sign_of_life_of_the_coordinator() -> None:
    made = voter()
    found = []
    for n, now_ns in enumerate(updates(3 * S)):
        wrong = msgspec.structs.replace(election(ONES, (2, 3), 2, now_ns + S), seq=n)
        assert not made.on_election(wrong, now_ns)
        if ask(made, 1, now_ns):
            found.append(now_ns)
    assert found[0] == 1600 * MS


def test_an_election_of_others_is_no_mandate_but_its_term_is_learnt() -> None:
    made = voter(2)
    assert not made.on_election(election(COORDINATORS, (1, 3), 1, S), 0)
    assert (made.mandate, made.minimum_term, made.highest_term) == (None, 0, COORDINATORS)


issued = st.builds(
    lambda term, members, computing, until_ns, elector: election(
        term, tuple(sorted(members)), computing, until_ns, elector=elector
    ),
    st.integers(0, 15),
    st.sets(st.integers(1, 3), min_size=1),
    st.integers(1, 3),
    st.integers(0, 5 * S),
    st.integers(0, 3),
)


@given(st.lists(issued, max_size=12), st.integers(0, 9))
@fast
def test_a_mandate_is_of_the_highest_term_that_names_it_and_never_gets_shorter(
    heard: Sequence[Election], remembered: int
) -> None:
    made = voter(2, PersistentState(2, 0, 0, remembered, remembered, 0, 0))
    until: dict[int, int] = {}
    for one in heard:
        minimum_term = made.minimum_term
        taken = made.on_election(one, 0)
        counts = (
            one.term > 0 and TERMS.elector_of(one.term) == one.id and one.id in (0, one.computing)
        )
        assert taken == (counts and 2 in one.members and one.term >= minimum_term)
        if taken:
            until[one.term] = max(until.get(one.term, 0), min(one.valid_until_ns, 2 * S))
        highest = max(until, default=0)
        assert made.minimum_term == max(remembered, highest)
        if until:
            assert made.mandate is not None
            assert (made.mandate.term, made.mandate.valid_until_ns) == (highest, until[highest])
        else:
            assert made.mandate is None


def test_a_uav_that_is_started_again_goes_on_above_its_terms_and_has_no_mandate() -> None:
    made = voter(1, PersistentState(1, 4, 5 * S, 21, 13, 0, 0))
    assert (made.highest_term, made.minimum_term, made.mandate) == (21, 13, None)
    assert not made.on_election(election(12, (1, 2), 1, 100 * S), LATE)
    found = votes(made, 1, LATE + 3 * S, from_ns=LATE)
    assert {m.term for m in found} == {25}


def test_a_new_election_goes_above_the_terms_that_members_are_under() -> None:
    """They may have heard terms that this one has not heard of."""
    assert [m.term for m in votes(alone(), 1, LATE, from_ns=LATE, under={2: 46})] == [49]


@given(
    st.lists(st.integers(0, 30), max_size=6),
    st.lists(st.integers(0, 30), max_size=6),
    st.lists(st.booleans(), min_size=5, max_size=20),
)
@fast
def test_two_electors_that_do_not_hear_each_other_never_share_a_term(
    first: list[int], second: list[int], meets: list[bool]
) -> None:
    """Whatever either has heard of before, and however often each elects itself anew."""
    used: dict[int, set[int]] = {1: set(), 2: set()}
    for own, learnt in ((1, first), (2, second)):
        made = alone(own)
        for term in learnt:
            made.on_heartbeat(heartbeat(0, seq=0, highest_term=term), 0)
        for n, meet in enumerate(meets):
            now_ns = LATE + 3 * n * S
            mandate = ask(made, own, now_ns, silent=[1] if own == 2 else [2], meet=meet)
            if mandate:
                used[own].add(mandate.term)
                made.on_election(local(mandate), now_ns)
    assert not used[1] & used[2]
    assert all(TERMS.elector_of(t) == own for own, terms in used.items() for t in terms)
