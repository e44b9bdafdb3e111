"""A kind of fault of your own: a link that loses every third message, in turn.

It is in the script, since it is flown in memory; over zenoh it has to be a module of its own.
"""

from collections import Counter
from collections.abc import Sequence

import fleet
from fleet.faults.draws import Draws, LinkMessage
from fleet.faults.links import Act, Effect, Harm, LinkRule
from fleet.faults.options import RuleTable
from fleet.faults.registry import fault_kind
from fleet.faults.rules import Dice


@fault_kind
class EveryThird(LinkRule, frozen=True, tag="every_third", kw_only=True):
    """Loses every third message of a link."""

    harms = Harm.DROP
    by_order = True

    def act(self, _draws: Draws, _tick_ns: int) -> Act:
        """Count the messages of each link, and drop every third."""
        counts: Counter[tuple[int, int]] = Counter()

        def passes(message: LinkMessage, _: Effect) -> bool:
            link = message.src, message.dst
            counts[link] += 1
            return counts[link] % 3 != 0

        return passes

    def passes(self, _link: LinkMessage) -> float:
        """Two of three."""
        return 2.0 / 3.0

    @classmethod
    def fuzzed(cls, _dice: Dice, _ids: Sequence[int]) -> RuleTable:
        """Nothing to draw."""
        return {}


rule = {"kind": "every_third", "class": "adsb", "start_s": 5.0}
run = fleet.run(fleet.load_scenario("head_on", {"duration_s": 60, "fault": [rule]}))
for link in fleet.measure(run).links:
    if link.kind == "adsb" and link.dst != 0:  # 0 is the coordinator
        print(f"{link.src} to {link.dst}: {link.delivered} of {link.sent} messages arrived")
print(f"fleet check: {fleet.check(run).overall}")
