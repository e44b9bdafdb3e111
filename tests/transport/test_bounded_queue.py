"""What waits in realtime is bounded, and nobody reads on as if nothing had been missed."""

from __future__ import annotations

import pytest

from fleet.errors import FleetStoppedError
from fleet.protocol.sample import Sample
from fleet.transport.bounded_queue import BoundedQueue


def test_what_waits_comes_in_order_and_frees_its_room() -> None:
    waiting = BoundedQueue(most=2, most_bytes=5)
    for _ in range(3):
        waiting.put(Sample("a", b"12"))
        waiting.put(Sample("b", b"345"))
        assert [waiting.get(0.0), waiting.get(-1.0)] == [Sample("a", b"12"), Sample("b", b"345")]
    assert waiting.get(0.0) is None
    assert waiting.lacked_room == 0


@pytest.mark.parametrize(("most", "most_bytes"), [(1, 1000), (1000, 2)])
def test_what_has_no_room_is_counted_and_told_to_whoever_reads(most: int, most_bytes: int) -> None:
    waiting = BoundedQueue(most, most_bytes)
    for _ in range(3):
        waiting.put(Sample("a", b"12"))
    assert waiting.lacked_room == 2
    with pytest.raises(FleetStoppedError, match="no room for 2 messages behind 1; somebody floods"):
        waiting.get(0.0)
