"""The invariants of links, tracks, recovery and the record, on runs that break them or not."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from fleet.analysis.invariants import RecordedRun, Verdict, check, recovery_limit_s
from fleet.faults.kinds.corrupt import Corrupt
from fleet.faults.kinds.duplicate import Duplicate
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.faults.kinds.rate import Rate
from fleet.log.reader import Record
from fleet.model.units import to_ns
from fleet.protocol import codec
from fleet.protocol.messages import Heartbeat, Outage
from fleet.protocol.topics import DIGEST, OUTAGE
from tests.analysis.test_check_story import RecordedRunBuilder, apart, elect, good, make_command
from tests.hostile.target import limited, watch
from tests.support import samples
from tests.support.rewriting import whole_ticks


def heartbeat(at_s: float) -> Heartbeat:
    """A heartbeat of the coordinator."""
    return Heartbeat(0, 0, to_ns(at_s), 0)


APPLIED = "fault plan applied"


def test_a_message_from_the_end_of_time_takes_no_time() -> None:
    """Whoever can write a log can say of a message that it was published at any time."""
    run_builder = RecordedRunBuilder()
    run_builder.fly(1, 2, 3, until_s=3.0)
    run_builder.tell(heartbeat(0.4))
    run = run_builder.recorded_run()
    records = [*run.records]
    late = replace(records[-1], sent_ns=2**63 - 1)
    watch()
    with limited(20.0):
        assert check(replace(run, records=[*records[:-1], late])).of("a leader again").examined == 0


class TestUavsElectInNeed:
    name = "UAVs elect in need"

    def test_when_the_coordinator_has_long_been_silent(self) -> None:
        run_builder = RecordedRunBuilder()
        run_builder.fly(1, 2, 3, until_s=3.0)
        run_builder.tell(heartbeat(0.4))
        run_builder.tell(elect(5, (1, 2), 2.2, 4.2, elector=1))
        assert run_builder.check().of(self.name).verdict is Verdict.VALID

    def test_although_the_coordinator_is_heard(self) -> None:
        run_builder = RecordedRunBuilder()
        run_builder.fly(1, 2, 3, until_s=3.0)
        run_builder.tell(heartbeat(0.8))
        run_builder.tell(elect(5, (1, 2), 2.2, 4.2, elector=1))
        assert run_builder.proof(self.name) == [
            "UAV 1 elects although it hears the coordinator",
            "0.800 s  coordinator/heartbeat  seq=0 heard_s=0.900",
            "2.200 s  1/election  term=5 members=1,2",
        ]

    def test_although_a_member_is_under_another(self) -> None:
        run_builder = RecordedRunBuilder()
        run_builder.fly(1, 2, until_s=3.0)
        run_builder.fly(3, until_s=3.0, mandate_term=5, mandate_valid=True)
        run_builder.tell(elect(6, (2, 3), 2.2, 4.2, elector=2))
        assert run_builder.proof(self.name) == [
            "UAV 2 elects although UAV 3 is under another",
            "2.000 s  3/adsb/0  seq=10 heard_s=2.100 mandate_term=5",
            "2.200 s  2/election  term=6 members=2,3",
        ]


class TestReceivedWasSent:
    name = "received was sent"

    def test_nobody_sent_it(self) -> None:
        run_builder = good()
        run_builder.hear(1, heartbeat(1.0))
        assert run_builder.proof(self.name) == [
            "it was never sent",
            "1.100 s  1/delivery  src=0 kind=heartbeat seq=0 sent_s=1.000 delivered_s=1.100 "
            "fate=received",
        ]

    def test_it_was_sent_to_another(self) -> None:
        run_builder = good()
        run_builder.hear(3, run_builder.tell(make_command(2, 4, 2, 1.0)))
        assert run_builder.proof(self.name)[0] == "it is not for UAV 3"

    def test_it_was_sent_at_another_time(self) -> None:
        run_builder = good()
        said = run_builder.tell(heartbeat(1.0), 1)
        run_builder.hear(1, msgspec.structs.replace(said, t_ns=to_ns(1.2)))
        assert run_builder.proof(self.name)[0] == "it was sent at another time"

    def test_it_comes_at_once(self) -> None:
        run_builder = good()
        run_builder.hear(1, run_builder.tell(heartbeat(1.0), 1), after_s=0.05)
        assert run_builder.proof(self.name)[0] == "it comes before its time"

    def test_it_comes_late(self) -> None:
        run_builder = good()
        run_builder.hear(1, run_builder.tell(heartbeat(1.0), 1), after_s=0.3)
        assert run_builder.proof(self.name)[0] == "it comes late without a fault"

    def test_late_by_a_fault(self) -> None:
        run_builder = RecordedRunBuilder(apart(), Latency(dst="1", classes="heartbeat", base_s=0.3))
        said = run_builder.tell(heartbeat(1.0), 1)
        run_builder.hear(1, said, after_s=0.3)
        assert run_builder.check().broken == ()

    def test_it_comes_twice(self) -> None:
        run_builder = good()
        said = run_builder.tell(heartbeat(1.0))
        run_builder.hear(1, said)
        assert run_builder.proof(self.name) == [
            "it comes 2 times",
            "1.000 s  coordinator/heartbeat  seq=0",
            "1.100 s  1/delivery  src=0 kind=heartbeat seq=0 sent_s=1.000 delivered_s=1.100 "
            "fate=received",
        ]

    def test_twice_by_a_fault_but_not_thrice(self) -> None:
        run_builder = RecordedRunBuilder(
            apart(), Duplicate(dst="1", classes="heartbeat", probability=1.0, delay_s=0.2)
        )
        said = run_builder.tell(heartbeat(1.0))
        run_builder.hear(1, said, after_s=0.2)
        assert run_builder.check().broken == ()
        run_builder.hear(1, said, after_s=0.2)
        assert run_builder.proof(self.name, APPLIED)[0] == "it comes 3 times"

    def test_it_is_dropped_by_a_fault_that_there_is_not(self) -> None:
        run_builder = RecordedRunBuilder(apart(), Loss(classes="adsb", probability=1.0))
        run_builder.hear(1, run_builder.tell(heartbeat(1.0), 1), fate="loss")
        assert run_builder.proof(self.name, APPLIED)[0] == "no fault of the plan is 'loss' to it"

    @pytest.mark.parametrize(
        ("at_s", "silent_s", "is_broken"),
        [(1.4, (), False), (2.2, (), True), (2.2, (0.9, 1.5), False), (2.2, (3.1, 3.2), True)],
    )
    def test_in_realtime_a_rule_lasts_until_its_end_is_heard_of(
        self, at_s: float, silent_s: tuple[float, ...], *, is_broken: bool
    ) -> None:
        """The operator has ended it at 1 s, and who was not reached then heard of it later."""
        lossy = Loss(classes="heartbeat", dst="1", probability=1.0)
        run_builder = RecordedRunBuilder(apart(), lossy)
        run_builder.hear(1, run_builder.tell(heartbeat(at_s), 1), fate="loss")
        run = run_builder.recorded_run(realtime=True)
        records = list(run.records)
        if silent_s:
            since_ns, until_ns = map(to_ns, silent_s)
            payload = codec.encode(Outage(until_ns, 1, since_ns, "back"))
            records.append(Record(OUTAGE, payload, 0, until_ns, until_ns))
        ended = replace(run, plan=(lossy.ended(to_ns(1.0)),), records=records)
        assert (self.name in check(ended).broken) == is_broken

    def test_in_realtime_a_rule_that_is_being_ended_may_alter(self) -> None:
        corrupt = Corrupt(classes="heartbeat", dst="1", probability=1.0, frame_check=False)
        run_builder = RecordedRunBuilder(apart(), corrupt)
        run_builder.hear(1, run_builder.tell(heartbeat(1.4), 1), fate="altered")
        run = run_builder.recorded_run(realtime=True)
        ended = replace(run, plan=(corrupt.ended(to_ns(1.0)),))
        assert self.name not in check(ended).broken

    def test_it_is_altered_by_no_fault(self) -> None:
        run_builder = RecordedRunBuilder(
            apart(), Corrupt(classes="adsb", probability=1.0, frame_check=False)
        )
        run_builder.hear(1, run_builder.tell(heartbeat(1.0), 1), fate="altered")
        what = "no fault of the plan altered it to anything that can be read"
        assert run_builder.proof(self.name, APPLIED)[0] == what

    def test_two_messages_with_one_number(self) -> None:
        run_builder = good()
        run_builder.tell(heartbeat(1.0))
        run_builder._seq[0, "heartbeat"] = 0
        run_builder.say(heartbeat(1.4))
        assert run_builder.check().of(self.name).why == "two messages have the same number"


class TestNothingLostSilently:
    name = "nothing lost silently"

    def test_it_never_comes(self) -> None:
        run_builder = good()
        run_builder.tell(heartbeat(1.0), 2)
        assert run_builder.proof(self.name) == [
            "UAV 2 never received it, and no fault kept it away",
            "1.000 s  coordinator/heartbeat  seq=0",
        ]

    def test_a_drop_that_is_reported(self) -> None:
        run_builder = RecordedRunBuilder(
            apart(), Loss(classes="heartbeat", dst="2", probability=1.0)
        )
        run_builder.hear(2, run_builder.tell(heartbeat(1.0), 2), fate="loss")
        assert run_builder.check().broken == ()

    def test_a_drop_that_is_not_reported(self) -> None:
        run_builder = RecordedRunBuilder(
            apart(), Loss(classes="heartbeat", dst="2", probability=1.0)
        )
        run_builder.tell(heartbeat(1.0), 2)
        assert run_builder.check().broken == (self.name,)

    @pytest.mark.parametrize(("delay_s", "broken"), [(2.9, ("nothing lost silently",)), (3.1, ())])
    def test_still_on_its_way_at_the_end(self, delay_s: float, broken: tuple[str, ...]) -> None:
        run_builder = RecordedRunBuilder(
            apart(), Latency(classes="heartbeat", dst="2", base_s=delay_s)
        )
        run_builder.tell(heartbeat(1.0), 2)
        assert run_builder.check().broken == broken

    @pytest.mark.parametrize(("bits_per_s", "broken"), [(70.0, ()), (100.0, (name,))])
    def test_waiting_in_a_queue_at_the_end(
        self, bits_per_s: float, broken: tuple[str, ...]
    ) -> None:
        """A heartbeat of 272 bits takes 3.9 s, which is longer than is left, or 2.7 s."""
        run_builder = RecordedRunBuilder(apart(), Rate(dst="2", bits_per_s=bits_per_s, queue=1))
        run_builder.tell(heartbeat(1.0), 2)
        assert run_builder.check().broken == broken

    @pytest.mark.parametrize(("start_s", "broken"), [(1.1, ()), (1.2, (name,))])
    def test_killed_before_it_came(self, start_s: float, broken: tuple[str, ...]) -> None:
        run_builder = RecordedRunBuilder(apart(), Kill(node="2", start_s=start_s, end_s=2.0))
        run_builder.tell(heartbeat(1.0), 2)
        assert run_builder.check().broken == broken

    def test_sent_to_the_dead(self) -> None:
        run_builder = RecordedRunBuilder(apart(), Kill(node="2", start_s=1.0, end_s=2.0))
        run_builder.tell(heartbeat(1.9), 2)
        assert run_builder.check().broken == ()

    def test_stopped_to_the_end(self) -> None:
        run_builder = RecordedRunBuilder(apart(), Pause(node="2", start_s=1.0))
        run_builder.tell(heartbeat(1.9), 2)
        assert run_builder.check().broken == ()

    @pytest.mark.parametrize(
        ("again_s", "verdict"),
        [(2.3, Verdict.VALID), (3.3, Verdict.VALID), (3.4, Verdict.INVALID)],
    )
    def test_stopped_in_realtime_with_little_time_to_run(
        self, again_s: float, verdict: Verdict
    ) -> None:
        """Stopped from 1.0 s to 2.2 s and then again: it has a second of its own for what came."""
        first = Pause(node="2", start_s=1.0, end_s=2.2)
        run_builder = RecordedRunBuilder(apart(), first, Pause(node="2", start_s=again_s))
        run_builder.tell(heartbeat(1.1), 2)
        assert run_builder.check(realtime=True).of(self.name).verdict is verdict

    @pytest.mark.parametrize(("sent_s", "verdict"), [(2.6, Verdict.VALID), (2.7, Verdict.INVALID)])
    def test_stopped_in_realtime_while_it_starts_again(
        self, sent_s: float, verdict: Verdict
    ) -> None:
        """It has run for a second at 2.7 s, and receives what is sent from then on."""
        plan = Kill(node="2", start_s=0.5, end_s=1.0), Pause(node="2", start_s=1.1, end_s=1.8)
        run_builder = RecordedRunBuilder(apart(), *plan)
        run_builder.tell(heartbeat(sent_s), 2)
        assert run_builder.check(realtime=True).of(self.name).verdict is verdict


class TestAnswersHaveCommands:
    name = "answers have commands"

    def test_an_answer_to_nothing(self) -> None:
        run_builder = good()
        run_builder.tell(samples.ack(make_command(2, 4, 7, 1.0), "expired"))
        assert run_builder.proof(self.name) == [
            "UAV 2 answers what it had not received",
            "1.100 s  2/ack/1  term=4 number=7 accepted=no reason=expired",
        ]


class TestOnlyPlausibleBelieved:
    name = "only plausible believed"

    def jumps(self, *fates: str) -> RecordedRunBuilder:
        """UAV 1 jumps far away, stays there, and UAV 2 alone hears of it, with these fates."""
        run_builder = RecordedRunBuilder()
        run_builder.fly(1, 2, 3)
        for n, fate in enumerate(fates, 1):
            place = (9000.0 + 5.0 * n, 0.0, -300.0)
            said = run_builder.say(samples.adsb(1, place, t_ns=to_ns(0.2 * n), highest_term=99))
            for node in (0, 3):
                run_builder.hear(node, said, fate="implausible" if n < 3 else "received")
            run_builder.hear(2, said, fate=fate)
        return run_builder

    def test_insisting_is_believed(self) -> None:
        run_builder = self.jumps("implausible", "implausible", "received", "received")
        assert run_builder.check().of(self.name).verdict is Verdict.VALID

    def test_believed_at_once(self) -> None:
        assert self.jumps("received").proof(self.name) == [
            "UAV 2 believes that UAV 1 has jumped",
            "0.000 s  1/adsb/0  seq=0 applies_s=0.000 position_ned_m=0,20000,-300 speed_mps=25 "
            "heard_s=0.100 fate=received",
            "0.200 s  1/adsb/0  seq=1 applies_s=0.200 position_ned_m=9005,0,-300 speed_mps=25 "
            "heard_s=0.300 fate=received",
        ]

    def test_believed_too_soon(self) -> None:
        assert self.jumps("implausible", "received").check().broken == (self.name,)


class TestALeaderAgain:
    name = "a leader again"
    flying = samples.head_on()

    def meeting(self, *plan: Kill, **_changes: float) -> RecordedRunBuilder:
        """UAVs 1 and 2 are in conflict from the start."""
        run_builder = RecordedRunBuilder(
            msgspec.structs.replace(self.flying, duration_s=12.0), *plan
        )
        run_builder.fly(1, 2, 3, until_s=12.0)
        return run_builder

    def lead(
        self, run_builder: RecordedRunBuilder, term: int, begin_s: float, last_s: float
    ) -> None:
        """An election, repeated until the last time."""
        for n in range(round((last_s - begin_s) / 0.6) + 1):
            at_s = round(begin_s + 0.6 * n, 1)
            run_builder.tell(elect(term, (1, 2), at_s, at_s + 2.0))

    def test_the_limit(self) -> None:
        assert recovery_limit_s(self.flying) == pytest.approx(1.5 + 2.0 + 0.4 + 0.2 + 0.4)

    def test_led_within_the_limit(self) -> None:
        run_builder = self.meeting()
        self.lead(run_builder, 4, 4.2, 11.4)
        finding = run_builder.check().of(self.name)
        assert (finding.verdict, finding.examined) == (Verdict.VALID, 2)

    def test_never_led(self) -> None:
        assert self.meeting().check().of(self.name).why == (
            "UAVs 1 and 2 are in conflict from 0.0 s to 4.6 s, and then without a computing UAV"
        )

    def test_left_without(self) -> None:
        run_builder = self.meeting()
        self.lead(run_builder, 4, 0.4, 4.0)
        assert run_builder.proof(self.name) == [
            "UAVs 1 and 2 are in conflict from 1.8 s to 6.4 s, and then without a computing UAV",
            "1.800 s  1/adsb/0  seq=9 position_ned_m=45,0,-300",
            "1.800 s  2/adsb/0  seq=9 position_ned_m=1455,5.51091e-15,-300",
            "6.400 s  1/adsb/0  seq=32 position_ned_m=160,0,-300",
            "6.400 s  2/adsb/0  seq=32 position_ned_m=1340,1.95943e-14,-300",
            "4.000 s  coordinator/election  term=4 members=1,2 computing=1 heard_by=1 "
            "heard_s=4.100 until_s=6.000",
            "4.000 s  coordinator/election  term=4 members=1,2 computing=1 heard_by=2 "
            "heard_s=4.100 until_s=6.000",
        ]

    def test_nothing_is_asked_while_a_fault_lasts(self) -> None:
        run_builder = self.meeting(Kill(node="3", start_s=1.0, end_s=8.0))
        self.lead(run_builder, 4, 0.4, 4.0)
        finding = run_builder.check().of(self.name)
        assert (finding.verdict, finding.why) == (Verdict.UNKNOWN, "no pairs in conflict")

    def test_a_fault_to_the_end(self) -> None:
        run_builder = RecordedRunBuilder(self.flying, Loss(probability=0.0))
        assert run_builder.check().of(self.name).why == "a fault lasts to the end"

    def test_who_is_dead_for_good_is_healed_and_leads_nobody(self) -> None:
        run_builder = self.meeting(Kill(node="3", start_s=1.0))
        for n in range(18):
            at_s = round(0.6 + 0.6 * n, 1)
            told = msgspec.structs.replace(elect(4, (1, 2, 3), at_s, at_s + 2.0), computing=3)
            run_builder.tell(told, 3)
        assert self.name in run_builder.check().broken


class TestRecordIntact:
    name = "record intact"

    def changed(self, recorded_run: RecordedRun, place: int) -> RecordedRun:
        """The same with one byte changed, inside a message that stays readable."""
        records = list(recorded_run.records)
        old = records[place]
        payload = old.payload.replace(b"\xa4term\x04", b"\xa4term\x08")
        assert payload != old.payload
        records[place] = Record(old.topic, payload, old.seq, old.sent_ns, old.log_ns)
        return replace(recorded_run, records=records)

    def test_a_changed_byte(self) -> None:
        recorded_run = good().recorded_run()
        place = next(n for n, r in enumerate(recorded_run.records) if r.topic == "1/cmd/2")
        finding = check(self.changed(recorded_run, place)).of(self.name)
        assert finding.why == "tick 5 is the first that differs from its digest"
        (shown,) = finding.witnesses
        assert shown.line().startswith("0.500 s  sim/digest  tick=5 digest=")

    def test_a_message_left_out(self) -> None:
        recorded_run = good().recorded_run()
        kept = [r for r in recorded_run.records if r.topic != "coordinator/election"]
        verdicts = check(replace(recorded_run, records=kept))
        assert verdicts.of(self.name).why == "tick 4 is the first that differs from its digest"

    def test_ticks_left_out(self) -> None:
        recorded_run = good().recorded_run()
        kept = [r for r in recorded_run.records if not to_ns(1.0) <= r.log_ns < to_ns(1.2)]
        assert check(replace(recorded_run, records=kept)).of(self.name).why == "tick 10 is missing"

    def test_an_end_left_out(self) -> None:
        recorded_run = good().recorded_run()
        kept = [r for r in recorded_run.records if r.log_ns < to_ns(3.5)]
        verdicts = check(replace(recorded_run, records=kept))
        assert verdicts.of(self.name).why == "the digest stated at the end is another"

    def test_a_tick_that_is_cut_in_two_is_left_out(self) -> None:
        whole = good().recorded_run(complete=False, digest="")
        for length in range(0, len(list(whole.records)), 7):
            kept = whole_ticks(list(whole.records)[:length])
            assert check(replace(whole, records=kept)).overall is Verdict.UNKNOWN

    def test_a_malformed_message(self) -> None:
        recorded_run = good().recorded_run()
        place = next(n for n, r in enumerate(recorded_run.records) if r.topic == "1/cmd/2")
        records = list(recorded_run.records)
        records[place] = replace(records[place], payload=b"\x00")
        finding = check(replace(recorded_run, records=records)).of(self.name)
        assert (finding.why, finding.witnesses[0].topic) == (
            "a message is malformed, or cannot be of this run",
            "1/cmd/2",
        )

    def test_realtime_has_none(self) -> None:
        finding = good().check(realtime=True).of(self.name)
        assert (finding.verdict, finding.why) == (Verdict.UNKNOWN, "realtime runs have no digest")

    def test_a_record_without_digests(self) -> None:
        recorded_run = good().recorded_run(digest="")
        kept = [r for r in recorded_run.records if r.topic != DIGEST]
        assert check(replace(recorded_run, records=kept)).of(self.name).verdict is Verdict.UNKNOWN
