"""The table of the rules that the conformance test knows."""

from __future__ import annotations

from fleet.conformance.rules import RULES
from fleet.model.words import ClockMode


def rules_of_the_conformance_test() -> str:
    """A row for each rule: on which clock, and where it is told."""
    clocks: dict[tuple[str, str], set[ClockMode]] = {}
    for rule in RULES:
        clocks.setdefault((rule.name, rule.page), set()).update(rule.clocks)
    rows = ["| A UAV | Clock | Page |", "|---|---|---|"]
    for (name, page), modes in clocks.items():
        shown = " and ".join(mode for mode in ClockMode if mode in modes)
        title = page.partition("#")[2].replace("-", " ")
        rows.append(f"| {name} | {shown} | [{title}]({page}) |")
    return "\n".join(rows)
