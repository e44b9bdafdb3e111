"""The coordinator: who is elected when, in which term, and for how long."""

from __future__ import annotations

import math
from typing import Any

import pytest

from coordinator.coordinator import Coordinator
from fleet.comms.messages import Adsb, Conflict, Election, Message
from fleet.comms.station import Incoming
from tests.samples import MS, S, adsb, head_on

UPDATE_NS = 200 * MS
SOUTH = math.pi


def northbound(t_ns: int, uav: int = 1, **changes: Any) -> Adsb:
    """At the origin at time 0, flying north at 25 m/s."""
    return adsb(uav, (25.0 * t_ns / S, 0.0, -300.0), 0.0, t_ns, **changes)


def southbound(t_ns: int, uav: int = 2, east_m: float = 0.0, **changes: Any) -> Adsb:
    """1500 m north of the origin at time 0, flying south at 25 m/s."""
    return adsb(uav, (1500.0 - 25.0 * t_ns / S, east_m, -300.0), SOUTH, t_ns, **changes)


def apart(t_ns: int, uav: int) -> Adsb:
    """So far from the rest that it meets nobody."""
    return adsb(uav, (0.0, 50_000.0 * uav, -300.0), 0.0, t_ns)


def tell(node: Coordinator, now_ns: int, *heard: Adsb) -> list[Message]:
    """Step the coordinator with broadcasts that reach it now."""
    return node.step(now_ns, [Incoming(now_ns, m) for m in heard])


def elections(messages: list[Message]) -> list[Election]:
    return [m for m in messages if isinstance(m, Election)]


def conflicts(messages: list[Message]) -> list[Conflict]:
    return [m for m in messages if isinstance(m, Conflict)]


def test_a_head_on_pair_gets_one_election_of_the_lowest_id() -> None:
    out = tell(Coordinator(head_on()), 0, northbound(0), southbound(0), apart(0, 3))
    assert elections(out) == [Election(0, 0, 0, 1, 1, (1, 2), 1, 2 * S)]


def test_the_conflict_is_told_with_its_time_to_violation() -> None:
    out = tell(Coordinator(head_on()), 0, northbound(0), southbound(0), apart(0, 3))
    (found,) = conflicts(out)
    assert found.pairs == ((1, 2),)
    # 1500 m apart, 400 m required, closing at 50 m/s; the alert is a little wider, so earlier.
    assert 20.0 < found.time_to_violation_s[0] <= 22.0


def test_traffic_that_does_not_meet_gets_no_election() -> None:
    assert tell(Coordinator(head_on()), 0, northbound(0), apart(0, 2), apart(0, 3)) == []


def test_an_election_is_repeated_in_its_term_and_lasts_longer_each_time() -> None:
    node = Coordinator(head_on())
    out: list[Message] = []
    for now_ns in range(0, 2 * S, UPDATE_NS):
        out += tell(node, now_ns, northbound(now_ns), southbound(now_ns))
    found = elections(out)
    assert [e.t_ns for e in found] == [0, 600 * MS, 1200 * MS, 1800 * MS]
    assert [e.seq for e in found] == [0, 1, 2, 3]
    assert {(e.term, e.group, e.members, e.computing) for e in found} == {(1, 1, (1, 2), 1)}
    assert all(e.valid_until_ns == e.t_ns + 2 * S for e in found)
    assert len(conflicts(out)) == 1


def test_an_election_is_valid_until_after_the_next_repetition() -> None:
    scenario = head_on()
    assert scenario.coordination.election_valid_s > 2 * scenario.coordination.election_repeat_s


def test_elections_end_with_the_conflict_and_a_new_conflict_is_a_new_term() -> None:
    node = Coordinator(head_on())
    assert elections(tell(node, 0, northbound(0), southbound(0)))
    past = [apart(k * UPDATE_NS, uav) for k in range(1, 6) for uav in (1, 2)]
    quiet = [
        m
        for k in range(1, 6)
        for m in tell(node, k * UPDATE_NS, *[p for p in past if p.t_ns == k * UPDATE_NS])
    ]
    assert elections(quiet) == []
    assert [c.pairs for c in conflicts(quiet)] == [()]
    again = tell(node, 6 * UPDATE_NS, northbound(6 * UPDATE_NS), southbound(6 * UPDATE_NS))
    assert [(e.term, e.t_ns) for e in elections(again)] == [(2, 6 * UPDATE_NS)]


def test_a_group_that_grows_is_a_new_term_at_once() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0), apart(0, 3))
    third = southbound(UPDATE_NS, 3, east_m=450.0)
    out = tell(node, UPDATE_NS, northbound(UPDATE_NS), southbound(UPDATE_NS), third)
    assert elections(out) == []  # 450 m beside UAV 2 the third meets nobody
    now_ns = 2 * UPDATE_NS
    third = southbound(now_ns, 3, east_m=300.0)
    out = tell(node, now_ns, northbound(now_ns), southbound(now_ns), third)
    assert [(e.term, e.members, e.computing) for e in elections(out)] == [(2, (1, 2, 3), 1)]


def test_separate_groups_get_their_own_elections() -> None:
    out = tell(
        Coordinator(head_on()),
        0,
        northbound(0, 4),
        southbound(0, 2),
        adsb(3, (0.0, 50_000.0, -300.0), 0.0),
        adsb(1, (1500.0, 50_000.0, -300.0), SOUTH),
    )
    found = [(e.term, e.group, e.members, e.computing) for e in elections(out)]
    assert found == [(1, 1, (1, 3), 1), (2, 2, (2, 4), 2)]


def test_terms_go_on_above_the_highest_one_heard() -> None:
    node = Coordinator(head_on())
    out = tell(node, 0, northbound(0), southbound(0, highest_term=41), apart(0, 3))
    assert [e.term for e in elections(out)] == [42]


def test_a_higher_term_heard_does_not_change_an_election_in_force() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0))
    out: list[Message] = []
    for now_ns in range(UPDATE_NS, S, UPDATE_NS):
        out += tell(node, now_ns, northbound(now_ns, highest_term=7), southbound(now_ns))
    assert [e.term for e in elections(out)] == [1]


def test_a_silent_lowest_id_is_not_elected() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0))
    out = tell(node, 1600 * MS, southbound(1600 * MS))
    assert [(e.term, e.members, e.computing) for e in elections(out)] == [(1, (1, 2), 2)]


def test_the_limit_of_silence_is_that_of_the_scenario() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0))
    out = tell(node, 1400 * MS, southbound(1400 * MS))
    assert [e.computing for e in elections(out)] == [1]


def test_a_computing_uav_that_falls_silent_is_replaced_in_a_new_term() -> None:
    node = Coordinator(head_on())
    out: list[Message] = []
    for now_ns in range(0, 4 * S, UPDATE_NS):
        heard = [southbound(now_ns)]
        if now_ns <= S:
            heard.append(northbound(now_ns))
        out += tell(node, now_ns, *heard)
    found = elections(out)
    assert {(e.term, e.computing) for e in found} == {(1, 1), (2, 2)}
    assert min(e.t_ns for e in found if e.term == 2) == 2600 * MS  # 1 s + 1.5 s, next update


def test_a_track_that_timed_out_is_in_no_conflict() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0))
    assert elections(tell(node, 5200 * MS, southbound(5200 * MS))) == []


def test_elections_are_held_at_updates_only() -> None:
    node = Coordinator(head_on())
    assert tell(node, 100 * MS, northbound(100 * MS), southbound(100 * MS)) == []
    assert len(elections(tell(node, 200 * MS))) == 1


@pytest.mark.parametrize("issuer", [1, 3])
def test_a_uav_under_command_stays_with_its_issuer(issuer: int) -> None:
    under = adsb(
        2,
        (0.0, 20_000.0, -300.0),
        escape="turn",
        command_term=1,
        command_issuer=issuer,
        command_number=1,
    )
    out = tell(Coordinator(head_on()), 0, northbound(0), under, apart(0, 3))
    pair = tuple(sorted((2, issuer)))
    assert [(e.members, e.computing) for e in elections(out)] == [(pair, pair[0])]


@pytest.mark.parametrize("issuer", [2, 9])
def test_a_uav_commanded_by_itself_or_by_nobody_present_makes_no_group(issuer: int) -> None:
    under = adsb(
        2, (0.0, 20_000.0, -300.0), escape="turn", command_term=1, command_issuer=issuer,
        command_number=1,
    )  # fmt: skip
    assert tell(Coordinator(head_on()), 0, northbound(0), under) == []


def test_the_order_of_broadcasts_does_not_matter() -> None:
    heard = [northbound(0), southbound(0), southbound(0, 3, 300.0), apart(0, 4)]
    first = tell(Coordinator(head_on()), 0, *heard)
    assert tell(Coordinator(head_on()), 0, *reversed(heard)) == first
