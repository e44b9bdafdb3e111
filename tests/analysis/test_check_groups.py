"""The invariants of groups and of commands as they are sent, on small runs."""

from __future__ import annotations

import msgspec
import pytest

from fleet.analysis.invariants import Verdict
from fleet.config.scenario import Commands, Coordination
from fleet.model.units import to_ns
from tests.analysis.test_check_histories import run_builder
from tests.analysis.test_check_story import (
    RecordedRunBuilder,
    apart,
    broadcast,
    elect,
    good,
    make_command,
    obey,
)
from tests.support import samples


class TestGroupsBelongTogether:
    name = "groups belong together"

    def test_one_that_nothing_binds(self) -> None:
        told = run_builder()
        told.picture(to_ns(0.4), (1, 2))
        told.tell_alone(elect(4, (1, 2, 3), 0.4, 2.4))
        assert told.proof(self.name) == [
            "nothing binds UAV 3 to this group",
            "0.400 s  coordinator/conflict  pairs=(1, 2)",
            "0.400 s  coordinator/election  term=4 members=1,2,3",
        ]

    def test_one_that_is_left_out(self) -> None:
        told = run_builder()
        told.picture(to_ns(0.4), (1, 2), (2, 3))
        told.tell_alone(elect(4, (1, 2), 0.4, 2.4))
        assert told.proof(self.name) == [
            "UAV 2 and UAV 3 belong in one group",
            "0.400 s  coordinator/conflict  pairs=(1, 2),(2, 3)",
            "0.400 s  coordinator/election  term=4 members=1,2",
        ]

    def test_who_is_commanded_stays_with_the_issuer(self) -> None:
        told = run_builder(1, 3)
        told.fly(
            2, until_s=3.0, manoeuvre="turn", command_term=4, command_issuer=1, command_number=1
        )
        told.picture(to_ns(0.4), (2, 3))
        told.tell_alone(elect(4, (1, 2, 3), 0.4, 2.4))
        assert self.name not in told.check().broken

    def test_and_is_not_let_go(self) -> None:
        told = run_builder(1, 3)
        told.fly(
            2, until_s=3.0, manoeuvre="turn", command_term=4, command_issuer=1, command_number=1
        )
        told.picture(to_ns(0.4), (2, 3))
        told.tell_alone(elect(8, (2, 3), 0.4, 2.4))
        assert told.check().of(self.name).why == "UAV 1 and UAV 2 belong in one group"

    @pytest.mark.parametrize(
        ("hold_s", "why"), [(0.5, "nothing binds UAV 2 to this group"), (1.5, "")]
    )
    def test_a_pair_is_held_for_a_while(self, hold_s: float, why: str) -> None:
        told = RecordedRunBuilder(apart(coordination=Coordination(group_hold_s=hold_s)))
        told.fly(1, 2, 3, until_s=3.0)
        told.picture(to_ns(0.4), (1, 2))
        told.picture(to_ns(0.6))
        told.tell_alone(elect(4, (1, 2), 1.8, 3.8))
        assert told.check().of(self.name).why == why

    def test_and_not_dropped_before(self) -> None:
        told = RecordedRunBuilder(apart(coordination=Coordination(group_hold_s=1.5)))
        told.fly(1, 2, 3, until_s=3.0)
        told.picture(to_ns(0.4), (1, 2), (2, 3))
        told.picture(to_ns(0.6), (1, 2))
        told.tell_alone(elect(4, (1, 2), 1.4, 3.4))
        assert told.check().of(self.name).why == "UAV 2 and UAV 3 belong in one group"


class TestCommandedByMandate:
    name = "commanded by mandate"

    def test_after_the_mandate_has_run_out(self) -> None:
        told = good()
        told.tell(samples.ack(told.tell(make_command(2, 4, 2, 2.5)), "no_mandate", t_ns=to_ns(2.6)))
        assert told.proof(self.name) == [
            "UAV 1 sends a command without a mandate in force",
            "0.400 s  coordinator/election  term=4 computing=1 until_s=2.400",
            "2.500 s  1/cmd/2  term=4 number=2 target=2 expiry_s=4.500",
        ]

    def test_after_the_command_has_expired(self) -> None:
        told = good()
        late = make_command(2, 4, 2, 2.2, expiry_ns=to_ns(2.1))
        told.tell(samples.ack(told.tell(late), "expired", t_ns=to_ns(2.3)))
        assert told.proof(self.name)[0] == "UAV 1 sends a command after its expiry"

    def test_in_a_term_that_another_has_followed(self) -> None:
        told = good()
        told.tell(elect(8, (1, 2), 1.0, 3.0))
        told.tell(samples.ack(told.tell(make_command(2, 4, 2, 1.5)), "stale_term", t_ns=to_ns(1.6)))
        assert told.proof(self.name)[0] == "UAV 1 sends a command without a mandate in force"


class TestRepeatedInNeed:
    name = "repeated in need"

    def test_after_an_answer(self) -> None:
        told = good()
        again = told.tell(make_command(2, 4, 1, 0.5, t_ns=to_ns(0.8)))
        told.tell(samples.ack(again, "duplicate", t_ns=to_ns(0.9)))
        assert told.proof(self.name) == [
            "command 1 is sent again after it was answered",
            "0.600 s  2/ack/1  term=4 number=1 accepted=yes reason= heard_s=0.700",
            "0.800 s  1/cmd/2  term=4 number=1 target=2 expiry_s=2.500",
        ]

    def test_a_refusal_that_it_may_mend_is_no_answer(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4), 2)
        first = told.tell(make_command(2, 4, 1, 0.5))
        told.tell(samples.ack(first, "no_mandate", t_ns=to_ns(0.6)))
        again = told.tell(msgspec.structs.replace(first, t_ns=to_ns(0.8)))
        told.tell(samples.ack(again, "no_mandate", t_ns=to_ns(0.9)))
        assert told.check().of(self.name).verdict is Verdict.VALID

    def test_too_soon(self) -> None:
        told = RecordedRunBuilder(apart(commands=Commands(retransmit_s=0.4)))
        told.fly(1, 2, 3, until_s=3.0)
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        first = told.tell(make_command(2, 4, 1, 0.5))
        told.tell(msgspec.structs.replace(first, t_ns=to_ns(0.8)))
        told.tell(obey(first, 1.0))
        assert told.check().of(self.name).why == "command 1 is sent again too soon"


class TestTermsTold:
    name = "terms rise"

    def test_a_lower_term_than_before(self) -> None:
        told = run_builder(2, 3)
        told.tell(broadcast(told.scenario.uav[0], 0.0, highest_term=8, mandate_term=4))
        told.tell(broadcast(told.scenario.uav[0], 0.2, highest_term=8, mandate_term=0))
        assert told.proof(self.name) == [
            "UAV 1 tells a lower term than before",
            "0.000 s  1/adsb/0  seq=0 highest_term=8 mandate_term=4",
            "0.200 s  1/adsb/0  seq=1 highest_term=8 mandate_term=0",
        ]

    def test_a_lower_term_than_it_has_heard(self) -> None:
        told = run_builder(2, 3)
        told.tell(elect(4, (2, 3), 0.4, 2.4))
        told.tell(broadcast(told.scenario.uav[0], 0.6, highest_term=3))
        assert told.check().of(self.name).why == "UAV 1 tells no term as high as it has heard"
