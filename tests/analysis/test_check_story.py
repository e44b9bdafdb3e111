"""A builder of small hand-written runs, for the tests of the invariants; and what it does."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from fleet.analysis.invariants import RecordedRun, Verdict, Verdicts, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.scenario import Commands, Coordination, Scenario, Uav
from fleet.config.traffic import participants
from fleet.faults.rules import Rule
from fleet.model.types import COORDINATOR
from fleet.model.units import to_ns
from fleet.protocol import codec
from fleet.protocol.account import Account
from fleet.protocol.messages import Ack, Command, Conflict, DeliveryReport, Done, Election, Message
from fleet.protocol.topics import topic_of
from fleet.simulation.process_registry import ProcessRegistry
from fleet.simulation.run_recorder import RunRecorder
from fleet.transport.interface import ReceivedMessage
from tests.support import samples

TICK_S = 0.1

M = TypeVar("M", bound=Message)


def apart(*, duration_s: float = 4.0, **changes: Any) -> Scenario:
    """Three UAVs that fly north far apart; groups are not held, and commands repeated soon."""
    uavs = tuple(
        Uav(n, (0.0, 20_000.0 * n, -300.0), 0.0, ((90_000.0, 20_000.0 * n, -300.0),))
        for n in (1, 2, 3)
    )
    soon = {"coordination": Coordination(group_hold_s=0.0), "commands": Commands(retransmit_s=0.1)}
    return Scenario("by_hand", duration_s, uav=uavs, **(soon | changes))


class RecordedRunBuilder:
    """Makes a run message by message; reports, grants and digests come by themselves."""

    def __init__(self, scenario: Scenario | None = None, *plan: Rule) -> None:
        self.scenario = msgspec.structs.replace(scenario or apart(), fault=plan)
        self._said: defaultdict[int, list[Message]] = defaultdict(list)
        self._came: defaultdict[tuple[int, int], list[tuple[Any, ...]]] = defaultdict(list)
        self._seq: Counter[tuple[int, str]] = Counter()

    def say(self, message: M, at_s: float | None = None) -> M:
        """Somebody sends a message (by default at its own time), numbered on."""
        seq = self._seq[message.id, message.kind]
        self._seq[message.id, message.kind] += 1
        said = msgspec.structs.replace(message, seq=seq)
        self._said[_tick(message.t_ns if at_s is None else to_ns(at_s))].append(said)
        return said

    def picture(self, t_ns: int, *pairs: tuple[int, int]) -> Conflict:
        """The coordinator puts on record who is in conflict."""
        return self.say(Conflict(COORDINATOR, 0, t_ns, pairs, (10.0,) * len(pairs), ()))

    def hear(
        self, receiver: int, message: Message, after_s: float = TICK_S, fate: str = "received"
    ) -> None:
        """It comes to a receiver, or is kept from it: `fate` is the fault."""
        at_ns = message.t_ns + to_ns(after_s)
        dropped = fate not in ("received", "altered", "implausible")
        row = (message.id, message.kind, message.seq, message.t_ns, 0 if dropped else at_ns, fate)
        self._came[receiver, _tick(at_ns)].append(row)

    def tell(self, message: M, *but: int) -> M:
        """Somebody sends a message and a tick later all (but these) hear it.

        The members of a group that the coordinator elects are in conflict, each with the next.
        """
        if isinstance(message, Election) and message.id == COORDINATOR:
            self.picture(message.t_ns, *pairwise(message.members))
        return self.tell_alone(message, *but)

    def tell_alone(self, message: M, *but: int) -> M:
        """The same without a picture of the conflicts."""
        said = self.say(message)
        for node in participants(self.scenario):
            if node not in but and _hears(node, said):
                self.hear(node, said)
        return said

    def fly(self, *uavs: int, until_s: float = 0.0, **changes: Any) -> None:
        """UAVs fly straight on from their start and say so every 0.2 s, heard by all."""
        for uav in self.scenario.uav:
            if uav.id in uavs:
                for n in range(round(until_s / 0.2) + 1):
                    self.tell(broadcast(uav, 0.2 * n, **changes))

    def recorded_run(self, **changes: Any) -> RecordedRun:
        """All of it, closed tick by tick."""
        scenario, records = self.scenario, RecordCollector()
        run_recorder, registry = RunRecorder(scenario, records), ProcessRegistry(scenario)
        for tick in range(scenario.ticks + 1):
            now_ns = tick * scenario.tick_ns
            registry.enter(tick)
            clock = registry.clock(tick, {}, new_plan=False)
            run_recorder.clock(clock, codec.encode(clock))
            messages = list(self._said[tick])
            for node in participants(scenario):
                if node in (*clock.held, *clock.down):
                    continue
                rows = self._came.get((node, tick), [])
                if rows:
                    columns = zip(*rows, strict=True)
                    messages.append(DeliveryReport(node, self._number(node), now_ns, *columns))
                sent = [(topic_of(m), codec.encode(m)) for m in messages if m.id == node]
                told = Account(sorted(sent, key=lambda s: s[0]))
                messages.append(Done(node, tick, now_ns, tick, told.counts, told.digests))
            items: list[ReceivedMessage] = [(topic_of(m), codec.encode(m), m) for m in messages]
            run_recorder.close(tick, now_ns, items)
        return RecordedRun.of_records(
            scenario, records.kept, **{"digest": run_recorder.digest} | changes
        )

    def check(self, **changes: Any) -> Verdicts:
        """The verdicts on it."""
        return check(self.recorded_run(**changes))

    def proof(self, name: str, *also: str) -> list[str]:
        """What is wrong, and the lines that prove it; nothing else but `also` may be wrong."""
        verdicts = self.check()
        assert {*verdicts.broken} == {name, *also}
        assert verdicts.overall is Verdict.INVALID
        finding = verdicts.of(name)
        return [finding.why, *(w.line() for w in finding.witnesses)]

    def _number(self, node: int) -> int:
        self._seq[node, "delivery"] += 1
        return self._seq[node, "delivery"] - 1


def broadcast(uav: Uav, at_s: float, **changes: Any) -> Message:
    """What a UAV says that flies straight on from its start, and has seen high terms."""
    changes = {"highest_term": 99, **changes}
    north, east, down = uav.position_ned_m
    heading = math.radians(uav.heading_deg)
    flown = uav.speed_mps * at_s
    place = (north + flown * math.cos(heading), east + flown * math.sin(heading), down)
    return samples.adsb(uav.id, place, heading, to_ns(at_s), **changes)


def elect(
    term: int, members: tuple[int, ...], at_s: float, until_s: float, elector: int = 0
) -> Election:
    """An election of the lowest member."""
    group = members[0]
    return Election(elector, 0, to_ns(at_s), term, group, members, group, to_ns(until_s))


def make_command(target: int, term: int, number: int, at_s: float, **changes: Any) -> Command:
    """A turn, from UAV 1; it expires after 2 s."""
    told = samples.command(target=target, term=term, number=number, t_ns=to_ns(at_s))
    times = {"issued_ns": told.t_ns, "start_ns": told.t_ns + to_ns(0.2)}
    told = msgspec.structs.replace(told, **times, expiry_ns=told.t_ns + to_ns(2.0))
    return msgspec.structs.replace(told, **changes)


def obey(of: Command, after_s: float = TICK_S) -> Ack:
    """The target's answer: accepted."""
    return samples.ack(of, t_ns=of.t_ns + to_ns(after_s))


def _tick(t_ns: int) -> int:
    """The tick in which something of that time happens."""
    return -(-t_ns // to_ns(TICK_S))


def _hears(node: int, message: Message) -> bool:
    if isinstance(message, Command | Ack):
        return node == message.target
    return node != message.id and (node != 0 or message.kind == "adsb")


def good() -> RecordedRunBuilder:
    """UAV 1 computes for 1 and 2, and UAV 2 obeys it."""
    run_builder = RecordedRunBuilder()
    run_builder.fly(1, 2, 3, until_s=3.0)
    run_builder.tell(elect(4, (1, 2), 0.4, 2.4))
    told = run_builder.tell(make_command(2, 4, 1, 0.5))
    run_builder.tell(obey(told))
    run_builder.tell(msgspec.structs.replace(told, t_ns=to_ns(0.6)))
    run_builder.tell(samples.ack(told, "duplicate", t_ns=to_ns(0.7)))
    return run_builder


def test_a_good_run_is_valid() -> None:
    verdicts = good().check()
    assert verdicts.broken == ()
    assert verdicts.overall is Verdict.VALID
    assert {f.name: f.examined for f in verdicts.findings} == {
        "one leader a term": 1,
        "terms rise": 1 + 48,
        "lowest eligible leads": 1,
        "groups belong together": 1,
        "UAVs elect in need": 0,
        "commanded by mandate": 2,
        "newest term obeyed": 1,
        "issuer computes": 1,
        "own group obeyed": 1,
        "obeyed in time": 1,
        "obeyed once, in order": 1,
        "refused for a reason": 1,
        "flown as obeyed": 0,
        "repetitions identical": 1,
        "repeated in need": 1,
        "received was sent": 3 * 16 * 3 + 3 + 4,
        "nothing lost silently": 3 * 16 * 3 + 3 + 4,
        "fault plan applied": 0,
        "answers have commands": 2,
        "processes as planned": 41,
        "positions as sensed": 0,
        "clocks as planned": 3 * 16 + 2,
        "only plausible believed": 3 * 15 * 3,
        "a leader again": 0,
        "sent by its issuer": 120,
        "record intact": 41,
    }


def test_the_document_explains_every_invariant() -> None:
    text = (Path(__file__).parents[2] / "docs" / "invariants.md").read_text(encoding="utf-8")
    names = [line.removeprefix("### ") for line in text.splitlines() if line.startswith("### ")]
    assert names == [f.name for f in good().check().findings]


def test_what_did_not_happen_is_unknown() -> None:
    verdicts = RecordedRunBuilder().check()
    ticks = ("processes as planned", "record intact")
    assert {f.verdict for f in verdicts.findings if f.name not in ticks} == {Verdict.UNKNOWN}
    assert verdicts.overall is Verdict.UNKNOWN
    assert verdicts.why == "there was no election and no command"


def test_one_thing_that_did_not_happen_does_not_spoil_the_whole() -> None:
    verdicts = good().check()
    assert verdicts.of("a leader again").verdict is Verdict.UNKNOWN
    assert verdicts.of("a leader again").why == "no pairs in conflict"


def test_a_log_that_is_cut_is_unknown() -> None:
    verdicts = good().check(complete=False)
    assert {f.verdict for f in verdicts.findings} == {Verdict.UNKNOWN}
    assert verdicts.overall is Verdict.UNKNOWN


def test_a_violation_in_a_log_that_is_cut_is_a_violation() -> None:
    run_builder = good()
    run_builder.tell(elect(5, (1, 2), 3.0, 5.0))
    assert run_builder.check(complete=False).overall is Verdict.INVALID
