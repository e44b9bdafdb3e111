"""One UAV of a run, by a relay: `python uav.py ENDPOINT NUMBER`, beside `fleet relay NUMBER`.

Written from docs/protocol/foreign.md alone, with eclipse-zenoh and msgpack: it flies its waypoints,
tells what it flies, and obeys. It computes for nobody: its `equipment` is `no_compute`.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import threading
from typing import Any

import msgpack
import zenoh

Message = dict[str, Any]
Told = tuple[str, Message]  # class of a message, and its fields
Course = tuple[float, float, float, float]  # heading, climb, speed, where a climb levels off

MANOEUVRES = "turn", "climb", "turn_climb", "speed", "resume"
REMEMBERED = "highest_term", "mandate_term", "applied_term", "applied_number"
NO_COMMAND: Message = {"term": 0, "id": 0, "number": 0, "manoeuvre": ""}


def near(a: float, b: float, most: float) -> float:
    """`b` as far as it is from `a` by no more than `most`."""
    return a + min(max(b - a, -most), most)


def wrapped(angle: float) -> float:
    """The same direction in [-pi, pi]."""
    return math.remainder(angle, math.tau)


class Uav:
    """Flight, elections and obedience, without a network: `step` says what is to be sent."""

    def __init__(self, plan: Message) -> None:
        self.scenario, self.uav = plan["scenario"], plan["uav"]
        self.number, self.electors = plan["number"], [0, *plan["uavs"]]
        self.limits, self.goals = self.uav["performance"], self.uav["waypoints_ned_m"]
        start = plan["start"]
        self.place, self.index = list(start["position_ned_m"]), start["waypoint_index"]
        self.speed, self.climb, self.now_ns = start["speed_mps"], start["climb_mps"], start["t_ns"]
        self.heading = self.course = start["heading_rad"]
        self.terms = [start[name] for name in REMEMBERED]
        self.mandate: Message | None = None
        self.pending: Message | None = None
        self.active: Message | None = None

    def guidance(self) -> Course:
        """Heading, climb and speed to the active waypoint; after the last one, straight on."""
        goal = self.goals[min(self.index, len(self.goals) - 1)]
        climb = (self.place[2] - goal[2]) / self.scenario["guidance"]["level_off_s"]
        climb = near(0.0, climb, self.uav["guidance_climb_mps"])
        if self.index < len(self.goals):
            self.course = math.atan2(goal[1] - self.place[1], goal[0] - self.place[0])
        return self.course, climb, self.uav["speed_mps"], goal[2]

    def wanted(self) -> Course:
        """The same, with the manoeuvre in place of what it replaces."""
        heading, climb, speed, level = self.guidance()
        active = self.active or NO_COMMAND
        kind = active["manoeuvre"]
        if kind in ("turn", "turn_climb"):
            heading = active["heading_rad"]
        if kind in ("climb", "turn_climb"):
            level = active["level_down_m"]
            climb = near(0.0, self.place[2] - level, abs(active["climb_mps"]))
        return heading, climb, active["speed_mps"] if kind == "speed" else speed, level

    def fly_to(self, time_ns: int) -> None:
        """Fly on, and switch exactly when a command says so."""
        while True:
            if self.pending and self.pending["start_ns"] <= self.now_ns:
                self.active = self.pending if self.pending["manoeuvre"] != "resume" else None
                self.pending = None
            if self.active and self.active["manoeuvre_end_ns"] <= self.now_ns:
                self.active = None
            if self.now_ns >= time_ns:
                return
            ends = [self.pending["start_ns"]] if self.pending else []
            ends += [self.active["manoeuvre_end_ns"]] if self.active else []
            self.move_to(min([time_ns, self.now_ns + 200_000_000, *ends]))

    def move_to(self, until_ns: int) -> None:
        """Turn at the bank limit, climb at the limit of the rate, for 0.2 s at most."""
        dt = (until_ns - self.now_ns) / 1e9
        heading, climb, speed, _ = self.wanted()
        rate = 9.80665 * math.tan(math.radians(self.limits["max_bank_deg"])) / self.speed
        turn = near(0.0, wrapped(heading - self.heading), rate * dt)
        pull = self.speed * math.radians(self.limits["max_flight_path_rate_degps"]) * dt
        self.climb = near(self.climb, climb, pull)
        self.speed = near(self.speed, speed, self.limits["max_acceleration_mps2"] * dt)
        level, middle = self.level_mps(), self.heading + turn / 2
        moved = level * math.cos(middle), level * math.sin(middle), -self.climb
        self.place = [p + dt * v for p, v in zip(self.place, moved, strict=True)]
        self.heading, self.now_ns = wrapped(self.heading + turn), until_ns
        here, radius = self.place[:2], self.scenario["guidance"]["arrival_radius_m"]
        while self.index < len(self.goals) and math.dist(here, self.goals[self.index][:2]) < radius:
            self.index += 1

    def level_mps(self) -> float:
        """The part of the speed that is level."""
        return math.sqrt(self.speed * self.speed - self.climb * self.climb)

    def valid(self) -> bool:
        """Whether the mandate is in force."""
        return self.mandate is not None and self.now_ns <= self.mandate["valid_until_ns"]

    def on_election(self, election: Message, at_ns: int) -> None:
        """Keep the highest one that names this UAV; the others tell of their terms alone."""
        term, issuer = election["term"], election["id"]
        whose = self.electors[term % len(self.electors)]
        if whose != issuer or term < 1 or issuer not in (0, election["computing"]):
            return
        self.terms[0] = max(self.terms[0], term)
        if self.number not in election["members"] or term < self.terms[1]:
            return
        self.terms[1] = term
        before = self.mandate if self.mandate and self.mandate["term"] == term else election
        until_ns = max(election["valid_until_ns"], before["valid_until_ns"])
        limit_ns = at_ns + round(self.scenario["coordination"]["election_valid_s"] * 1e9)
        self.mandate = {**election, "valid_until_ns": min(until_ns, limit_ns)}

    def refusal(self, command: Message) -> str:
        """Why a command is not obeyed; empty if it is. The first reason counts."""
        mandate, (_, minimum, *applied) = self.mandate, self.terms
        term, name = command["term"], [command["term"], command["number"]]
        if name == applied:
            return "duplicate"
        if mandate is None or term < minimum:
            return "stale_term" if term < minimum else "no_mandate"
        share = (command.get("speed_mps") or 0.0) / self.uav["speed_mps"]
        flyable = self.limits["min_speed_share"] <= share <= self.limits["max_speed_share"]
        reasons = {
            "unknown_term": term > mandate["term"],
            "wrong_issuer": command["id"] != mandate["computing"],
            "superseded": name < applied,
            "no_mandate": not self.valid(),
            "expired": self.now_ns > command["expiry_ns"],
            "unknown_manoeuvre": command["manoeuvre"] not in MANOEUVRES,
            "beyond_limits": command["manoeuvre"] == "speed" and not flyable,
        }
        return next((reason for reason, holds in reasons.items() if holds), "")

    def on_command(self, command: Message, at_ns: int) -> Told:
        """Obey it or not; the answer says which, and why."""
        reason, start_ns = self.refusal(command), 0
        if not reason:
            start_ns = max(command["start_ns"], at_ns)
            self.pending = {**command, "start_ns": start_ns}
            self.terms[2:] = command["term"], command["number"]
        named = {"target": command["id"], "term": command["term"], "number": command["number"]}
        told = {"accepted": not reason, "reason": reason, "actuate_ns": start_ns}
        return "ack", {**named, **told}

    def step(self, asked: Message) -> list[Told]:
        """Fly to the time that is asked for, acting on each message at its own; what to send."""
        out, before = list[Told](), [*self.terms]
        for at_ns, kind, message in asked["inbox"]:
            self.fly_to(at_ns)
            if kind == "heartbeat":
                self.terms[0] = max(self.terms[0], message["highest_term"])
            elif kind == "election":
                self.on_election(message, at_ns)
            elif kind == "cmd":
                out.append(self.on_command(message, at_ns))
        self.fly_to(asked["t_ns"])
        out.append(("truth", self.truth()))
        if asked["broadcast"]:
            out.append(("adsb", self.intent(asked["present"])))
        if self.terms != before:
            out.append(("persistent_state", dict(zip(REMEMBERED, self.terms, strict=True))))
        return out

    def truth(self) -> Message:
        """The true state, and what is flown."""
        (guided, up, *_), (heading, climb, speed, level) = self.guidance(), self.wanted()
        active, ahead = self.active or NO_COMMAND, self.level_mps()
        velocity = [ahead * math.cos(self.heading), ahead * math.sin(self.heading), -self.climb]
        on_plan = "arrived" if self.index >= len(self.goals) else "plan"
        state: Message = {"position_ned_m": self.place, "velocity_ned_mps": velocity}
        state |= {"speed_mps": self.speed, "heading_rad": self.heading}
        state |= {"flight_path_rad": math.asin(self.climb / self.speed)}
        flown: Message = {"mode": active["manoeuvre"] or on_plan, "waypoint_index": self.index}
        flown |= {"guidance_heading_rad": guided, "guidance_climb_mps": up}
        flown |= {"commanded_heading_rad": heading, "commanded_climb_mps": climb}
        flown |= {"commanded_speed_mps": speed} if active["manoeuvre"] == "speed" else {}
        flown |= {"commanded_level_down_m": level, "command_term": active["term"]}
        flown |= {"command_issuer": active["id"], "command_number": active["number"]}
        return {**state, **flown}

    def intent(self, present: list[int]) -> Message:
        """What a broadcast tells beside the true state: where to, and under which election."""
        guided, _, cruise, _ = self.guidance()
        arrived, (north, east) = self.index >= len(self.goals), self.place[:2]
        beyond = [north + 1000.0 * math.cos(guided), east + 1000.0 * math.sin(guided)]
        goals = [*self.goals[self.index :], [*beyond, self.goals[-1][2]]]
        goal, after = goals[0], goals[min(1, len(goals) - 1)]
        turn = wrapped(math.atan2(after[1] - goal[1], after[0] - goal[0]) - guided)
        reach_s = math.dist(self.place[:2], goal[:2]) / max(self.level_mps(), 1.0)
        group = self.mandate["members"] if self.mandate and self.valid() else present
        deaf_ns = round(self.scenario["coordination"]["silence_limit_s"] * 1e9)
        hears = any(n in group for n in present) or self.now_ns <= deaf_ns
        told: Message = {"waypoint_ned_m": goal, "next_waypoint_ned_m": after, "hears": hears}
        told |= {"reach_s": 1e6 if arrived else reach_s, "next_heading_rad": wrapped(guided + turn)}
        told |= {"next_turn_rad": 0.0 if arrived else turn, "next_climb_mps": 0.0}
        told |= {"highest_term": self.terms[0], "mandate_term": self.terms[1]}
        told |= {"guidance_speed_mps": cruise} if self.speed != cruise else {}
        return {**told, "mandate_valid": self.valid()}


def answer_relay(endpoint: str, number: str) -> None:
    """Answer what the relay of a UAV asks, until it says to stop or is gone."""
    config = {"mode": "client", "connect": {"endpoints": [endpoint], "timeout_ms": 60_000}}
    config |= {"scouting": {"multicast": {"enabled": False}}}
    over, flying = threading.Event(), list[Uav]()

    def answer(query: zenoh.Query) -> None:
        asked = msgpack.unpackb(query.payload.to_bytes()) if query.payload else {}
        if "plan" in asked:
            flying[:] = [Uav(asked["plan"])]
        told = flying[0].step(asked) if "tick" in asked else []
        query.reply(query.key_expr, msgpack.packb(told))
        if "stop" in asked:
            over.set()

    def on_token(token: zenoh.Sample) -> None:
        if token.kind == zenoh.SampleKind.DELETE:  # the relay has been killed
            over.set()

    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        alive = session.liveliness().declare_subscriber(f"fleet/*/{number}/alive", on_token)
        queryable = session.declare_queryable(f"fleet/*/{number}/step", answer)
        over.wait()
        queryable.undeclare()
        alive.undeclare()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it, whatever it waits for
    if len(sys.argv) != 3 or not sys.argv[2].isdecimal():
        print("usage: python uav.py ENDPOINT NUMBER", file=sys.stderr)
        sys.exit(2)
    answer_relay(*sys.argv[1:])
