"""Injected delays in realtime: over when they are up on the wall clock, whenever steps are."""

from __future__ import annotations

from fleet.node.delay_line import DelayLine
from fleet.node.node import InboxMessage
from fleet.protocol.messages import Heartbeat
from tests.support.replay_tools import until

MS = 1_000_000
EPOCH_NS = 1_700_000_000_000_000_000


def one_handed_over(phase_ns: int, since_epoch_ns: int, incoming: InboxMessage) -> InboxMessage:
    """What becomes of a message at a moment of the wall clock, which stands still."""
    with DelayLine(lambda: EPOCH_NS + since_epoch_ns) as line:
        line.epoch_ns, line.phase_ns = EPOCH_NS, phase_ns
        line.hold(incoming)
        found = list[InboxMessage]()

        def came() -> bool:
            found.extend(line.due(10**12))
            return bool(found)

        until(came)
    (one,) = found
    return one


def test_a_delay_that_was_up_before_the_message_came_from_a_later_phase_has_not_slipped() -> None:
    """Its sender steps 70 ms into the tick: delivered at 10 ms of it, it comes at 71 ms."""
    heartbeat = Heartbeat(0, 0, 0, 0)
    told = one_handed_over(0, 71 * MS, InboxMessage(10 * MS, heartbeat, delay_ns=9 * MS))
    assert (told.delivered_ns, told.slip_ns) == (10 * MS, 0)


def test_simulated_time_is_behind_by_the_phase() -> None:
    """At 130 ms of the wall clock a process with a phase of 30 ms has what is due at 100 ms."""
    heartbeat = Heartbeat(0, 0, 0, 0)
    with DelayLine(lambda: EPOCH_NS + 130 * MS) as line:
        line.epoch_ns, line.phase_ns = EPOCH_NS, 30 * MS
        line.hold(InboxMessage(101 * MS, heartbeat, delay_ns=50 * MS))
        line.hold(InboxMessage(100 * MS, heartbeat, delay_ns=50 * MS))
        found = list[InboxMessage]()

        def came() -> bool:
            found.extend(line.due(10**12))
            return bool(found)

        until(came)
        assert [(i.delivered_ns, i.slip_ns) for i in found] == [(100 * MS, 0)]
        assert line.due(10**12) == []
