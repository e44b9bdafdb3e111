"""The coordinator: who is elected when, in which term, and for how long."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest

from fleet.config.scenario import Scenario, Surveillance
from fleet.coordinator.coordinator import Coordinator
from fleet.node.node import InboxMessage, RestartState
from fleet.protocol.messages import (
    Conflict,
    Election,
    Heartbeat,
    Message,
    PersistentState,
    StateBroadcast,
)
from tests.support.samples import MS, S, adsb, head_on

UPDATE_NS = 200 * MS
SOUTH = math.pi
FIRST, SECOND = 4, 8
"""The coordinator's terms in a fleet of three."""


def four() -> Scenario:
    """The same with a fourth UAV."""
    scenario = head_on()
    fourth = msgspec.structs.replace(scenario.uav[2], id=4, position_ned_m=(9e4, 0.0, -300.0))
    return msgspec.structs.replace(scenario, uav=(*scenario.uav, fourth))


def northbound(t_ns: int, uav: int = 1, **changes: Any) -> StateBroadcast:
    """At the origin at time 0, flying north at 25 m/s."""
    return adsb(uav, (25.0 * t_ns / S, 0.0, -300.0), 0.0, t_ns, **changes)


def southbound(t_ns: int, uav: int = 2, east_m: float = 0.0, **changes: Any) -> StateBroadcast:
    """1500 m north of the origin at time 0, flying south at 25 m/s."""
    return adsb(uav, (1500.0 - 25.0 * t_ns / S, east_m, -300.0), SOUTH, t_ns, **changes)


def parting(t_ns: int, uav: int) -> StateBroadcast:
    """Where northbound UAV 1 or southbound UAV 2 is, but flying the other way."""
    here = northbound(t_ns) if uav == 1 else southbound(t_ns)
    return adsb(uav, here.position_ned_m, here.heading_rad + SOUTH, t_ns)


def apart(t_ns: int, uav: int) -> StateBroadcast:
    """So far from the rest that it meets nobody."""
    return adsb(uav, (0.0, 50_000.0 * uav, -300.0), 0.0, t_ns)


def tell(node: Coordinator, now_ns: int, *heard: StateBroadcast) -> list[Message]:
    """Step the coordinator with broadcasts that reach it now."""
    return node.step(now_ns, [InboxMessage(now_ns, m) for m in heard])


def elections(messages: list[Message]) -> list[Election]:
    return [m for m in messages if isinstance(m, Election)]


def conflicts(messages: list[Message]) -> list[Conflict]:
    return [m for m in messages if isinstance(m, Conflict)]


def found_of(messages: list[Message]) -> list[Message]:
    """All but what the coordinator says of itself."""
    return [m for m in messages if not isinstance(m, Heartbeat | PersistentState)]


def test_a_head_on_pair_gets_one_election_of_the_lowest_id() -> None:
    out = tell(Coordinator(head_on()), 0, northbound(0), southbound(0), apart(0, 3))
    assert elections(out) == [Election(0, 0, 0, FIRST, 1, (1, 2), 1, 2 * S)]


def test_the_conflict_is_told_with_its_time_to_violation() -> None:
    out = tell(Coordinator(head_on()), 0, northbound(0), southbound(0), apart(0, 3))
    (found,) = conflicts(out)
    assert found.pairs == ((1, 2),)
    # 1500 m apart, 400 m required, closing at 50 m/s; the alert is a little wider, so earlier.
    assert 20.0 < found.time_to_violation_s[0] <= 22.0


def test_traffic_that_does_not_meet_gets_no_election() -> None:
    out = tell(Coordinator(head_on()), 0, northbound(0), apart(0, 2), apart(0, 3))
    assert found_of(out) == []


def test_an_election_is_repeated_in_its_term_and_lasts_longer_each_time() -> None:
    node = Coordinator(head_on())
    out: list[Message] = []
    for now_ns in range(0, 2 * S, UPDATE_NS):
        out += tell(node, now_ns, northbound(now_ns), southbound(now_ns))
    found = elections(out)
    assert [e.t_ns for e in found] == [0, 600 * MS, 1200 * MS, 1800 * MS]
    assert [e.seq for e in found] == [0, 1, 2, 3]
    assert {(e.term, e.group, e.members, e.computing) for e in found} == {(FIRST, 1, (1, 2), 1)}
    assert all(e.valid_until_ns == e.t_ns + 2 * S for e in found)
    assert len(conflicts(out)) == 1


def test_an_election_is_valid_until_after_the_next_repetition() -> None:
    scenario = head_on()
    assert scenario.coordination.election_valid_s > 2 * scenario.coordination.election_repeat_s


def test_elections_end_a_while_after_the_conflict_and_a_new_conflict_is_a_new_term() -> None:
    node = Coordinator(head_on())
    assert elections(tell(node, 0, northbound(0), southbound(0)))
    quiet: list[Message] = []
    for now_ns in range(UPDATE_NS, 4 * S, UPDATE_NS):
        quiet += tell(node, now_ns, parting(now_ns, 1), parting(now_ns, 2))
    hold_ns = round(head_on().coordination.group_hold_s * S)
    assert [(c.t_ns, c.pairs) for c in conflicts(quiet)] == [(UPDATE_NS, ())]
    assert {e.term for e in elections(quiet)} == {FIRST}
    assert max(e.t_ns for e in elections(quiet)) == 1800 * MS <= hold_ns
    again = tell(node, 4 * S, northbound(4 * S), southbound(4 * S))
    assert [(e.term, e.t_ns) for e in elections(again)] == [(SECOND, 4 * S)]


def test_a_conflict_that_is_lost_for_a_moment_stays_in_its_term() -> None:
    node = Coordinator(head_on())
    out: list[Message] = []
    for n, now_ns in enumerate(range(0, 4 * S, UPDATE_NS)):
        pair = (parting(now_ns, 1), parting(now_ns, 2)) if n % 2 else ()
        out += tell(node, now_ns, *(pair or (northbound(now_ns), southbound(now_ns))))
    assert len(conflicts(out)) == 20
    assert {(e.term, e.members) for e in elections(out)} == {(FIRST, (1, 2))}


def test_a_group_that_grows_is_a_new_term_at_once() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0), southbound(0, 3, east_m=450.0))
    third = southbound(UPDATE_NS, 3, east_m=450.0)
    out = tell(node, UPDATE_NS, northbound(UPDATE_NS), southbound(UPDATE_NS), third)
    assert elections(out) == []  # 450 m beside UAV 2 the third meets nobody
    now_ns = 2 * UPDATE_NS
    third = southbound(now_ns, 3, east_m=370.0)
    out = tell(node, now_ns, northbound(now_ns), southbound(now_ns), third)
    assert [(e.term, e.members, e.computing) for e in elections(out)] == [(SECOND, (1, 2, 3), 1)]


def test_separate_groups_get_their_own_elections() -> None:
    out = tell(
        Coordinator(four()),
        0,
        northbound(0, 4),
        southbound(0, 2),
        adsb(3, (0.0, 50_000.0, -300.0), 0.0),
        adsb(1, (1500.0, 50_000.0, -300.0), SOUTH),
    )
    found = [(e.term, e.group, e.members, e.computing) for e in elections(out)]
    assert found == [(5, 1, (1, 3), 1), (10, 2, (2, 4), 2)]


def test_terms_go_on_above_the_highest_one_heard() -> None:
    node = Coordinator(head_on())
    out = tell(node, 0, northbound(0), southbound(0, highest_term=41), apart(0, 3))
    assert [e.term for e in elections(out)] == [44]


def test_a_higher_term_heard_does_not_change_an_election_in_force() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0))
    out: list[Message] = []
    for now_ns in range(UPDATE_NS, S, UPDATE_NS):
        out += tell(node, now_ns, northbound(now_ns, highest_term=7), southbound(now_ns))
    assert [e.term for e in elections(out)] == [FIRST]


@pytest.mark.parametrize("member", [1, 2])
def test_an_election_that_a_member_is_no_longer_under_is_renewed_above_it(member: int) -> None:
    """Somebody else has been elected meanwhile: the member obeys the higher term."""
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0))
    under = {"mandate_term": 5, "highest_term": 5}
    one = northbound(UPDATE_NS, **(under if member == 1 else {}))
    two = southbound(UPDATE_NS, **(under if member == 2 else {}))
    out = tell(node, UPDATE_NS, one, two)
    assert [(e.term, e.members) for e in elections(out)] == [(SECOND, (1, 2))]
    later = 2 * UPDATE_NS
    under = {"mandate_term": SECOND, "highest_term": SECOND}
    settled = tell(node, later, northbound(later, **under), southbound(later, **under))
    assert elections(settled) == []


def test_what_the_term_of_a_stranger_is_under_changes_nothing() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), southbound(0), apart(0, 3))
    third = msgspec.structs.replace(apart(UPDATE_NS, 3), mandate_term=7, highest_term=7)
    out = tell(node, UPDATE_NS, northbound(UPDATE_NS), southbound(UPDATE_NS), third)
    assert elections(out) == []


def test_a_silent_lowest_id_is_not_elected() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0))
    out = tell(node, 1600 * MS, southbound(1600 * MS))
    assert [(e.term, e.members, e.computing) for e in elections(out)] == [(FIRST, (1, 2), 2)]


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
    assert {(e.term, e.computing) for e in found} == {(FIRST, 1), (SECOND, 2)}
    assert min(e.t_ns for e in found if e.term == SECOND) == 2600 * MS  # 1 s + 1.5 s, next update


@pytest.mark.parametrize(("timeout_s", "elected"), [(5.0, []), (6.0, [2])])
def test_a_track_that_timed_out_is_in_no_conflict(timeout_s: float, elected: list[int]) -> None:
    node = Coordinator(head_on(surveillance=Surveillance(timeout_s=timeout_s)))
    tell(node, 0, northbound(0))
    found = elections(tell(node, 5200 * MS, southbound(5200 * MS)))
    assert [e.computing for e in found] == elected


def test_a_track_lasts_two_minutes_unless_the_scenario_says_otherwise() -> None:
    assert head_on().surveillance.timeout_s == 120.0


def test_elections_are_held_at_updates_only() -> None:
    node = Coordinator(head_on())
    assert found_of(tell(node, 0)) == []
    assert tell(node, 100 * MS, northbound(100 * MS), southbound(100 * MS)) == []
    assert len(elections(tell(node, 200 * MS))) == 1


@pytest.mark.parametrize("issuer", [1, 3])
def test_a_uav_under_command_stays_with_its_issuer(issuer: int) -> None:
    under = adsb(
        2,
        (0.0, 20_000.0, -300.0),
        manoeuvre="turn",
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
        2, (0.0, 20_000.0, -300.0), manoeuvre="turn", command_term=1, command_issuer=issuer,
        command_number=1,
    )  # fmt: skip
    assert found_of(tell(Coordinator(head_on()), 0, northbound(0), under)) == []


def test_the_order_of_broadcasts_does_not_matter() -> None:
    heard = [northbound(0), southbound(0), southbound(0, 3, 300.0), apart(0, 4)]
    first = tell(Coordinator(head_on()), 0, *heard)
    assert tell(Coordinator(head_on()), 0, *reversed(heard)) == first


# Heartbeats, memory and restarts


def kinds_of(cls: type[Message], messages: list[Message]) -> list[Message]:
    return [m for m in messages if isinstance(m, cls)]


def test_heartbeats_come_at_their_times_with_the_highest_term_whoever_is_there() -> None:
    node = Coordinator(head_on())
    out: list[Message] = []
    for now_ns in range(0, S + 1, 100 * MS):
        heard = [northbound(now_ns, highest_term=6)] if now_ns == 500 * MS else []
        out += tell(node, now_ns, *heard)
    assert kinds_of(Heartbeat, out) == [
        Heartbeat(0, 0, 0, 0),
        Heartbeat(0, 1, 400 * MS, 0),
        Heartbeat(0, 2, 800 * MS, 6),
    ]


def test_a_new_highest_term_is_remembered_when_it_is_used_or_heard() -> None:
    node = Coordinator(head_on())
    assert kinds_of(PersistentState, tell(node, 0, northbound(0), southbound(0))) == [
        PersistentState(0, 0, 0, FIRST, 0, 0, 0)
    ]
    now_ns = UPDATE_NS
    assert (
        kinds_of(PersistentState, tell(node, now_ns, northbound(now_ns), southbound(now_ns))) == []
    )
    now_ns = 2 * UPDATE_NS
    heard = (northbound(now_ns, highest_term=9), southbound(now_ns))
    assert kinds_of(PersistentState, tell(node, now_ns, *heard)) == [
        PersistentState(0, 1, now_ns, 9, 0, 0, 0)
    ]


@pytest.mark.parametrize(("remembered", "heard", "term"), [(7, 0, 8), (8, 0, 12), (7, 14, 16)])
def test_a_coordinator_that_returns_goes_on_above_what_it_remembers_and_hears(
    remembered: int, heard: int, term: int
) -> None:
    restart = RestartState(1, 10 * S, PersistentState(0, 3, 5 * S, remembered, 0, 0, 0))
    node = Coordinator(head_on(), restart)
    now_ns = 10 * S + 200 * MS
    out = tell(node, now_ns, northbound(now_ns, highest_term=heard), southbound(now_ns))
    assert [e.term for e in elections(out)] == [term]


def test_a_new_incarnation_counts_its_messages_from_a_thousand_million_on() -> None:
    incarnation = 3
    node = Coordinator(head_on(), RestartState(incarnation, 10 * S, None))
    out = tell(node, 10 * S + 400 * MS, northbound(0), southbound(0))
    assert {type(m) for m in out} == {Conflict, Election, Heartbeat, PersistentState}
    assert {m.seq for m in out} == {incarnation * 10**9}


def test_a_broadcast_that_cannot_be_true_is_named_and_not_used() -> None:
    node = Coordinator(head_on())
    tell(node, 0, northbound(0), apart(0, 2))
    out = tell(node, UPDATE_NS, northbound(UPDATE_NS), southbound(UPDATE_NS))
    assert elections(out) == []
    assert list(node.implausible) == [(2, 1)]
    tell(node, 2 * UPDATE_NS)
    assert list(node.implausible) == []
