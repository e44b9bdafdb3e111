"""Runs in memory of which nobody keeps a record: the same flights, elections and commands."""

from __future__ import annotations

import msgspec
import pytest

from fleet.config.loading import convert, read_scenario
from fleet.config.scenario import Scenario, Uav
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.loss import Loss
from fleet.fuzz.cases import case_of
from fleet.protocol.codec import decode, encode
from fleet.protocol.messages import DeliveryReport, Done, Message
from fleet.simulation.in_memory import run_in_memory
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage

FOR_THE_RECORD = (DeliveryReport, Done)


class Kept(RunRecorder):
    """Keeps what it is given, tick by tick."""

    def __init__(self, scenario: Scenario, *, digested: bool) -> None:
        super().__init__(scenario, None, digested=digested)
        self.items: list[ReceivedMessage] = []

    def note(self, item: ReceivedMessage, log_ns: int) -> None:
        self.items.append(item)
        super().note(item, log_ns)

    @property
    def told(self) -> list[Message]:
        """All messages but those that are for the record alone."""
        return [m for _, _, m in self.items if not isinstance(m, FOR_THE_RECORD)]


def flown(scenario: Scenario, *, digested: bool) -> Kept:
    kept = Kept(scenario, digested=digested)
    for _ in run_in_memory(scenario, kept):
        pass
    return kept


def four_way_with_faults() -> Scenario:
    """Links that lose, and a process that dies and comes again while it computes."""
    scenario = read_scenario("four_way", ["duration_s=90"]).scenario
    faults = (Loss(probability=0.3), Kill(node="1", start_s=32.0, end_s=37.0))
    return msgspec.structs.replace(scenario, fault=faults)


def with_whole_numbers() -> Scenario:
    """UAVs as somebody writes them in code."""
    east = Uav(1, (0, 0, -300), 90, ((0, 1500, -300),), 25)
    west = Uav(2, (0, 1500, -300), -90, ((0, 0, -300),), 25)
    return Scenario("whole_numbers", 40, uav=(east, west))


CASES = {
    "whole numbers": with_whole_numbers(),
    "four_way": read_scenario("four_way", ["duration_s=90"]).scenario,
    "under faults": four_way_with_faults(),
    **{f"fuzz {seed}": convert(case_of(seed), f"case {seed}") for seed in (7, 11, 23)},
}


@pytest.mark.parametrize("scenario", CASES.values(), ids=CASES)
def test_without_a_record_everything_happens_as_with_one(scenario: Scenario) -> None:
    full, bare = flown(scenario, digested=True), flown(scenario, digested=False)
    assert bare.told == full.told
    assert not any(isinstance(m, FOR_THE_RECORD) for _, _, m in bare.items)
    assert bare.separation.minima() == full.separation.minima()
    assert bare.arrivals.arrivals() == full.arrivals.arrivals()
    assert (bare.tally.issued, bare.tally.terms) == (full.tally.issued, full.tally.terms)
    assert (bare.tally.applied, bare.tally.refused) == (full.tally.applied, full.tally.refused)
    assert (bool(full.digest), bare.digest) == (True, "")


@pytest.mark.parametrize("scenario", CASES.values(), ids=CASES)
def test_a_message_that_is_handed_over_is_the_one_that_its_payload_says(scenario: Scenario) -> None:
    """In memory nobody decodes: what goes by zenoh must not come out otherwise, as 0 for 0.0."""
    items = flown(scenario, digested=True).items
    for topic, payload, message in items:
        decoded = decode(topic, payload)
        assert decoded == message
        assert encode(decoded) == payload
