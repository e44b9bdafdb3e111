"""The same UAV without a relay: `python direct.py ENDPOINT NUMBER`.

`joining` has its place in a run, `link_faults` what the fault plan does to what comes, `uav` the
aircraft. This is what is left between them: times, numbers, what is due, and reports.
"""

from __future__ import annotations

import math
import signal
import sys

from joining import Due, Failed, Message, Sent, take_part
from uav import REMEMBERED, Uav

REPORT = "src", "kinds", "seqs", "sent_ns", "delivered_ns", "fates"
BEGUN = "position_ned_m", "speed_mps", "climb_mps"
STATE = "position_ned_m", "velocity_ned_mps", "speed_mps", "heading_rad", "flight_path_rad"
GUIDED = "guidance_heading_rad", "guidance_climb_mps", "commanded_heading_rad"
COMMANDED = "commanded_climb_mps", "commanded_level_down_m", "commanded_speed_mps"
COMMAND = "command_term", "command_issuer", "command_number"
SHARED = STATE + GUIDED + COMMANDED + COMMAND
"""What a broadcast tells of the true state."""


class DirectUav:
    """Asks the UAV what a relay would ask it, and makes messages of what it answers."""

    def __init__(self, number: int, scenario: Message, uavs: list[Message]) -> None:
        own = next(u for u in uavs if u["id"] == number)
        own = {**own, "performance": own["performance"] or scenario["performance"]}
        guided = own["guidance_climb_mps"] or scenario["guidance"]["climb_mps"]
        start: Message = {**{key: own[key] for key in BEGUN}, **dict.fromkeys(REMEMBERED, 0)}
        start |= {"t_ns": 0, "heading_rad": math.radians(own["heading_deg"]), "waypoint_index": 0}
        plan = {"scenario": scenario, "uav": {**own, "guidance_climb_mps": guided}}
        plan |= {"number": number, "uavs": sorted(u["id"] for u in uavs), "start": start}
        self.uav, self.number, self.equipment = Uav(plan), number, own["equipment"]
        self.tick_ns, self.stepped_ns, self.last_ns = round(scenario["tick_s"] * 1e9), 0, -1
        self.period_ns = round(scenario["surveillance"]["broadcast_s"] * 1e9)
        self.silence_ns = round(scenario["coordination"]["silence_limit_s"] * 1e9)
        self.waypoints = len(own["waypoints_ned_m"])
        self.seen: dict[int, int] = {}
        self.counts: dict[str, int] = {}

    @property
    def place(self) -> list[float]:
        """Where its radio is."""
        here: list[float] = self.uav.place
        return here

    def step(self, now_ns: int, inbox: list[Due], failed: list[Failed]) -> list[Sent]:
        """Fly to `now_ns` with what has been delivered; what to send, by topic without issuer."""
        heard = [(self.handled_ns(at_ns, now_ns), kind, m) for at_ns, kind, m in inbox]
        self.seen |= {m["id"]: at_ns for at_ns, kind, m in heard if kind == "adsb"}
        present = [n for n, at_ns in self.seen.items() if now_ns - at_ns <= self.silence_ns]
        due = now_ns // self.period_ns > self.last_ns // self.period_ns
        self.stepped_ns = self.last_ns = now_ns
        asked = {"t_ns": now_ns, "broadcast": due, "present": present, "inbox": heard}
        told = self.uav.step(asked)
        commands = iter([(at_ns, m["issued_ns"]) for at_ns, kind, m in heard if kind == "cmd"])
        truth = next(fields for kind, fields in told if kind == "truth")
        out = list[Sent]()
        for kind, fields in told:
            if kind == "adsb":
                out.append(self.headed("adsb/0", now_ns, {**self.shared(truth), **fields}))
            elif kind == "ack":
                at_ns, issued_ns = next(commands)
                own = {**fields, "issued_ns": issued_ns}
                out.append(self.headed(f"ack/{fields['target']}", at_ns, own))
            else:
                out.append(self.headed(kind, now_ns, fields))
        rows = [(m["id"], k, m["seq"], m["t_ns"], at_ns, "received") for at_ns, k, m in inbox]
        rows += [(m["id"], k, m["seq"], m["t_ns"], 0, fate) for k, m, fate in failed]
        if rows:
            columns = zip(*rows, strict=True)
            out.append(self.headed("delivery", now_ns, dict(zip(REPORT, columns, strict=True))))
        return out

    def handled_ns(self, delivered_ns: int, now_ns: int) -> int:
        """When it can act on what has been delivered: who has been held does so now."""
        held = now_ns - self.stepped_ns > self.tick_ns
        return now_ns if held else min(max(delivered_ns, self.stepped_ns), now_ns)

    def shared(self, truth: Message) -> Message:
        """What a broadcast tells beside what the UAV says of it."""
        told = {name: truth[name] for name in SHARED if name in truth}
        told |= {"manoeuvre": "" if truth["mode"] in ("plan", "arrived") else truth["mode"]}
        told |= {"arrived": truth["waypoint_index"] >= self.waypoints}
        return {**told, "applies_ns": self.last_ns, "equipment": self.equipment}

    def headed(self, suffix: str, t_ns: int, fields: Message) -> Sent:
        """A message with its header; every class counts for itself, true states by the tick."""
        kind = suffix.partition("/")[0]
        count = self.counts[kind] = self.counts.get(kind, -1) + 1
        seq = self.last_ns // self.tick_ns if kind == "truth" else count
        return suffix, {"id": self.number, "seq": seq, "t_ns": t_ns, **fields}


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it, whatever it waits for
    if len(sys.argv) != 3 or not sys.argv[2].isdecimal():
        print("usage: python direct.py ENDPOINT NUMBER", file=sys.stderr)
        sys.exit(2)
    take_part(sys.argv[1], int(sys.argv[2]), DirectUav)
