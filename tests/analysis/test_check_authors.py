"""Whether a log's messages are their issuers', and whether the plan was applied to them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fleet.analysis.invariants import RecordedRun, Verdict, check
from fleet.faults.kinds.kill import Kill
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.loss import Loss
from fleet.faults.kinds.pause import Pause
from fleet.log.reader import Record
from fleet.model.conflict.contact import INCARNATION
from fleet.model.units import to_ns
from fleet.protocol.account import Account
from fleet.protocol.codec import encode
from fleet.protocol.messages import Done, PersistentState, Rejected
from fleet.protocol.topics import REJECTED
from tests.analysis.test_check_story import RecordedRunBuilder, apart, good
from tests.support.rewriting import whole_ticks
from tests.support.samples import MS, S, heartbeat

AUTHORS, APPLIED = "sent by its issuer", "fault plan applied"


def rejected(why: str) -> Record:
    told = Rejected(S, "1/cmd/2", why, 3)
    return Record(REJECTED, encode(told), 0, S, S)


@pytest.mark.parametrize(
    ("why", "verdict"),
    [
        ("stranger", Verdict.VALID),
        ("deletion", Verdict.VALID),
        ("unaccounted", Verdict.INVALID),
        ("not the simulation", Verdict.INVALID),
        ("a word of a later version", Verdict.INVALID),
    ],
)
def test_what_was_refused_counts_if_it_was_said_in_anothers_name(
    why: str, verdict: Verdict
) -> None:
    recorded_run = good().recorded_run()
    with_it = replace(recorded_run, records=[*recorded_run.records, rejected(why)])
    assert check(with_it).of(AUTHORS).verdict is verdict


def test_it_is_found_in_the_log_of_a_run_that_ended_over_it() -> None:
    records = [*good().recorded_run().records, rejected("unaccounted")]
    recorded_run = good().recorded_run(complete=False)
    cut = replace(recorded_run, records=whole_ticks(records))
    verdicts = check(cut)
    assert verdicts.broken == (AUTHORS,)
    assert verdicts.of(AUTHORS).why.startswith("a message on 1/cmd/2: its issuer does not say")


@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize("change", ["another", "one more", "none"])
def test_each_issuers_messages_are_as_many_and_as_it_says(change: str, *, realtime: bool) -> None:
    """A run of one tick, as realtime has one account of the whole run."""
    run_builder = RecordedRunBuilder(apart(duration_s=0.0))
    run_builder.say(heartbeat(0))
    recorded_run = run_builder.recorded_run(realtime=realtime)
    place = next(
        n for n, r in enumerate(recorded_run.records) if r.topic == "coordinator/heartbeat"
    )
    old = list(recorded_run.records)[place]
    forged = replace_payload(old, encode(heartbeat(0, highest_term=3)))
    added = replace_payload(old, encode(heartbeat(0, seq=1)))
    new = {"another": [forged], "one more": [old, added], "none": [old]}[change]
    records = [*list(recorded_run.records)[:place], *new, *list(recorded_run.records)[place + 1 :]]
    finding = check(replace(recorded_run, records=records)).of(AUTHORS)
    assert (finding.verdict is Verdict.INVALID) is (change != "none")
    if change != "none":
        assert finding.why == "coordinator/heartbeat is not what its issuer says to have sent"
        count = 2 if change == "one more" else 1
        assert finding.witnesses[0].fields == {"logged": count, "told": 1}


KILLED, STOPPED = Kill(node="1", start_s=1.0, end_s=3.0), Pause(node="1", start_s=1.0, end_s=3.0)


def spoken(rule: Kill | Pause, *said: tuple[int, float, float]) -> RecordedRun:
    """UAV 1 is said to have sent these: number, when it was sent and when it came in s."""
    recorded_run = RecordedRunBuilder(apart(), rule).recorded_run(realtime=True)
    records = [r for r in recorded_run.records if r.topic != "1/done"]
    for seq, sent_s, came_s in said:
        t_ns, log_ns = to_ns(sent_s), to_ns(came_s)
        payload = encode(PersistentState(1, seq, t_ns, 0, 0, 0, 0))
        records.append(Record("1/persistent_state", payload, seq, t_ns, log_ns))
    return replace(recorded_run, records=sorted(records, key=lambda r: r.log_ns))


FIRST, AGAIN = (0, 0.9, 1.01), (INCARNATION, 3.1, 3.11)


@pytest.mark.parametrize(
    ("recorded_run", "why"),
    [
        (spoken(KILLED, FIRST, AGAIN), ""),
        (spoken(KILLED, FIRST, (1, 1.0, 1.01), AGAIN), ""),
        (spoken(KILLED, FIRST, (1, 2.0, 2.01), AGAIN), "stopped or dead then"),
        (spoken(KILLED, FIRST, (1, 3.1, 3.11)), "stopped or dead then"),
        (spoken(KILLED, (1, 0.9, 0.91)), "does not follow its issuer's last one"),
        (spoken(KILLED, FIRST, (1, 0.8, 1.02)), "does not follow its issuer's last one"),
        (spoken(STOPPED, FIRST, (1, 2.0, 2.01)), "stopped or dead then"),
        (spoken(STOPPED, FIRST, (1, 2.0, 3.01)), ""),
    ],
)
def test_in_realtime_nobody_speaks_for_who_is_away(recorded_run: RecordedRun, why: str) -> None:
    finding = check(recorded_run).of(AUTHORS)
    assert (finding.verdict is Verdict.INVALID) is bool(why)
    if why:
        assert finding.violations == 1
        assert finding.why.startswith("a message on 1/persistent_state: its ")
        assert finding.why.endswith(why)
        assert finding.witnesses[0].topic == "1/persistent_state"


@pytest.mark.parametrize("count", [1, 2])
def test_an_incarnation_that_ended_well_is_accounted_for(count: int) -> None:
    """Also after one that did not."""
    recorded_run = spoken(KILLED, FIRST, AGAIN)
    done = Done(
        1,
        40,
        4 * S,
        40,
        {"persistent_state": count},
        Account([of(recorded_run, INCARNATION)]).digests,
    )
    told = [*recorded_run.records, Record("1/done", encode(done), 40, 4 * S, 4 * S)]
    finding = check(replace(recorded_run, records=told)).of(AUTHORS)
    assert (finding.verdict is Verdict.VALID) is (count == 1)
    assert finding.why == (
        "" if count == 1 else "1/persistent_state is not what its issuer says to have sent"
    )


def of(recorded_run: RecordedRun, seq: int) -> tuple[str, bytes]:
    """A message of UAV 1's."""
    return next(
        (r.topic, r.payload)
        for r in recorded_run.records
        if (r.topic, r.seq) == ("1/persistent_state", seq)
    )


def replace_payload(old: Record, payload: bytes) -> Record:
    return Record(old.topic, payload, old.seq, old.sent_ns, old.log_ns)


def heard_after(after_s: float, fate: str, *plan: Loss | Latency, **changes: bool) -> RecordedRun:
    """UAV 1 hears a heartbeat of 1 s so much later."""
    run_builder = RecordedRunBuilder(apart(), *plan)
    run_builder.hear(1, run_builder.tell(heartbeat(S), 1), after_s, fate)
    return run_builder.recorded_run(**changes)


CERTAIN, LATE = Loss(dst="1", probability=1.0), Latency(dst="1", base_s=0.3)


@pytest.mark.parametrize(
    ("recorded_run", "what"),
    [
        (heard_after(0.1, "loss", CERTAIN), ""),
        (heard_after(0.1, "received", CERTAIN), "by the fault plan it is dropped (loss)"),
        (heard_after(0.3, "received", LATE), ""),
        (heard_after(0.2, "received", LATE), "by the fault plan it is delivered after 0.300 s"),
        (heard_after(0.4, "received", LATE), "by the fault plan it is delivered after 0.300 s"),
        (heard_after(0.1, "latency", LATE), "by the fault plan it is delivered after 0.300 s"),
        (heard_after(0.1, "received", CERTAIN, realtime=True), "dropped (loss)"),
        (heard_after(0.4, "received", LATE, realtime=True), ""),
        (heard_after(0.1, "received", LATE, realtime=True), "delivered after 0.300 s"),
    ],
)
def test_every_fate_is_the_plans(recorded_run: RecordedRun, what: str) -> None:
    finding = check(recorded_run).of(APPLIED)
    assert what in finding.why if what else finding.verdict is Verdict.VALID
    assert (finding.verdict is Verdict.INVALID) is bool(what)


def test_a_plan_that_was_changed_under_way_cannot_be_judged_in_realtime() -> None:
    recorded_run = heard_after(0.1, "received", CERTAIN, realtime=True)
    changed = replace(recorded_run, plan=(*recorded_run.plan, LATE))
    assert check(changed).of(APPLIED).verdict is Verdict.UNKNOWN
    assert recorded_run.scenario.tick_ns == 100 * MS
