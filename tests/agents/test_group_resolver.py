"""The group resolver of the computing UAV, and the UAV under command."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import msgspec
import pytest

from fleet.agents.advisory import Advisory, Situation
from fleet.agents.agent import Agent
from fleet.agents.group_resolver import EXTENSION_NS, MARGIN_NS, GroupResolver, RoundResult
from fleet.agents.obedience import FINAL, REFUSAL_REASONS
from fleet.config.scenario import Coordination
from fleet.model.conflict.tracks import ActiveManoeuvre, StateReport
from fleet.model.election import Mandate
from fleet.model.units import GRAVITY_MPS2
from fleet.node.node import InboxMessage
from fleet.protocol.messages import Ack, Command, Decision, Message, StateBroadcast, Truth
from fleet.protocol.surveillance import report_of
from tests.support.samples import MS, S, ack, adsb, command, election, head_on, heartbeat

SCENARIO = head_on()
LEAD_NS, AGAIN_NS, VALID_NS = 200 * MS, 600 * MS, 2 * S
M = TypeVar("M", bound=Message)
TURN = Advisory(2, "turn", heading_rad=-2.5, turn_rad=0.5, stage="axis", manoeuvre_s=10.0)
KEEP = Advisory(2, "keep", stage="keep")
RESUME = Advisory(2, "resume", stage="clear")
MANDATE = Mandate(3, (1, 2), 1, 100 * S)
TURN_RATE_RADPS = GRAVITY_MPS2 * math.tan(math.radians(30.0)) / 25.0


class Script:
    """A resolver that gives the advisories it is told to give."""

    def __init__(self, *advisory: Advisory) -> None:
        self.advisory = advisory
        self.asked: list[Situation] = []

    def resolve(self, situation: Situation) -> Sequence[Advisory]:
        self.asked.append(situation)
        return self.advisory


def group_resolver(
    *advisory: Advisory, mandate: Mandate | None = MANDATE
) -> tuple[GroupResolver, Script]:
    resolver = Script(*advisory)
    made = GroupResolver(1, SCENARIO, resolver)
    if mandate is not None:
        made.appoint(mandate)
    return made, resolver


def report(uav: int, t_ns: int, **changes: Any) -> StateReport:
    """UAV 1 flies north, UAV 2 south towards it."""
    if uav == 1:
        return report_of(adsb(1, (0.0, 0.0, -300.0), 0.0, t_ns))
    return report_of(adsb(uav, (1500.0, 0.0, -300.0), math.pi, t_ns, **changes))


def turning(t_ns: int) -> StateReport:
    """UAV 2 as it flies the turn that TURN makes."""
    return report(2, t_ns, manoeuvre="turn", commanded_heading_rad=-2.5)


def run_round(of: GroupResolver, now_ns: int, other: StateReport | None = None) -> RoundResult:
    return of.run_round(report(1, now_ns), [other or report(2, now_ns)], now_ns)


def only(commands: Sequence[Command]) -> Command:
    (command,) = commands
    return command


# Issuing


def test_an_advisory_becomes_a_command_with_lead_lapse_and_expiry() -> None:
    issued = only(run_round(group_resolver(TURN)[0], 5 * S).commands)
    assert issued == Command(
        id=1,
        seq=0,
        t_ns=5 * S,
        target=2,
        term=3,
        number=1,
        issued_ns=5 * S,
        manoeuvre="turn",
        heading_rad=-2.5,
        turn_rad=0.5,
        climb_mps=0.0,
        level_down_m=0.0,
        start_ns=5 * S + LEAD_NS,
        manoeuvre_end_ns=5 * S + LEAD_NS + 10 * S + MARGIN_NS,
        expiry_ns=5 * S + VALID_NS,
    )


def test_the_same_advisory_is_not_issued_again_while_its_command_waits() -> None:
    made, _ = group_resolver(TURN)
    assert len(run_round(made, 5 * S).commands) == 1
    again = run_round(made, 5 * S + 200 * MS)
    assert again == RoundResult()
    assert run_round(made, 5 * S + 400 * MS) == RoundResult()


@pytest.mark.parametrize(
    "other",
    [
        Advisory(2, "turn", heading_rad=-2.4, turn_rad=0.6, stage="axis"),
        Advisory(2, "climb", heading_rad=-2.5, climb_mps=2.0, stage="other"),
        RESUME,
    ],
)
def test_another_advisory_replaces_the_command_that_waits(other: Advisory) -> None:
    made, resolver = group_resolver(TURN)
    run_round(made, 5 * S)
    resolver.advisory = (other,)
    second = only(run_round(made, 5 * S + 200 * MS).commands)
    assert (second.number, second.manoeuvre) == (2, other.manoeuvre)
    assert [c.number for c in made.repetitions(6 * S)] == [2]


def test_resume_ends_the_manoeuvre_at_its_start() -> None:
    issued = only(run_round(group_resolver(RESUME)[0], 5 * S).commands)
    assert issued.manoeuvre == "resume"
    assert issued.manoeuvre_end_ns == issued.start_ns == 5 * S + LEAD_NS


def test_every_target_gets_its_own_command() -> None:
    made, _ = group_resolver(TURN, replace(TURN, target=1))
    issued = run_round(made, 5 * S).commands
    assert [(c.target, c.number) for c in issued] == [(2, 1), (1, 2)]
    made.on_ack(ack(issued[0]))
    assert [c.target for c in made.repetitions(6 * S)] == [1]


def test_the_resolver_sees_the_group_in_id_order_at_the_start_of_the_commands() -> None:
    made, resolver = group_resolver(mandate=Mandate(3, (1, 2, 3), 1, 100 * S))
    heard = [report(3, 4 * S), report(2, 5 * S)]
    made.run_round(report(1, 5 * S), heard, 5 * S)
    (asked,) = resolver.asked
    assert (asked.computing, asked.members) == (1, (1, 2, 3))
    assert [a.id for a in asked.aircraft] == [1, 2, 3]
    north = [a.state.north_m for a in asked.aircraft]
    assert north == pytest.approx([25.0 * 0.2, 1500.0 - 25.0 * 0.2, 1500.0 - 25.0 * 1.2])


def test_the_resolver_is_given_how_old_each_report_is() -> None:
    """Now, not when the commands start; a report with a time to come is as new as can be."""
    made, resolver = group_resolver()
    heard = [report(2, 5 * S - 300 * MS), report(3, 3 * S), report(4, 6 * S)]
    made.run_round(report(1, 5 * S), heard, 5 * S)
    assert [a.age_s for a in resolver.asked[0].aircraft] == [0.0, 0.3, 2.0, 0.0]


def test_until_it_reports_a_uav_is_believed_to_fly_what_was_commanded() -> None:
    made, resolver = group_resolver(TURN)
    run_round(made, 5 * S)
    believed = []
    for now_ns, other in (
        (5 * S + 200 * MS, report(2, 5 * S + 200 * MS)),
        (5 * S + 400 * MS, report(2, 5 * S + 400 * MS)),
    ):
        run_round(made, now_ns, other)
        believed.append(resolver.asked[-1].aircraft[1].manoeuvre)
    assert believed == [ActiveManoeuvre("turn", -2.5, 0.0), None]


def test_what_is_decided_anew_is_noted_once() -> None:
    made, _ = group_resolver(Advisory(2, "turn", heading_rad=-2.5, least_separation=0.9))
    assert [e.unresolved for e in run_round(made, 5 * S).encounters] == [True]
    assert run_round(made, 5 * S + 200 * MS).encounters == ()


# Mandates


def test_nothing_is_computed_without_a_mandate() -> None:
    made, resolver = group_resolver(TURN, mandate=None)
    assert not made.holds_mandate(5 * S)
    assert run_round(made, 5 * S) == RoundResult()
    assert resolver.asked == []


def test_nothing_is_computed_or_repeated_after_the_mandate_ran_out() -> None:
    made, resolver = group_resolver(TURN, mandate=Mandate(3, (1, 2), 1, 5 * S))
    assert len(run_round(made, 5 * S).commands) == 1
    assert not made.holds_mandate(5 * S + 1)
    assert made.repetitions(6 * S) == []
    assert run_round(made, 6 * S) == RoundResult()
    assert len(resolver.asked) == 1


def test_a_mandate_of_another_uav_ends_the_role() -> None:
    made, _ = group_resolver(TURN)
    run_round(made, 5 * S)
    assert made.appoint(Mandate(4, (1, 2), 2, 100 * S)) is False
    assert not made.holds_mandate(5 * S)
    assert made.repetitions(6 * S) == []


def test_a_higher_term_drops_what_waits_and_asks_for_a_round() -> None:
    made, _ = group_resolver(TURN)
    run_round(made, 5 * S)
    assert made.appoint(Mandate(4, (1, 2), 1, 100 * S)) is True
    assert made.repetitions(6 * S) == []
    issued = only(run_round(made, 6 * S).commands)
    assert (issued.term, issued.number) == (4, 2)


def test_a_repeated_election_keeps_what_waits_and_extends_the_mandate() -> None:
    made, _ = group_resolver(TURN, mandate=Mandate(3, (1, 2), 1, 5 * S))
    run_round(made, 5 * S)
    assert made.appoint(Mandate(3, (1, 2), 1, 9 * S)) is False
    assert made.holds_mandate(9 * S)
    assert [c.number for c in made.repetitions(6 * S)] == [1]


# Repetition


def repeated(made: GroupResolver, from_ns: int, until_ns: int) -> list[tuple[int, Command]]:
    ticks = range(from_ns, until_ns + 1, 100 * MS)
    return [(now_ns, c) for now_ns in ticks for c in made.repetitions(now_ns)]


def test_a_command_is_repeated_unchanged_until_it_expires() -> None:
    made, _ = group_resolver(TURN)
    issued = only(run_round(made, 5 * S).commands)
    found = repeated(made, 5 * S, 10 * S)
    assert [t for t, _ in found] == [5600 * MS, 6200 * MS, 6800 * MS]
    assert all(c == issued for _, c in found)


def test_an_acknowledged_command_is_not_repeated() -> None:
    made, _ = group_resolver(TURN)
    issued = only(run_round(made, 5 * S).commands)
    assert len(repeated(made, 5 * S, 5600 * MS)) == 1
    made.on_ack(ack(issued))
    assert repeated(made, 5700 * MS, 10 * S) == []


@pytest.mark.parametrize("reason", sorted(REFUSAL_REASONS))
def test_a_refusal_ends_the_repetition_if_it_is_final(reason: str) -> None:
    made, _ = group_resolver(TURN)
    made.on_ack(ack(only(run_round(made, 5 * S).commands), reason))
    assert bool(repeated(made, 5 * S, 10 * S)) == (reason not in FINAL)


@pytest.mark.parametrize("reason", ["unknown_term", "no_mandate"])
def test_a_target_that_has_not_heard_the_election_is_commanded_again(reason: str) -> None:
    assert reason not in FINAL
    made, _ = group_resolver(TURN)
    made.on_ack(ack(only(run_round(made, 5 * S).commands), reason))
    assert len(repeated(made, 5 * S, 10 * S)) == 3


@pytest.mark.parametrize("changes", [{"number": 2}, {"term": 2}, {"id": 3}])
def test_an_answer_to_another_command_changes_nothing(changes: dict[str, int]) -> None:
    made, _ = group_resolver(TURN)
    issued = only(run_round(made, 5 * S).commands)
    made.on_ack(msgspec.structs.replace(ack(issued), **changes))
    assert len(repeated(made, 5 * S, 10 * S)) == 3


def test_a_command_refused_for_good_is_issued_anew_if_still_advised() -> None:
    made, _ = group_resolver(TURN)
    made.on_ack(ack(only(run_round(made, 5 * S).commands), "expired"))
    again = only(run_round(made, 5 * S + 200 * MS).commands)
    assert (again.number, again.issued_ns) == (2, 5 * S + 200 * MS)


# Keeping


def test_a_manoeuvre_that_is_still_needed_is_extended_just_before_it_lapses() -> None:
    made, resolver = group_resolver(TURN)
    first = only(run_round(made, 5 * S).commands)
    made.on_ack(ack(first))
    resolver.advisory = (KEEP,)
    found: list[Command] = []
    for now_ns in range(5200 * MS, first.manoeuvre_end_ns, 200 * MS):
        found += run_round(made, now_ns, turning(now_ns)).commands
    extended = found[0]
    assert (
        first.manoeuvre_end_ns - MARGIN_NS < extended.issued_ns < first.manoeuvre_end_ns - LEAD_NS
    )
    assert (extended.manoeuvre, extended.heading_rad, extended.climb_mps) == ("turn", -2.5, 0.0)
    assert extended.manoeuvre_end_ns == extended.start_ns + EXTENSION_NS > first.manoeuvre_end_ns
    assert (extended.number, len(found)) == (2, 1)


def test_an_extension_that_a_new_term_made_stale_is_issued_again_in_that_term() -> None:
    made, resolver = group_resolver(TURN)
    first = only(run_round(made, 5 * S).commands)
    made.on_ack(ack(first))
    resolver.advisory = (KEEP,)
    late_ns = first.manoeuvre_end_ns - S
    lost = only(run_round(made, late_ns, turning(late_ns)).commands)
    made.appoint(Mandate(4, (1, 2), 1, 100 * S))
    again = only(run_round(made, late_ns + 200 * MS, turning(late_ns + 200 * MS)).commands)
    assert (lost.term, again.term) == (3, 4)
    assert again.manoeuvre_end_ns > first.manoeuvre_end_ns


def test_a_manoeuvre_of_an_earlier_computing_uav_is_extended_at_once() -> None:
    made, _ = group_resolver(KEEP)
    extended = only(run_round(made, 5 * S, turning(5 * S)).commands)
    assert (extended.manoeuvre, extended.heading_rad) == ("turn", -2.5)
    assert extended.manoeuvre_end_ns == 5 * S + LEAD_NS + EXTENSION_NS


def test_there_is_nothing_to_keep_without_a_manoeuvre() -> None:
    assert run_round(group_resolver(KEEP)[0], 5 * S).commands == ()


# The whole UAV


def agent_with(*advisory: Advisory) -> tuple[Agent, Script]:
    """UAV 1 and its resolver; elections last as long as they say."""
    resolver = Script(*advisory)
    lasting = msgspec.structs.replace(SCENARIO, coordination=Coordination(election_valid_s=100.0))
    return Agent(SCENARIO.uav[0], lasting, resolver), resolver


def agent(*advisory: Advisory) -> Agent:
    """UAV 1."""
    return agent_with(*advisory)[0]


def fly(
    node: Agent, until_ns: int, heard: Sequence[Message] = (), from_ns: int = 0
) -> list[tuple[int, Message]]:
    """Step tick by tick; messages arrive one tick after they were sent. What was sent, and when.

    The coordinator is there: its heartbeats are heard besides.
    """
    out = []
    heartbeats = [heartbeat(t_ns) for t_ns in range(0, until_ns, 400 * MS)]
    for now_ns in range(from_ns, until_ns + 1, SCENARIO.tick_ns):
        due = [m for m in (*heard, *heartbeats) if now_ns - SCENARIO.tick_ns <= m.t_ns < now_ns]
        inbox = [InboxMessage(m.t_ns + SCENARIO.tick_ns, m) for m in due]
        out += [(now_ns, m) for m in node.step(now_ns, inbox)]
    return out


def sent(cls: type[M], messages: list[tuple[int, Message]]) -> list[M]:
    return [m for _, m in messages if isinstance(m, cls)]


FIRST, TERM, LAST = 4, 8, 12
"""Terms of the coordinator's, in a fleet of three."""
ELECTED = election(TERM, (1, 2), 2, 100 * S)
"""UAV 2 computes; UAV 1, which flies north, is its target in what follows."""


def scheduled(**changes: Any) -> Command:
    """UAV 2 tells UAV 1 to turn east, from a moment within a tick until another one."""
    wanted: dict[str, Any] = {
        "id": 2,
        "target": 1,
        "term": TERM,
        "t_ns": 0,
        "issued_ns": 0,
        "start_ns": 250 * MS,
        "manoeuvre_end_ns": 1234 * MS,
        "expiry_ns": 2 * S,
    }
    return command(**{**wanted, **changes})


def headings(messages: list[tuple[int, Message]]) -> dict[int, float]:
    return {m.t_ns: m.heading_rad for m in sent(Truth, messages)}


def test_a_manoeuvre_starts_exactly_at_its_start_within_a_tick() -> None:
    heading = headings(fly(agent(), S, [ELECTED, scheduled()]))
    assert heading[200 * MS] == pytest.approx(0.0, abs=1e-12)
    assert heading[300 * MS] == pytest.approx(0.05 * TURN_RATE_RADPS)
    assert heading[S] == pytest.approx(0.75 * TURN_RATE_RADPS)


def test_a_manoeuvre_lapses_exactly_at_its_end_within_a_tick() -> None:
    heading = headings(fly(agent(), 2 * S, [ELECTED, scheduled()]))
    turned = 1.234 - 0.25
    assert heading[1200 * MS] == pytest.approx(0.95 * TURN_RATE_RADPS)
    assert heading[1300 * MS] == pytest.approx((turned - (1.3 - 1.234)) * TURN_RATE_RADPS)


def test_the_mode_says_what_is_flown() -> None:
    modes = {m.t_ns: m.mode for m in sent(Truth, fly(agent(), 2 * S, [ELECTED, scheduled()]))}
    assert {t for t, mode in modes.items() if mode == "turn"} == set(
        range(300 * MS, 1201 * MS, 100 * MS)
    )
    assert {mode for mode in modes.values() if mode != "turn"} == {"plan"}


def test_a_command_is_accepted_with_the_time_at_which_it_starts() -> None:
    (answer,) = sent(Ack, fly(agent(), S, [ELECTED, scheduled()]))
    assert answer == Ack(1, 0, 100 * MS, 2, TERM, 1, 0, True, "", 250 * MS)


def test_a_command_that_comes_after_its_start_starts_when_it_is_accepted() -> None:
    messages = fly(agent(), S, [ELECTED, scheduled(t_ns=400 * MS)])
    (answer,) = sent(Ack, messages)
    assert (answer.accepted, answer.actuate_ns) == (True, 500 * MS)
    heading = headings(messages)
    assert heading[500 * MS] == pytest.approx(0.0, abs=1e-12)
    assert heading[600 * MS] == pytest.approx(0.1 * TURN_RATE_RADPS)


def test_the_command_in_force_is_broadcast_and_forgotten_when_it_lapses() -> None:
    told = {
        m.t_ns: ((m.command_term, m.command_issuer, m.command_number), m.manoeuvre)
        for m in sent(StateBroadcast, fly(agent(), 2 * S, [ELECTED, scheduled(number=7)]))
    }
    assert told[200 * MS] == ((0, 0, 0), "")
    assert told[400 * MS] == told[1200 * MS] == ((TERM, 2, 7), "turn")
    assert told[1400 * MS] == ((0, 0, 0), "")


def test_the_broadcast_tells_the_commanded_heading_and_guidances_own() -> None:
    (then,) = [
        m for m in sent(StateBroadcast, fly(agent(), S, [ELECTED, scheduled()])) if m.t_ns == S
    ]
    assert then.commanded_heading_rad == math.pi / 2
    assert then.guidance_heading_rad < 0.0  # back to the left


def test_a_repetition_is_acknowledged_as_a_duplicate_and_changes_nothing() -> None:
    again = scheduled(seq=1, t_ns=600 * MS)
    messages = fly(agent(), 2 * S, [ELECTED, scheduled(), again])
    answers = sent(Ack, messages)
    assert [(a.accepted, a.reason, a.actuate_ns) for a in answers] == [
        (True, "", 250 * MS),
        (False, "duplicate", 0),
    ]
    assert headings(messages) == headings(fly(agent(), 2 * S, [ELECTED, scheduled()]))


def test_a_later_command_replaces_the_manoeuvre_in_force() -> None:
    resume = scheduled(number=2, t_ns=400 * MS, manoeuvre="resume", start_ns=650 * MS)
    messages = fly(agent(), S, [ELECTED, scheduled(), resume])
    modes = {m.t_ns: m.mode for m in sent(Truth, messages)}
    assert (modes[600 * MS], modes[700 * MS]) == ("turn", "plan")
    assert headings(messages)[700 * MS] == pytest.approx((0.4 - 0.05) * TURN_RATE_RADPS)


@pytest.mark.parametrize(
    ("heard", "reason"),
    [
        ([scheduled()], "no_mandate"),
        ([ELECTED, scheduled(id=3)], "wrong_issuer"),
        ([ELECTED, scheduled(term=FIRST)], "stale_term"),
        ([ELECTED, scheduled(term=LAST)], "unknown_term"),
        ([ELECTED, scheduled(expiry_ns=99 * MS)], "expired"),
        ([ELECTED, scheduled(manoeuvre="loop")], "unknown_manoeuvre"),
        ([election(TERM, (2, 3), 2, 100 * S), scheduled()], "no_mandate"),
        ([election(TERM, (1, 2), 2, 99 * MS), scheduled()], "no_mandate"),
    ],
)
def test_a_command_that_is_not_valid_is_refused_and_not_flown(
    heard: list[Message], reason: str
) -> None:
    messages = fly(agent(), S, heard)
    (answer,) = sent(Ack, messages)
    assert (answer.accepted, answer.reason, answer.actuate_ns) == (False, reason, 0)
    assert {m.mode for m in sent(Truth, messages)} == {"plan"}


def test_an_election_of_a_lower_term_does_not_replace_a_higher_one() -> None:
    older = election(FIRST, (1, 3), 3, 100 * S, t_ns=50 * MS)
    (answer,) = sent(Ack, fly(agent(), S, [ELECTED, older, scheduled(t_ns=150 * MS)]))
    assert answer.accepted


def test_the_highest_term_heard_is_broadcast_even_of_other_groups() -> None:
    others = election(LAST, (3, 4), 3, 100 * S)
    terms = {
        m.t_ns: m.highest_term for m in sent(StateBroadcast, fly(agent(), S, [ELECTED, others]))
    }
    assert (terms[0], terms[200 * MS], terms[S]) == (0, LAST, LAST)


def test_an_elected_uav_repeats_its_command_with_new_sequence_number_and_time_only() -> None:
    heard: list[Message] = [adsb(2, (1500.0, 0.0, -300.0), math.pi, 0)]
    heard.append(election(FIRST, (1, 2), 1, 100 * S))
    found = sent(Command, fly(agent(TURN), 2 * S, heard))
    assert [m.t_ns for m in found] == [100 * MS + k * AGAIN_NS for k in range(4)]
    assert [m.seq for m in found] == [0, 1, 2, 3]
    assert {msgspec.structs.replace(m, seq=0, t_ns=0) for m in found} == {
        msgspec.structs.replace(found[0], seq=0, t_ns=0)
    }


def test_a_command_that_expired_unanswered_is_issued_anew() -> None:
    found = sent(Command, fly(agent(TURN), 3 * S, [election(FIRST, (1, 2), 1, 100 * S)]))
    second = next(m for m in found if m.number == 2)
    first_round_after_expiry = 2200 * MS
    assert second.t_ns == second.issued_ns == first_round_after_expiry


def test_an_answered_command_is_not_repeated() -> None:
    node, resolver = agent_with(TURN)
    issued = only(sent(Command, fly(node, 200 * MS, [election(FIRST, (1, 2), 1, 100 * S)])))
    resolver.advisory = ()
    later = fly(node, 3 * S, [ack(issued, t_ns=200 * MS)], from_ns=300 * MS)
    assert sent(Command, later) == []


def test_an_elected_uav_logs_its_decision_with_its_term() -> None:
    messages = fly(agent(TURN), S, [election(FIRST, (1, 2), 1, 100 * S)])
    (found,) = sent(Decision, messages)
    assert (found.term, [e.target for e in found.encounters]) == (FIRST, [2])


def test_an_elected_uav_computes_at_once_and_then_at_updates() -> None:
    node, resolver = agent_with()
    asked = []
    for now_ns in range(0, 401 * MS, 100 * MS):
        fly(node, now_ns, [election(FIRST, (1, 2), 1, 100 * S)], from_ns=now_ns)
        asked.append(len(resolver.asked))
    assert asked == [0, 1, 2, 2, 3]


def test_a_uav_that_is_not_elected_never_computes() -> None:
    assert sent(Command, fly(agent(TURN), S, [ELECTED])) == []
    assert sent(Command, fly(agent(TURN), S)) == []
