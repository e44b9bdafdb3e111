"""How long rounds of the resolver take: measured, told at the end, and in no digest."""

from __future__ import annotations

import itertools

import pytest

from fleet.agents.agent import Agent
from fleet.agents.resolvers import load_resolver
from fleet.cli.result import rounds_words
from fleet.model.words import ClockMode
from fleet.node.gate import Gate
from fleet.node.node import InboxMessage
from fleet.protocol import codec
from fleet.protocol.sample import Sample
from fleet.simulation.listener import Listener, OwnMessages
from fleet.simulation.result import result_json
from fleet.simulation.run_recorder import RunRecorder
from fleet.simulation.simulation import RunOptions, RunOutcome
from tests.support.samples import MS, S, election, head_on, truth


class Sink:
    """Remembers the topics on which records came."""

    def __init__(self) -> None:
        self.topics: list[str] = []

    def write(self, topic: str, _payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        assert min(seq, sent_ns, log_ns) >= 0
        self.topics.append(topic)


def test_what_took_longer_than_the_update_period_is_counted() -> None:
    scenario = head_on()
    recorder = RunRecorder(scenario, None)
    for took_ns in (10 * MS, 200 * MS, 201 * MS, 900 * MS):
        recorder.tell_round(S, 1, took_ns)
    outcome = RunOutcome(RunOptions(scenario, clock=ClockMode.REALTIME), recorder)
    rounds = result_json(outcome)["rounds"]
    assert scenario.coordination.update_s == 0.2
    assert (rounds["count"], rounds["too_long"]) == (4, 2)
    assert rounds["max"] == pytest.approx(0.9)
    assert "2 longer than the update period" in rounds_words(rounds)
    assert "longer" not in rounds_words({**rounds, "too_long": 0})


def test_a_round_is_recorded_but_changes_no_digest() -> None:
    digests = []
    for round_ns in (0, 5 * MS):
        sink = Sink()
        recorder = RunRecorder(head_on(), sink)
        listener = Listener(Gate(head_on()), recorder, OwnMessages(), 100 * MS)
        message = truth(1, (0.0, 0.0, -300.0), 0)
        arrival = Sample("1/truth", codec.encode(message), round_ns=round_ns)
        item = listener.hear(arrival, 0)
        assert item is not None
        recorder.close(0, 0, [item])
        assert sink.topics.count("sim/round_time") == (1 if round_ns else 0)
        digests.append(recorder.digest)
    assert digests[0] == digests[1] != ""


def test_a_uav_measures_the_round_alone_that_it_runs() -> None:
    scenario = head_on()
    agent = Agent(scenario.uav[0], scenario, load_resolver(scenario))
    ticks = itertools.count(0, 7 * MS)
    agent.stopwatch = lambda: next(ticks)
    agent.step(0, [])
    assert agent.round_ns == 0
    elected = election(4, (1, 2), 1, 10 * S)
    agent.step(100 * MS, [InboxMessage(100 * MS, elected)])
    assert agent.round_ns == 7 * MS
    agent.step(150 * MS, [])
    assert agent.round_ns == 0
