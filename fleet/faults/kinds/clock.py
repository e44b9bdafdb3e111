"""Clock: a participant's clock is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from fleet.faults import quantities
from fleet.faults.clock import ClockRule
from fleet.faults.options import RuleTable, Shorthand, whom_what
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice
from fleet.model.units import to_ns


@fault_kind
class ClockError(ClockRule, frozen=True, tag="clock", kw_only=True):
    """The clock is wrong. Offsets of several rules add up."""

    offset_s: Annotated[
        float, Meta(ge=-3600.0, le=3600.0, description="by how much it is ahead")
    ] = 0.0
    drift_ppm: Annotated[
        float,
        Meta(
            ge=-1e5,
            le=1e5,
            description="by how much it gains from `start_s` on, in microseconds a second",
        ),
    ] = 0.0

    shorthands = (
        Shorthand(
            option="clock-offset",
            metavar="WHO:TIME",
            help="Set a clock ahead, as 2:500ms, or back, as 2:-500ms.",
            example="2:-500ms",
            make=whom_what("offset_s", quantities.offset_s, "2:500ms"),
        ),
    )

    def idle(self, _slack_s: float) -> str:
        """Why the clock is right."""
        wrong = to_ns(self.offset_s) or self.drift_ppm
        return "" if wrong else "offset_s and drift_ppm are 0"

    def shift_ns(self, now_ns: int) -> int:
        """By how much it is ahead while the rule is in force."""
        gained = self.drift_ppm * 1e-6 * (now_ns - to_ns(self.start_s))
        return to_ns(self.offset_s) + round(gained)

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Ahead or behind, by less than an election is valid or by about as long."""
        return {
            "offset_s": dice.choice((-1.0, -0.2, 0.0, 0.3, 2.0)),
            "drift_ppm": dice.choice((0.0, 100.0, -5000.0)),
        }
