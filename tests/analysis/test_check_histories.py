"""The invariants of elections and commands, each on small runs that hold and that break it."""

from __future__ import annotations

import msgspec

from fleet.analysis.invariants import Verdict
from fleet.faults.kinds.clock import ClockError
from fleet.faults.kinds.kill import Kill
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_ns
from tests.analysis.test_check_story import (
    RecordedRunBuilder,
    apart,
    elect,
    good,
    make_command,
    obey,
)
from tests.support import samples


def run_builder(*uavs: int) -> RecordedRunBuilder:
    """Everybody flies (or these alone), and is heard."""
    out = RecordedRunBuilder()
    out.fly(*(uavs or (1, 2, 3)), until_s=3.0)
    return out


class TestOneLeaderATerm:
    name = "one leader a term"

    def test_repetitions_and_other_groups_are_fine(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        told.tell(elect(4, (1, 2), 1.0, 3.0))
        told.tell(elect(3, (3,), 1.0, 3.0, elector=3))
        assert told.check().of(self.name).verdict is Verdict.VALID

    def test_a_term_with_two_groups(self) -> None:
        told = run_builder()
        told.tell(elect(4, (2, 3), 0.4, 2.4))
        told.tell(elect(4, (1, 2, 3), 1.0, 3.0))
        assert told.proof(self.name) == [
            "term 4 means two things",
            "0.400 s  coordinator/election  term=4 members=2,3 computing=2",
            "1.000 s  coordinator/election  term=4 members=1,2,3 computing=1",
        ]

    def test_a_term_of_another_elector(self) -> None:
        told = run_builder()
        told.tell(elect(5, (1, 2), 0.4, 2.4))
        assert told.proof(self.name) == [
            "term 5 is not its issuer's",
            "0.400 s  coordinator/election  term=5 members=1,2 computing=1",
        ]

    def test_a_uav_that_elects_another(self) -> None:
        told = run_builder()
        told.tell(elect(6, (1, 2), 0.4, 2.4, elector=2))
        assert told.proof(self.name) == [
            "UAV 2 elects another",
            "0.400 s  2/election  term=6 members=1,2 computing=1",
        ]


class TestTermsRise:
    name = "terms rise"

    def test_one_group_may_be_repeated_after_another_began(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        told.tell(elect(8, (3,), 0.8, 2.8))
        told.tell(elect(4, (1, 2), 1.0, 3.0))
        assert told.check().of(self.name).verdict is Verdict.VALID

    def test_a_new_term_below_an_old_one(self) -> None:
        told = run_builder()
        told.tell(elect(8, (1, 2), 0.4, 2.4))
        told.tell(elect(4, (3,), 1.0, 3.0))
        assert told.proof(self.name) == [
            "a new term is not above those before it",
            "0.400 s  coordinator/election  seq=0 term=8 members=1,2 computing=1",
            "1.000 s  coordinator/election  seq=1 term=4 members=3 computing=3",
        ]

    def test_a_member_that_is_named_in_a_lower_term_again(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        told.tell(elect(8, (2, 3), 0.8, 2.8))
        told.tell(elect(4, (1, 2), 1.0, 3.0))
        assert told.proof(self.name) == [
            "UAV 2 is named in a lower term than before",
            "0.800 s  coordinator/election  seq=1 term=8 members=2,3 computing=2",
            "1.000 s  coordinator/election  seq=2 term=4 members=1,2 computing=1",
        ]

    def test_an_elector_that_was_started_again_does_not_take_up_its_old_term(self) -> None:
        told = RecordedRunBuilder(apart(), Kill(node="3", start_s=1.0, end_s=1.5))
        told.fly(1, 2, until_s=0.4)
        told.tell(elect(7, (3,), 0.4, 2.4, elector=3))
        told._seq[3, "election"] = INCARNATION
        told.tell(elect(7, (3,), 1.6, 3.6, elector=3))
        assert told.proof(self.name) == [
            "a new term is not above those before it",
            "0.400 s  3/election  seq=0 term=7 members=3 computing=3",
            "1.600 s  3/election  seq=1000000000 term=7 members=3 computing=3",
        ]


class TestLowestEligibleLeads:
    name = "lowest eligible leads"

    def test_who_is_silent_is_passed_over(self) -> None:
        told = RecordedRunBuilder()
        told.fly(1, until_s=0.4)
        told.fly(2, 3, until_s=3.0)
        told.tell(elect(4, (1, 2), 2.0, 4.0))  # UAV 1 was heard at 0.5 s, just within the limit
        told.tell(msgspec.structs.replace(elect(8, (1, 2), 2.2, 4.2), computing=2))
        assert told.check().broken == ()

    def test_the_lowest_is_passed_over_although_heard(self) -> None:
        told = run_builder()
        told.tell(msgspec.structs.replace(elect(4, (1, 2), 0.4, 2.4), computing=2))
        assert told.proof(self.name) == [
            "the lowest eligible is 1, not UAV 2",
            "0.400 s  coordinator/election  term=4 members=1,2 computing=2",
            "0.200 s  1/adsb/0  seq=1 heard_s=0.300",
        ]

    def test_the_silent_one_is_elected(self) -> None:
        told = RecordedRunBuilder()
        told.fly(1, until_s=0.4)
        told.fly(2, 3, until_s=3.0)
        told.tell(elect(4, (1, 2), 2.2, 4.2))
        assert told.proof(self.name) == [
            "the lowest eligible is 2, not UAV 1, which is silent",
            "2.200 s  coordinator/election  term=4 members=1,2 computing=1",
            "2.000 s  2/adsb/0  seq=10 heard_s=2.100",
            "0.400 s  1/adsb/0  seq=2 heard_s=0.500",
        ]

    def test_silence_is_measured_by_the_clock_of_the_elector(self) -> None:
        fast = ClockError(node="coordinator", start_s=1.0, offset_s=1.0)
        told = RecordedRunBuilder(apart(), fast)
        told.fly(1, until_s=0.4)
        told.fly(2, 3, until_s=3.0)
        told.tell(elect(4, (1, 2), 1.2, 4.2))
        assert told.proof(self.name)[0] == "the lowest eligible is 2, not UAV 1, which is silent"

    def test_what_was_not_believed_was_not_heard(self) -> None:
        told = RecordedRunBuilder()
        told.fly(2, 3, until_s=3.0)
        told.fly(1)
        odd = told.say(samples.adsb(1, (9000.0, 0.0, -300.0), t_ns=to_ns(0.4), highest_term=99))
        for node in (0, 2, 3):
            told.hear(node, odd, fate="implausible")
        told.tell(elect(4, (1, 2), 1.8, 3.8))
        assert told.proof(self.name)[0] == "the lowest eligible is 2, not UAV 1, which is silent"

    def test_a_uav_hears_itself(self) -> None:
        told = run_builder(2, 3)
        told.tell(elect(6, (2, 3), 1.0, 3.0, elector=2))
        assert told.check().of(self.name).verdict is Verdict.VALID


class TestNewestTermObeyed:
    name = "newest term obeyed"

    def test_obeying_on_after_a_higher_term(self) -> None:
        told = good()
        told.tell(elect(8, (1, 2, 3), 1.4, 3.4))
        told.tell(obey(told.tell(make_command(2, 4, 2, 1.5))))
        assert told.proof(self.name) == [
            "UAV 2 obeys term 4, but has heard of a higher one",
            "1.400 s  coordinator/election  term=8 members=1,2,3 computing=1 heard_s=1.500",
            "1.500 s  1/cmd/2  term=4 number=2 expiry_s=3.500",
            "1.600 s  2/ack/1  term=4 number=2 accepted=yes",
        ]

    def test_a_higher_term_that_does_not_name_it_is_none_of_its_business(self) -> None:
        told = good()
        told.tell(elect(8, (3,), 1.4, 3.4))
        told.tell(obey(told.tell(make_command(2, 4, 2, 1.5))))
        assert told.check().of(self.name).verdict is Verdict.VALID

    def test_a_higher_term_that_it_did_not_hear(self) -> None:
        told = good()
        told.picture(to_ns(1.4), (1, 2), (2, 3))
        lost = told.say(elect(8, (1, 2, 3), 1.4, 3.4))
        told.hear(1, lost)
        told.hear(3, lost)
        told.tell(obey(told.tell(make_command(2, 4, 2, 1.4))))
        verdicts = told.check()
        assert verdicts.broken == ("nothing lost silently",)

    def test_the_election_and_the_command_in_one_step(self) -> None:
        told = good()
        stale = told.tell(make_command(2, 4, 2, 1.4), 2)
        told.tell(elect(8, (1, 2, 3), 1.4, 3.4))
        told.hear(2, stale)  # handed over after the election
        told.tell(obey(stale))
        assert told.proof(self.name)[0] == "UAV 2 obeys term 4, but has heard of a higher one"


class TestIssuerComputes:
    name = "issuer computes"

    def test_an_impostor(self) -> None:
        told = good()
        told.tell(obey(told.tell(make_command(2, 4, 2, 1.5, id=3))))
        assert told.proof(self.name, "commanded by mandate") == [
            "UAV 3 does not compute in term 4",
            "0.400 s  coordinator/election  term=4 members=1,2 computing=1 heard_s=0.500",
            "1.500 s  3/cmd/2  term=4 number=2 expiry_s=3.500",
            "1.600 s  2/ack/3  term=4 number=2 accepted=yes",
        ]


class TestOwnGroupObeyed:
    name = "own group obeyed"

    def test_a_command_to_somebody_outside_the_group(self) -> None:
        told = good()
        told.tell(obey(told.tell(make_command(3, 4, 2, 1.5))))
        assert told.proof(self.name) == [
            "no election of term 4 that UAV 3 has heard names it",
            "0.400 s  coordinator/election  term=4 members=1,2 computing=1 heard_s=0.500",
            "1.500 s  1/cmd/3  term=4 number=2 expiry_s=3.500",
            "1.600 s  3/ack/1  term=4 number=2 accepted=yes",
        ]

    def test_a_command_of_a_term_that_was_never_heard(self) -> None:
        told = good()
        told.tell(obey(told.tell(make_command(2, 8, 2, 1.5))))
        assert told.proof(self.name, "commanded by mandate") == [
            "no election of term 8 that UAV 2 has heard names it",
            "1.500 s  1/cmd/2  term=8 number=2 expiry_s=3.500",
            "1.600 s  2/ack/1  term=8 number=2 accepted=yes",
        ]


class TestObeyedInTime:
    name = "obeyed in time"

    def test_after_expiry(self) -> None:
        told = good()
        old = make_command(2, 4, 2, 1.5, expiry_ns=to_ns(1.55))
        told.tell(obey(told.tell(old)))
        assert told.proof(self.name) == [
            "UAV 2 obeys a command that has expired",
            "1.500 s  1/cmd/2  term=4 number=2 expiry_s=1.550",
            "1.600 s  2/ack/1  term=4 number=2 accepted=yes own_clock_s=1.600",
        ]

    def test_after_the_mandate(self) -> None:
        told = good()
        told.tell(obey(told.tell(make_command(2, 4, 2, 2.4))))
        assert told.proof(self.name) == [
            "UAV 2 obeys in term 4, which has run out",
            "0.400 s  coordinator/election  term=4 members=1,2 computing=1 heard_s=0.500 "
            "until_s=2.400",
            "2.400 s  1/cmd/2  term=4 number=2 expiry_s=4.400",
            "2.500 s  2/ack/1  term=4 number=2 accepted=yes own_clock_s=2.500",
        ]

    def test_a_mandate_that_was_repeated_lasts_longer(self) -> None:
        told = good()
        told.tell(elect(4, (1, 2), 1.0, 3.0))
        told.tell(obey(told.tell(make_command(2, 4, 2, 2.4))))
        assert told.check().of(self.name).verdict is Verdict.VALID

    def test_time_is_that_of_its_own_clock(self) -> None:
        told = RecordedRunBuilder(apart(), ClockError(node="2", offset_s=-5.0))
        told.fly(1, 2, 3, until_s=3.0)
        told.tell(elect(4, (1, 2), 0.4, 0.5))
        told.tell(obey(told.tell(make_command(2, 4, 2, 2.4, expiry_ns=to_ns(1.0)))))
        assert told.check().of(self.name).verdict is Verdict.VALID


class TestObeyedOnce:
    name = "obeyed once, in order"

    def test_twice(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        first = told.tell(make_command(2, 4, 1, 0.5))
        again = told.tell(msgspec.structs.replace(first, t_ns=to_ns(0.6)))
        told.tell(obey(first))
        told.tell(obey(again))
        assert told.proof(self.name) == [
            "UAV 2 obeys a command twice",
            "0.600 s  2/ack/1  term=4 number=1 accepted=yes",
            "0.700 s  2/ack/1  term=4 number=1 accepted=yes",
        ]

    def test_an_earlier_one_after_a_later_one(self) -> None:
        told = run_builder()
        told.tell(elect(4, (1, 2), 0.4, 2.4))
        told.tell(obey(told.tell(make_command(2, 4, 2, 0.5))))
        told.tell(obey(told.tell(make_command(2, 4, 1, 0.8))))
        assert told.proof(self.name) == [
            "UAV 2 obeys command 1 after 2",
            "0.600 s  2/ack/1  term=4 number=2 accepted=yes",
            "0.900 s  2/ack/1  term=4 number=1 accepted=yes",
        ]


class TestRepetitionsIdentical:
    name = "repetitions identical"

    def test_a_repetition_that_changes(self) -> None:
        told = good()
        changed = make_command(2, 4, 1, 0.5, climb_mps=2.0, manoeuvre="climb", t_ns=to_ns(1.7))
        told.tell(samples.ack(told.tell(changed), "duplicate"))
        assert told.proof(self.name, "repeated in need") == [
            "command 1 of term 4 changes when it is sent again",
            "0.500 s  1/cmd/2  term=4 number=1 manoeuvre=turn climb_mps=0",
            "1.700 s  1/cmd/2  term=4 number=1 manoeuvre=climb climb_mps=2",
        ]
