"""The rule that names the computing UAV, whose term is whose, and how an elector keeps on."""

from __future__ import annotations

import random
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fleet.model.conflict.tracks import UNHEARD_NS
from fleet.model.election import (
    Answers,
    ComputingChoice,
    ElectionTiming,
    Elector,
    Mandate,
    Terms,
    lowest_eligible,
)

MS = 1_000_000
S = 1_000_000_000

id_sets = st.sets(st.integers(1, 60), max_size=20)
SETTINGS = settings(deadline=None, derandomize=True, max_examples=200)


def test_the_lowest_member_computes() -> None:
    assert lowest_eligible([7, 3, 5], {3, 5, 7}) == 3


def test_one_outside_the_group_is_never_elected() -> None:
    assert lowest_eligible([3, 5], {1, 3, 5}) == 3


def test_the_first_rank_comes_before_the_lower_id() -> None:
    assert lowest_eligible([3, 5, 7], {7, 5}, {3, 5, 7}) == 5
    assert lowest_eligible([3, 5, 7], {1, 9}, set(), {7, 5}) == 5


def test_nobody_is_elected_when_nobody_is_eligible() -> None:
    assert lowest_eligible([], {1}) is None
    assert lowest_eligible([3, 5]) is None
    assert lowest_eligible([3, 5], set(), {1}) is None


@SETTINGS
@given(id_sets, st.lists(id_sets, max_size=3))
def test_the_elected_is_the_lowest_of_its_rank_and_no_better_rank_has_a_member(
    members: set[int], ranks: list[set[int]]
) -> None:
    usable = [sorted(members & rank) for rank in ranks if members & rank]
    assert lowest_eligible(sorted(members), *ranks) == (usable[0][0] if usable else None)


@SETTINGS
@given(id_sets, id_sets, st.randoms(use_true_random=False))
def test_the_order_of_members_does_not_matter(
    members: set[int], able: set[int], rng: random.Random
) -> None:
    shuffled = sorted(members)
    rng.shuffle(shuffled)
    assert lowest_eligible(shuffled, able) == lowest_eligible(sorted(members), able)


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


Groups = Mapping[tuple[int, ...], int]


def elect(
    made: Elector, now_ns: int, under: Mapping[int, int] = MappingProxyType({}), **given: Any
) -> list[Mandate]:
    """Elections at a time; by default UAV 1 leads the pair, on a clean link."""
    leaders: Groups = given.get("leaders", {PAIR: 1})
    share: float = given.get("share", 1.0)
    return made.elect(leaders, under, lambda _: share, now_ns)


def test_an_election_is_repeated_in_its_term_each_time_valid_longer() -> None:
    made = elector()
    found = {t: elect(made, t) for t in range(0, 2 * S, 200 * MS)}
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
    elect(made, 0)
    (found,) = elect(made, MS, {member: term})
    assert found.term > term
    assert (found.computing, found.valid_until_ns) == (1, MS + 2 * S)
    assert elect(made, 2 * MS, {member: found.term}) == []


@pytest.mark.parametrize("terms", [{1: 6, 2: 6}, {1: 6}, {2: 0}, {3: 99}, {}])
def test_an_election_that_nobody_overtook_stands(terms: dict[int, int]) -> None:
    made = elector()
    elect(made, 0)
    assert elect(made, MS, terms) == []


def test_another_computing_uav_is_a_new_term() -> None:
    made = elector()
    elect(made, 0)
    (found,) = elect(made, MS, leaders={PAIR: 2})
    assert (found.term, found.computing) == (12, 2)


@pytest.mark.parametrize(("share", "apart"), [(1.0, 3), (0.67, 3), (0.5, 2), (0.2, 1), (0.03, 1)])
def test_on_a_lossy_link_an_election_is_repeated_more_often(share: float, apart: int) -> None:
    """So that as many come through; but not more often than conflicts are sought."""
    made = elector()
    found = [t for t in range(0, 12 * 200 * MS, 200 * MS) if elect(made, t, share=share)]
    assert found == list(range(0, 12 * 200 * MS, apart * 200 * MS))


def test_a_group_that_was_gone_is_elected_for_in_a_new_term() -> None:
    made = elector()
    run_data: list[Groups] = [{PAIR: 1}, {}, {PAIR: 1}, {(1, 2, 3): 1}, {PAIR: 1}]
    terms = [
        [m.term for m in elect(made, n * MS, leaders=groups)] for n, groups in enumerate(run_data)
    ]
    assert terms == [[6], [], [12], [18], [24]]


def test_who_resigns_repeats_nothing_and_begins_anew_later() -> None:
    made = elector(own=1)
    elect(made, 0)
    made.resign()
    (found,) = elect(made, MS)
    assert found.term == 7


def test_terms_go_on_above_what_is_remembered_or_heard_of() -> None:
    made = elector(highest=17)
    assert elect(made, 0)[0].term == 18
    made.learn(31)
    made.learn(20)
    assert made.highest_term == 31
    assert elect(made, 0, leaders={(3, 4): 3})[0].term == 36


groupings = st.lists(
    st.sampled_from([(1, 2), (3, 4), (1, 2, 3), (2, 3, 4, 5), (4, 5)]), max_size=2, unique=True
).filter(lambda gs: len({m for g in gs for m in g}) == sum(map(len, gs)))
events = st.tuples(
    groupings,
    st.sets(st.sampled_from(FLEET), max_size=5),
    st.dictionaries(st.sampled_from(FLEET), st.integers(0, 60), max_size=5),
    st.one_of(st.none(), st.integers(0, 80)),
    st.booleans(),
)


@SETTINGS
@given(st.lists(events, max_size=12), st.sampled_from([0, *FLEET]))
def test_an_elector_never_goes_back_never_repeats_a_new_term_and_keeps_the_rule(
    run_data: list[tuple[list[tuple[int, ...]], set[int], dict[int, int], int | None, bool]],
    own: int,
) -> None:
    made, terms = elector(own), Terms(FLEET)
    used: dict[int, Mandate] = {}
    now_ns, highest = 0, 0
    for groups, able, under, learnt, resigns in run_data:
        now_ns += 300 * MS
        chosen = {members: lowest_eligible(members, able) for members in groups}
        leaders = {m: leader for m, leader in chosen.items() if leader}
        if learnt is not None:
            made.learn(learnt)
        if resigns:
            made.resign()
        for mandate in elect(made, now_ns, under, leaders=leaders):
            assert terms.elector_of(mandate.term) == own
            assert mandate.computing == leaders[mandate.members]
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


# Whom the coordinator chooses

ALL = (1, 2, 3)
STEADY_NS = TIMING.answer_ns


def chosen(
    made: ComputingChoice, now_ns: int, fit: set[int], equipped: set[int] | None = None
) -> int:
    """The one chosen at a time, and announced at once."""
    leader = made.leader(ALL, fit, {*ALL} if equipped is None else equipped, now_ns)
    assert leader is not None
    made.announced(Mandate(6, ALL, leader, 0), fit, now_ns)
    return leader


def test_the_lowest_that_is_fit_is_chosen_and_if_none_is_the_lowest_that_could_compute() -> None:
    assert chosen(ComputingChoice(TIMING), 0, {2, 3}) == 2
    assert chosen(ComputingChoice(TIMING), 0, set()) == 1
    assert chosen(ComputingChoice(TIMING), 0, set(), {3}) == 3
    assert ComputingChoice(TIMING).leader(ALL, set(), set(), 0) is None


def test_who_was_passed_over_comes_back_when_it_has_been_fit_for_a_while() -> None:
    made = ComputingChoice(TIMING)
    assert chosen(made, 0, {2, 3}) == 2
    assert chosen(made, S, {2, 3}) == 2
    assert chosen(made, S + STEADY_NS, {1, 2, 3}) == 2
    assert chosen(made, S + STEADY_NS + 1, {1, 2, 3}) == 1


def test_who_was_passed_over_comes_back_at_once_if_nobody_else_is_fit() -> None:
    made = ComputingChoice(TIMING)
    assert chosen(made, 0, {2, 3}) == 2
    assert chosen(made, MS, {1}) == 1


def test_who_is_higher_than_the_leader_has_not_been_passed_over() -> None:
    made = ComputingChoice(TIMING)
    assert chosen(made, 0, {1}) == 1
    assert chosen(made, MS, {3}) == 3
    assert chosen(made, 2 * MS, {2, 3}) == 3, "2 was passed over, 3 was not"


@SETTINGS
@given(st.lists(st.sets(st.sampled_from(ALL)), min_size=1, max_size=60))
def test_a_fit_leader_gives_way_only_to_a_lower_one_that_was_not_passed_over_lately(
    run_data: list[set[int]],
) -> None:
    """However the fitness of anybody flaps."""
    made, before = ComputingChoice(TIMING), 0
    unfit_ns = dict.fromkeys((0, *ALL), -STEADY_NS - 1)
    for n, fit in enumerate(run_data):
        now_ns = n * 200 * MS
        leader = chosen(made, now_ns, fit)
        assert leader in fit or not fit
        if before in fit and now_ns - unfit_ns[before] > STEADY_NS and leader != before:
            assert leader < before
            assert now_ns - unfit_ns[leader] > STEADY_NS
        unfit_ns |= {uav: now_ns for uav in ALL if uav not in fit and uav < leader}
        before = leader


# Who answers

WAIT_NS = TIMING.answer_ns
CLEAN_NS = TIMING.silence_ns


def asked(until_ns: int, every_ns: int = 600 * MS) -> Answers:
    """UAV 1 and 2 are named again and again."""
    made = Answers(TIMING)
    for now_ns in range(0, until_ns + 1, every_ns):
        made.ask([1, 2], now_ns)
    return made


def test_an_answer_is_missing_after_twice_the_validity_of_a_mandate() -> None:
    assert WAIT_NS == 4 * S
    made = asked(4 * S)
    assert not made.missing(1, UNHEARD_NS, CLEAN_NS, 4 * S)
    assert made.missing(1, UNHEARD_NS, CLEAN_NS, 4 * S + 1)
    assert not made.missing(3, UNHEARD_NS, CLEAN_NS, 9 * S), "never asked"


def test_it_is_missing_again_so_long_after_the_last_answer() -> None:
    made = asked(9 * S)
    assert not made.missing(1, 5 * S, CLEAN_NS, 9 * S)
    assert made.missing(1, 5 * S, CLEAN_NS, 9 * S + 1)
    assert made.missing(2, UNHEARD_NS, CLEAN_NS, 9 * S)


def test_a_lossy_link_is_given_more_time() -> None:
    made = asked(10 * S)
    assert not made.missing(1, UNHEARD_NS, 2 * CLEAN_NS, 8 * S)
    assert made.missing(1, UNHEARD_NS, 2 * CLEAN_NS, 8 * S + 1)


def test_an_answer_of_before_it_was_asked_gives_it_no_less_time() -> None:
    made = Answers(TIMING)
    made.ask([1], 10 * S)
    for answered_ns in (UNHEARD_NS, 3 * S, 10 * S):
        assert not made.missing(1, answered_ns, 0, 10 * S)
        assert made.missing(1, answered_ns, 0, 10 * S + 1)


def test_who_has_not_been_asked_for_as_long_as_a_mandate_lasts_is_asked_anew() -> None:
    made = asked(0)
    assert not made.missing(1, UNHEARD_NS, CLEAN_NS, 9 * S), "it is asked no more"
    made.ask([1], 2 * S + 1)
    assert not made.missing(1, UNHEARD_NS, CLEAN_NS, 4 * S + 1)
