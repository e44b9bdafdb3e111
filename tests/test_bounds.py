"""docs/bounds.md names the limits that the code has."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.config.fault_checks import MOST_RULES
from fleet.config.loading import load_scenario, with_faults
from fleet.errors import ScenarioError
from fleet.model.conflict.tracks import BELIEVED_AFTER
from fleet.node.intake import MOST_EARLY
from fleet.protocol.advisories import MOST_CANDIDATES
from fleet.protocol.sample import KEY_LENGTH, KEYS_KEPT
from fleet.security.links import LONGEST_HEARD_BYTES, LONGEST_MESSAGE_BYTES
from fleet.simulation.fault_control import LONGEST_BYTES, MOST_REQUESTS
from fleet.simulation.run_recorder import REJECTED_APART
from fleet.transport.bounded_queue import MOST_WAITING, MOST_WAITING_BYTES
from fleet.transport.zenoh_bus import CHANNEL_CAPACITY

TABLE = (Path(__file__).parent.parent / "docs" / "bounds.md").read_text(encoding="utf-8")
LIMITS = {
    row[1]: row[2]
    for row in ([cell.strip() for cell in line.split("|")] for line in TABLE.splitlines())
    if len(row) == 6
}
MIB, KIB = 1 << 20, 1 << 10


@pytest.mark.parametrize(
    ("what", "limit"),
    [
        ("a message on the bus", f"{LONGEST_MESSAGE_BYTES // MIB} MiB"),
        (
            "a message that participants hear, at a router with `--secure`",
            f"{LONGEST_HEARD_BYTES // KIB} KiB",
        ),
        ("messages of a topic that wait, lockstep", f"{CHANNEL_CAPACITY:,}"),
        (
            "messages that wait, realtime",
            f"{MOST_WAITING:,} and {MOST_WAITING_BYTES // MIB} MiB a process",
        ),
        ("messages that wait for a manifest, a suffix", f"{MOST_EARLY:,}"),
        ("messages before the epoch, realtime", f"{MOST_EARLY:,}"),
        ("topics that are counted apart as rejected", f"{REJECTED_APART:,}"),
        (
            "keys whose meaning is remembered",
            f"{KEYS_KEPT:,} of up to {KEY_LENGTH} characters",
        ),
        ("implausible reports that wait to be believed", f"{BELIEVED_AFTER} a UAV"),
        ("candidates in a logged decision", f"{MOST_CANDIDATES}"),
        ("rules of a fault plan", f"{MOST_RULES:,}"),
        ("a request to change faults", f"{LONGEST_BYTES // MIB} MiB, nested as deep as a plan is"),
        ("requests to change faults that wait for a tick", f"{MOST_REQUESTS}"),
    ],
)
def test_the_table_says_what_the_code_does(what: str, limit: str) -> None:
    assert LIMITS[what] == limit


def test_a_plan_of_too_many_rules_is_refused() -> None:
    rules = [{"kind": "loss", "probability": 0.1}] * (MOST_RULES + 1)
    with pytest.raises(ScenarioError, match=r"fault: 1001 rules; at most 1000 can be in a plan"):
        with_faults(load_scenario("side"), rules, "side")
    assert len(with_faults(load_scenario("side"), rules[1:], "side").fault) == MOST_RULES
