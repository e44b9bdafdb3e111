"""Kill: a process ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, Self

import msgspec
from msgspec import Meta

from fleet.faults.lifecycle import ProcessRule, Severity
from fleet.faults.options import RuleTable, Shorthand, whom
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice
from fleet.model.units import to_ns


@fault_kind
class Kill(ProcessRule, frozen=True, tag="kill", kw_only=True):
    """The process is killed at `start_s`, and started again at `end_s` if that is given."""

    then: Annotated[
        Literal["straight", "vanish"],
        Meta(description="the aircraft flies on `straight` and level, or it vanishes: `vanish`"),
    ] = "straight"

    shorthands = (
        Shorthand(
            option="kill",
            metavar="WHO@TIME",
            help="Kill a process, as 1@40s; 1@40s+20s: start it again after 20 s.",
            example="1@40s+20s",
            make=whom(timed=True),
            note="without `+20s` it stays dead",
            timed=True,
        ),
    )

    @property
    def severity(self) -> Severity:
        """The process, and with `vanish` the aircraft too."""
        return Severity.AIRCRAFT if self.then == "vanish" else Severity.PROCESS

    def problems(self, _everybody: Sequence[int]) -> Iterator[tuple[str, str]]:
        """Nothing comes back after it has vanished."""
        if self.then == "vanish" and self.end_s is not None:
            yield "end_s", "what has vanished cannot start again; remove it"

    def ended(self, now_ns: int) -> Self:
        """What has vanished stays so, what is to vanish does not begin."""
        if self.then != "vanish":
            return super().ended(now_ns)
        if to_ns(self.start_s) <= now_ns:
            return self
        return msgspec.structs.replace(self, then="straight", end_s=self.start_s)

    @classmethod
    def fuzzed(cls, dice: Dice, _: Sequence[int]) -> RuleTable:
        """Mostly the aircraft flies on."""
        then = dice.choice(("straight", "straight", "vanish"))
        return {"then": then, "end_s": None} if then == "vanish" else {"then": then}
