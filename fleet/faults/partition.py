"""Partition: the network falls apart into groups."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from fleet.faults.draws import Draws
from fleet.faults.rules import SOME, Act, LinkRule, names


class Partition(LinkRule, frozen=True, tag="partition", kw_only=True):
    """No message passes between the groups, "1-2/3,4"; who is in none of them hears everybody."""

    groups: Annotated[str, Meta(pattern=rf"^{SOME}(/{SOME})+$")]

    def act(self, draws: Draws, tick_ns: int) -> Act:
        """Drop what crosses."""
        return lambda link_message, _: not self.parts(link_message.src, link_message.dst)

    def parts(self, src: int, dst: int) -> bool:
        """Whether source and receiver are both on a side, but on none together."""
        of_src, of_dst = self.sides(src), self.sides(dst)
        return bool(of_src and of_dst and not of_src & of_dst)

    def sides(self, number: int) -> frozenset[int]:
        """The groups that a participant is in, by their place."""
        groups = enumerate(self.groups.split("/"))
        return frozenset(n for n, group in groups if names(group, number))
