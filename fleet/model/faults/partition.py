"""Partition: the network falls apart into groups."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from fleet.model.faults.draws import Draws, Hop
from fleet.model.faults.rules import SOME, Act, LinkRule, names


class Partition(LinkRule, frozen=True, tag="partition", kw_only=True):
    """No message passes between the groups, "1-2/3,4"; who is in none of them hears everybody."""

    groups: Annotated[str, Meta(pattern=rf"^{SOME}(/{SOME})+$")]

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop what crosses."""
        sides = self.groups.split("/")
        return lambda hop, _: not _parted(sides, hop)


def _parted(sides: list[str], hop: Hop) -> bool:
    """Whether source and receiver are both on a side, but on none together."""
    of_src = {n for n, side in enumerate(sides) if names(side, hop.src)}
    of_dst = {n for n, side in enumerate(sides) if names(side, hop.dst)}
    return bool(of_src and of_dst and not of_src & of_dst)
