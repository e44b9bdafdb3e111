"""Failover: kill the computing UAV, the coordinator, or both in the middle of a resolution.

    python -m benchmarks.failover [SCENARIO] [--at SECONDS]

Without --at the processes are killed 1 s after the first command was accepted. Prints how long it
took until somebody else was elected, against the limit that the scenario implies, how near the
aircraft came, the unmanned one included, and how many of the others arrived; then who commanded
whom and when.
"""

from __future__ import annotations

import argparse

from benchmarks.flown import Outcome, Telling
from fleet.analysis.invariants import RecordedRun, check
from fleet.analysis.recorded_run import RecordCollector
from fleet.config.loading import read_scenario, with_faults
from fleet.config.scenario import Scenario
from fleet.model.units import to_s
from fleet.protocol import codec
from fleet.protocol.messages import Ack, Command, Election, Message
from fleet.simulation.in_memory import run_in_memory

KILLS = {"nobody": (), "computing UAV": ("1",), "coordinator": ("coordinator",)}
KILLS["both"] = (*KILLS["computing UAV"], *KILLS["coordinator"])


def fly(scenario: Scenario) -> tuple[Outcome, RecordCollector, list[Message]]:
    """Fly it in memory; what came of it, the records, and all messages but those of the clock."""
    records = RecordCollector()
    run_recorder = Telling(scenario, records)
    for _ in run_in_memory(scenario, run_recorder):
        pass
    kept = [r for r in records.kept if not r.topic.startswith("sim/")]
    return run_recorder.outcome(), records, [codec.decode(r.topic, r.payload) for r in kept]


def takeover_limit_s(scenario: Scenario, killed: tuple[str, ...]) -> float:
    """Until another is elected, if these are killed.

    With a coordinator its silence limit counts, else also the mandate that has to run out.
    """
    c = scenario.coordination
    wait_s = c.silence_limit_s
    if "coordinator" in killed:
        wait_s = max(c.silence_limit_s, c.election_valid_s)
    return wait_s + c.update_s + scenario.surveillance.broadcast_s + 2.0 * scenario.tick_s


def main() -> None:
    """Fly all four and print the table and the story of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="four_way")
    parser.add_argument("--at", type=float, default=0.0)
    options = parser.parse_args()
    plain = read_scenario(options.scenario).scenario
    at_s = options.at
    if not at_s:
        accepted = [m for m in fly(plain)[2] if isinstance(m, Ack) and m.accepted]
        at_s = to_s(accepted[0].t_ns) + 1.0
    print(f"{options.scenario}, killed at {at_s:g} s\n")
    print(
        "| killed | elected anew after | limit | least separation | losses | arrived | invariants |"
    )
    print("|---|---|---|---|---|---|---|")
    stories = []
    for name, nodes in KILLS.items():
        faults = [{"kind": "kill", "node": node, "start_s": at_s} for node in nodes]
        scenario = with_faults(plain, faults, options.scenario)
        outcome, records, messages = fly(scenario)
        later = [m for m in messages if isinstance(m, Election) and to_s(m.t_ns) > at_s]
        old = {m.term for m in messages if isinstance(m, Election) and to_s(m.t_ns) <= at_s}
        anew = next((m for m in later if m.term not in old), None)
        took = f"{to_s(anew.t_ns) - at_s:.1f} s, UAV {anew.computing}" if anew and nodes else "-"
        limit = f"{takeover_limit_s(scenario, nodes):.1f} s" if nodes else "-"
        flown, lost = outcome.arrivals.flown, len(outcome.separation.lost)
        arrived = f"{sum(row.arrived for row in flown)} of {len(flown)}"
        verdict = check(RecordedRun.of_records(scenario, records.kept)).overall
        least = outcome.separation.least
        cells = (name, took, limit, f"{least:.3f}", lost, arrived, verdict)
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
        commands = [m for m in messages if isinstance(m, Command) and m.t_ns == m.issued_ns]
        told = [f"{to_s(m.t_ns):.1f} s {m.id} to {m.target}: {m.manoeuvre}" for m in commands]
        stories.append(f"{name}: {'; '.join(told)}")
    print()
    print("\n".join(stories))


if __name__ == "__main__":
    main()
