"""The state tables of a mandate and of a command, held against what the nodes do."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from fleet.agents.command_exchange import CommandExchange
from fleet.agents.command_states import COMMAND_STATES, CommandEvent, CommandState
from fleet.agents.mandate_states import MANDATE_STATES, MandateEvent, MandateState
from fleet.agents.voting import Voter
from fleet.model.conflict.tracks import CommandId
from fleet.protocol.messages import Command, PersistentState
from tests.support.samples import MS, S, ack, command, election, head_on

OWN = 2
SCENARIO = head_on()
(UAV,) = [u for u in SCENARIO.uav if u.id == OWN]
TERMS = tuple(n * (1 + len(SCENARIO.uav)) for n in (1, 2, 3))
"""Of the coordinator."""

Action = tuple[str, int, int]
ACTIONS = st.one_of(
    st.tuples(st.just("names"), st.sampled_from(TERMS), st.integers(-2, 3)),
    st.tuples(st.just("appoints"), st.sampled_from(TERMS), st.integers(-2, 3)),
    st.tuples(st.just("passes over"), st.sampled_from(TERMS), st.integers(0, 3)),
    st.tuples(st.just("clock"), st.integers(-3, 3), st.just(0)),
    st.tuples(st.just("restart"), st.just(0), st.just(0)),
)


class Model:
    """What the table says of a UAV: an own account of the highest term and of its end."""

    def __init__(self) -> None:
        self.state = MandateState.NONE
        self.term = self.until_ns = self.heard_ns = 0
        self.elected = MandateEvent.IGNORED

    def happens(self, event: MandateEvent) -> None:
        """Go on by the table."""
        self.state = MANDATE_STATES[self.state, event]

    def hear(self, what: str, term: int, until_ns: int, now_ns: int) -> None:
        """An election by the coordinator."""
        if what == "passes over" or term < self.term:
            self.happens(MandateEvent.IGNORED)
            return
        known = term == self.term and self.state is not MandateState.NONE
        self.until_ns = max(until_ns, self.until_ns if known else 0)
        self.until_ns = min(self.until_ns, now_ns + VALID_NS)
        self.term, self.heard_ns = term, now_ns
        self.elected = MandateEvent.NAMED if what == "names" else MandateEvent.APPOINTED
        self.happens(self.elected)

    def look(self, now_ns: int) -> None:
        """Time has passed, or the clock was set."""
        in_time = self.heard_ns <= now_ns <= self.until_ns
        if not in_time:
            self.happens(MandateEvent.RUN_OUT)
        elif self.state is MandateState.LAPSED:  # the clock was set back into its time
            self.happens(self.elected)


VALID_NS = SCENARIO.election_timing().valid_ns


@given(st.lists(ACTIONS, max_size=12))
def test_a_mandate_goes_by_its_table(actions: list[Action]) -> None:
    voter, model, now_ns = Voter(UAV, SCENARIO), Model(), 10 * S
    computing: dict[int, str] = {}
    for what, number, later in actions:
        match what:
            case "clock":
                now_ns += number * VALID_NS // 2
            case "restart":
                memory = PersistentState(OWN, 0, now_ns, 0, model.term, 0, 0)
                voter = Voter(UAV, SCENARIO, memory)
                model.happens(MandateEvent.RESTARTED)
            case _:
                if what != "passes over":  # who computes does not change within a term
                    what = computing.setdefault(number, what)  # noqa: PLW2901
                members = {"names": (1, 2), "appoints": (2, 3), "passes over": (1, 3)}[what]
                until_ns = now_ns + later * VALID_NS // 2
                voter.on_election(election(number, members, members[0], until_ns), now_ns)
                model.hear(what, number, until_ns, now_ns)
        model.look(now_ns)
        assert voter.state(now_ns) is model.state


def test_what_is_decided_for_good_never_counts_again() -> None:
    for state in (CommandState.REFUSED, CommandState.SUPERSEDED):
        assert {COMMAND_STATES[state, event] for event in CommandEvent} == {state}
    into_sent = {s for (s, _), after in COMMAND_STATES.items() if after is CommandState.SENT}
    assert into_sent == {CommandState.SENT}


ANSWERS = st.sampled_from(["accepted", "flown", "stale_term", "no_mandate", "late", "new term"])


@given(st.lists(st.tuples(st.integers(0, 5), ANSWERS), max_size=20))
def test_the_last_command_is_the_one_on_its_way_or_the_latest_received(
    happenings: list[tuple[int, str]],
) -> None:
    exchange, sent, now_ns = CommandExchange(200 * MS), list[Command](), 0
    received, lost, waiting = -1, set[int](), False
    for which, what in happenings:
        if which >= len(sent):
            now_ns += S
            new = command(number=len(sent), issued_ns=now_ns, expiry_ns=now_ns + S)
            sent.append(new)
            exchange.send(new)
            waiting = True
        index = min(which, len(sent) - 1)
        match what:
            case "accepted":
                exchange.on_ack(ack(sent[index]))
            case "flown":
                exchange.on_flown(CommandId(sent[index].term, sent[index].id, sent[index].number))
            case "late":
                exchange.repetition(now_ns + 2 * S)
                waiting = False
            case "new term":
                exchange.on_new_term()
                waiting = False
            case reason:
                exchange.on_ack(ack(sent[index], accepted=False, reason=reason))
        if what in ("accepted", "flown") and index > received and index not in lost:
            received = index
            waiting &= index != len(sent) - 1
        if what == "stale_term" and index > received:
            lost.add(index)
            waiting &= index != len(sent) - 1
        expected = sent[-1] if waiting else sent[received] if received >= 0 else None
        assert (exchange.last, exchange.waits) == (expected, waiting)
