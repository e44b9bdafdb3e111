"""The rule that names the computing UAV, whose term is whose, and how an elector keeps on."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.election import ElectionTiming, Elector, Mandate, Terms, lowest_eligible

NOW_NS = 10_000_000_000
LIMIT_NS = 1_500_000_000
MS = 1_000_000
S = 1_000_000_000

heard_maps = st.dictionaries(st.integers(1, 60), st.integers(0, NOW_NS), max_size=20)
member_sets = st.sets(st.integers(1, 60), max_size=20)
SETTINGS = settings(deadline=None, derandomize=True, max_examples=200)


def elect(members: list[int], last_heard_ns: dict[int, int]) -> int | None:
    return lowest_eligible(members, last_heard_ns, NOW_NS, LIMIT_NS)


def test_the_lowest_member_computes() -> None:
    assert elect([7, 3, 5], {3: NOW_NS, 5: NOW_NS, 7: NOW_NS}) == 3


def test_a_silent_member_is_passed_over() -> None:
    assert elect([3, 5, 7], {3: NOW_NS - LIMIT_NS - 1, 5: NOW_NS, 7: NOW_NS}) == 5


def test_a_member_silent_for_exactly_the_limit_is_still_eligible() -> None:
    assert elect([3, 5], {3: NOW_NS - LIMIT_NS, 5: NOW_NS}) == 3


def test_a_member_never_heard_is_passed_over() -> None:
    assert elect([3, 5], {5: NOW_NS}) == 5


def test_one_outside_the_group_is_never_elected() -> None:
    assert elect([3, 5], {1: NOW_NS, 3: NOW_NS, 5: NOW_NS}) == 3


def test_nobody_is_elected_when_nobody_is_eligible() -> None:
    assert elect([], {1: NOW_NS}) is None
    assert elect([3, 5], {}) is None
    assert elect([3, 5], {3: 0, 5: 0}) is None


@SETTINGS
@given(member_sets, heard_maps)
def test_the_elected_is_eligible_and_nobody_eligible_is_lower(
    members: set[int], heard: dict[int, int]
) -> None:
    recent = {uav for uav, t_ns in heard.items() if t_ns >= NOW_NS - LIMIT_NS}
    expected = sorted(members & recent)
    assert elect(list(members), heard) == (expected[0] if expected else None)


@SETTINGS
@given(member_sets, heard_maps, st.randoms(use_true_random=False))
def test_the_order_of_members_and_of_what_was_heard_does_not_matter(
    members: set[int], heard: dict[int, int], rng: random.Random
) -> None:
    shuffled = sorted(members)
    rng.shuffle(shuffled)
    items = list(heard.items())
    rng.shuffle(items)
    assert elect(shuffled, dict(items)) == elect(sorted(members), heard)


# Terms

fleets = st.sets(st.integers(1, 1000), min_size=1, max_size=12)
terms_seen = st.integers(0, 2**52)


@SETTINGS
@given(fleets, terms_seen, st.data())
def test_an_electors_next_term_is_its_lowest_one_above_the_highest(
    fleet: set[int], highest: int, data: st.DataObject
) -> None:
    terms = Terms(fleet)
    elector = data.draw(st.sampled_from([0, *sorted(fleet)]))
    found = terms.after(highest, elector)
    own = [
        t for t in range(highest + 1, highest + len(fleet) + 2) if terms.elector_of(t) == elector
    ]
    assert own[0] == found > highest


@SETTINGS
@given(fleets, terms_seen)
def test_no_two_electors_ever_use_the_same_term(fleet: set[int], highest: int) -> None:
    terms = Terms(fleet)
    electors = [0, *sorted(fleet)]
    found = {terms.after(highest, elector): elector for elector in electors}
    assert sorted(found.values()) == electors
    assert all(terms.elector_of(term) == elector for term, elector in found.items())


@SETTINGS
@given(fleets, st.randoms(use_true_random=False), terms_seen)
def test_whose_a_term_is_does_not_depend_on_the_order_of_the_fleet(
    fleet: set[int], rng: random.Random, term: int
) -> None:
    shuffled = sorted(fleet)
    rng.shuffle(shuffled)
    assert Terms(shuffled).elector_of(term) == Terms(fleet).elector_of(term)


def test_the_coordinator_comes_first_then_the_uavs_in_order_of_id() -> None:
    terms = Terms([9, 4])
    assert [terms.elector_of(t) for t in range(7)] == [0, 4, 9, 0, 4, 9, 0]
    assert [terms.after(0, e) for e in (0, 4, 9)] == [3, 1, 2]
    assert [terms.after(4, e) for e in (0, 4, 9)] == [6, 7, 5]


def test_a_stranger_has_no_terms() -> None:
    with pytest.raises(KeyError):
        Terms([1, 2]).after(0, 3)


# An elector

TIMING = ElectionTiming(repeat_ns=600 * MS, valid_ns=2 * S, silence_ns=1500 * MS)
FLEET = (1, 2, 3, 4, 5)
PAIR = (1, 2)


def elector(own: int = 0, highest: int = 0) -> Elector:
    return Elector(own, Terms(FLEET), TIMING, highest)


def all_heard(now_ns: int) -> dict[int, int]:
    return dict.fromkeys(FLEET, now_ns)


def test_an_election_is_repeated_in_its_term_each_time_valid_longer() -> None:
    made = elector()
    found = {t: made.elect([PAIR], all_heard(t), {}, t) for t in range(0, 2 * S, 200 * MS)}
    assert {t: [m.valid_until_ns for m in out] for t, out in found.items() if out} == {
        t: [t + 2 * S] for t in (0, 600 * MS, 1200 * MS, 1800 * MS)
    }
    announced = [m for out in found.values() for m in out]
    assert {(m.term, m.members, m.computing) for m in announced} == {(6, PAIR, 1)}


@pytest.mark.parametrize(("member", "term"), [(1, 7), (2, 7), (2, 100)])
def test_an_election_that_another_one_overtook_is_renewed_above_that_one(
    member: int, term: int
) -> None:
    made = elector()
    made.elect([PAIR], all_heard(0), {}, 0)
    (found,) = made.elect([PAIR], all_heard(MS), {member: term}, MS)
    assert found.term > term
    assert (found.computing, found.valid_until_ns) == (1, MS + 2 * S)
    assert made.elect([PAIR], all_heard(2 * MS), {member: found.term}, 2 * MS) == []


@pytest.mark.parametrize("terms", [{1: 6, 2: 6}, {1: 6}, {2: 0}, {3: 99}, {}])
def test_an_election_that_nobody_overtook_stands(terms: dict[int, int]) -> None:
    made = elector()
    made.elect([PAIR], all_heard(0), {}, 0)
    assert made.elect([PAIR], all_heard(MS), terms, MS) == []


def test_when_the_computing_uav_falls_silent_the_next_is_elected_in_a_new_term() -> None:
    made = elector()
    made.elect([PAIR], all_heard(0), {}, 0)
    last = {1: 0, 2: 1600 * MS}
    assert made.elect([PAIR], last, {}, 1500 * MS)[0].computing == 1  # a repetition
    (found,) = made.elect([PAIR], last, {}, 1600 * MS)
    assert (found.term, found.computing) == (12, 2)


def test_when_the_lowest_is_heard_again_it_is_elected_again() -> None:
    made = elector()
    made.elect([PAIR], {2: 0}, {}, 0)
    (found,) = made.elect([PAIR], {1: MS, 2: MS}, {}, MS)
    assert (found.term, found.computing) == (12, 1)


def test_a_group_that_was_gone_is_elected_for_in_a_new_term() -> None:
    made = elector()
    story: list[list[tuple[int, ...]]] = [[PAIR], [], [PAIR], [(1, 2, 3)], [PAIR]]
    terms = [
        [m.term for m in made.elect(groups, all_heard(0), {}, n * MS)]
        for n, groups in enumerate(story)
    ]
    assert terms == [[6], [], [12], [18], [24]]


def test_who_resigns_repeats_nothing_and_begins_anew_later() -> None:
    made = elector(own=1)
    made.elect([PAIR], all_heard(0), {}, 0)
    made.resign()
    (found,) = made.elect([PAIR], all_heard(MS), {}, MS)
    assert found.term == 7


def test_terms_go_on_above_what_is_remembered_or_heard_of() -> None:
    made = elector(highest=17)
    assert made.elect([PAIR], all_heard(0), {}, 0)[0].term == 18
    made.learn(31)
    made.learn(20)
    assert made.highest_term == 31
    assert made.elect([(3, 4)], all_heard(0), {}, 0)[0].term == 36


def test_a_group_of_the_silent_gets_no_election() -> None:
    assert elector().elect([PAIR], {}, {}, 0) == []
    assert elector().elect([PAIR], {1: 0, 2: 0}, {}, 1500 * MS + 1) == []


groupings = st.lists(
    st.sampled_from([(1, 2), (3, 4), (1, 2, 3), (2, 3, 4, 5), (4, 5)]), max_size=2, unique=True
).filter(lambda gs: len({m for g in gs for m in g}) == sum(map(len, gs)))
events = st.tuples(
    groupings,
    st.dictionaries(st.sampled_from(FLEET), st.integers(0, 3 * S), max_size=5),
    st.dictionaries(st.sampled_from(FLEET), st.integers(0, 60), max_size=5),
    st.one_of(st.none(), st.integers(0, 80)),
    st.booleans(),
)


@SETTINGS
@given(st.lists(events, max_size=12), st.sampled_from([0, *FLEET]))
def test_an_elector_never_goes_back_never_repeats_a_new_term_and_keeps_the_rule(
    story: list[tuple[list[tuple[int, ...]], dict[int, int], dict[int, int], int | None, bool]],
    own: int,
) -> None:
    made, terms = elector(own), Terms(FLEET)
    heard: dict[int, int] = {}
    used: dict[int, Mandate] = {}
    now_ns, highest = 0, 0
    for groups, spoke, under, learnt, resigns in story:
        now_ns += 300 * MS
        heard |= {uav: now_ns - ago for uav, ago in spoke.items()}
        if learnt is not None:
            made.learn(learnt)
        if resigns:
            made.resign()
        for mandate in made.elect(groups, heard, under, now_ns):
            assert terms.elector_of(mandate.term) == own
            assert mandate.members in groups
            assert mandate.computing == lowest_eligible(
                mandate.members, heard, now_ns, TIMING.silence_ns
            )
            assert mandate.valid_until_ns == now_ns + TIMING.valid_ns
            assert all(under.get(m, 0) <= mandate.term for m in mandate.members)
            before = used.get(mandate.term)
            if before is None:
                assert mandate.term > max(used, default=0)
            else:
                assert (before.members, before.computing) == (mandate.members, mandate.computing)
            used[mandate.term] = mandate
        assert made.highest_term >= max(highest, learnt or 0, *used, 0)
        highest = made.highest_term
