"""Replay: messages come again when they are old."""

from __future__ import annotations

from fleet.faults.duplicate import Duplicate
from fleet.faults.rules import Delay


class Replay(Duplicate, frozen=True, tag="replay", kw_only=True):
    """A duplicate that comes much later, as from an attacker who sends recorded messages again."""

    delay_s: Delay = 5.0
