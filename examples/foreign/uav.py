"""One UAV of a run, on either clock and under faults: `python uav.py ENDPOINT NUMBER`.

Written from docs/protocol alone, with eclipse-zenoh and msgpack (in `joining`): it flies its
waypoints, tells what it flies, and obeys. It computes for nobody: `equipment` is `no_compute`.
"""

from __future__ import annotations

import math
import sys

from joining import Due, Failed, Message, Sent, take_part

Course = tuple[float, float, float, float]

MANOEUVRES = "turn", "climb", "turn_climb", "speed", "resume"
REPORT = "src", "kinds", "seqs", "sent_ns", "delivered_ns", "fates"
REMEMBERED = "highest_term", "mandate_term", "applied_term", "applied_number"


def near(a: float, b: float, most: float) -> float:
    """`b` as far as it is from `a` by no more than `most`."""
    return a + min(max(b - a, -most), most)


def wrapped(angle: float) -> float:
    """The same direction in [-pi, pi]."""
    return math.remainder(angle, math.tau)


class Uav:
    """Flight, elections and obedience, without a network: `step` says what is to be sent."""

    def __init__(self, number: int, scenario: Message, uavs: list[Message]) -> None:
        self.number, self.scenario = number, scenario
        self.tick_ns, self.told_ns = round(scenario["tick_s"] * 1e9), -1
        self.uav = next(u for u in uavs if u["id"] == number)
        self.electors = [0, *sorted(u["id"] for u in uavs)]
        self.limits = self.uav["performance"] or scenario["performance"]
        self.place, self.index = list(self.uav["position_ned_m"]), 0
        self.goals = [list(goal) for goal in self.uav["waypoints_ned_m"]]
        self.speed, self.climb = self.uav["speed_mps"], self.uav["climb_mps"]
        self.heading = self.course = math.radians(self.uav["heading_deg"])
        self.now_ns = 0
        self.counts: dict[str, int] = {}
        self.terms = (0, 0, 0, 0)
        self.seen: dict[int, int] = {}
        self.mandate: Message | None = None
        self.pending: Message | None = None
        self.active: Message | None = None

    def guidance(self) -> Course:
        """Heading, climb and speed to the active waypoint; after the last one, straight on."""
        goal = self.goals[min(self.index, len(self.goals) - 1)]
        climb = (self.place[2] - goal[2]) / self.scenario["guidance"]["level_off_s"]
        climb = near(0.0, climb, self.scenario["guidance"]["climb_mps"])
        if self.index >= len(self.goals):
            return self.course, climb, self.uav["speed_mps"], goal[2]
        self.course = math.atan2(goal[1] - self.place[1], goal[0] - self.place[0])
        return self.course, climb, self.uav["speed_mps"], goal[2]

    def wanted(self) -> Course:
        """The same, with the manoeuvre in place of what it replaces."""
        heading, climb, speed, level = self.guidance()
        if not self.active:
            return heading, climb, speed, level
        kind = self.active["manoeuvre"]
        if kind in ("turn", "turn_climb"):
            heading = self.active["heading_rad"]
        if kind in ("climb", "turn_climb"):
            level = self.active["level_down_m"]
            climb = near(0.0, self.place[2] - level, abs(self.active["climb_mps"]))
        return heading, climb, self.active["speed_mps"] if kind == "speed" else speed, level

    def fly_to(self, time_ns: int) -> None:
        """Turn at the bank limit, climb at the limit of the rate; switch when a command says so."""
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
            until_ns = min([time_ns, self.now_ns + 200_000_000, *ends])
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
            while (
                self.index < len(self.goals)
                and math.dist(self.place[:2], self.goals[self.index][:2])
                < self.scenario["guidance"]["arrival_radius_m"]
            ):
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
        highest, minimum, *applied = self.terms
        self.terms = (max(highest, term), minimum, *applied)
        if self.number not in election["members"] or term < minimum:
            return
        until_ns = election["valid_until_ns"]
        if self.mandate and self.mandate["term"] == term:
            until_ns = max(until_ns, self.mandate["valid_until_ns"])
        limit_ns = at_ns + round(self.scenario["coordination"]["election_valid_s"] * 1e9)
        self.mandate = {**election, "valid_until_ns": min(until_ns, limit_ns)}
        self.terms = (max(highest, term), term, *applied)

    def refusal(self, command: Message) -> str:
        """Why a command is not obeyed; empty if it is. The first reason counts."""
        mandate, (_, minimum, *applied) = self.mandate, self.terms
        term, name = command["term"], [command["term"], command["number"]]
        if name == applied:
            return "duplicate"
        if term < minimum:
            return "stale_term"
        if mandate is None:
            return "no_mandate"
        reasons = {
            "stale_term": term < mandate["term"],
            "unknown_term": term > mandate["term"],
            "wrong_issuer": command["id"] != mandate["computing"],
            "superseded": name < applied,
            "no_mandate": not self.valid(),
            "expired": self.now_ns > command["expiry_ns"],
            "unknown_manoeuvre": command["manoeuvre"] not in MANOEUVRES,
            "beyond_limits": not self.flyable(command),
        }
        return next((reason for reason, holds in reasons.items() if holds), "")

    def flyable(self, command: Message) -> bool:
        """Whether the speed of a command is one that this UAV may fly."""
        if command["manoeuvre"] != "speed":
            return True
        share = (command.get("speed_mps") or 0.0) / self.uav["speed_mps"]
        return bool(self.limits["min_speed_share"] <= share <= self.limits["max_speed_share"])

    def on_command(self, command: Message, at_ns: int) -> Sent:
        """Obey it or not; the answer says which, and why."""
        reason, start_ns = self.refusal(command), 0
        if not reason:
            start_ns = max(command["start_ns"], at_ns)
            self.pending = {**command, "start_ns": start_ns}
            self.terms = (*self.terms[:2], command["term"], command["number"])
            self.fly_to(self.now_ns)
        ack = {key: command[key] for key in ("term", "number", "issued_ns")}
        ack |= {"target": command["id"], "accepted": not reason, "reason": reason}
        return f"ack/{command['id']}", {**ack, "actuate_ns": start_ns, "t_ns": at_ns}

    def step(self, now_ns: int, inbox: list[Due], failed: list[Failed]) -> list[Sent]:
        """Fly to `now_ns`, acting on (delivered_ns, kind, message) as delivered; what to send."""
        out, before = list[Sent](), self.terms
        if now_ns - self.now_ns > self.tick_ns:
            self.fly_to(now_ns)  # it has been held: what came meanwhile is handled now
        for delivered_ns, kind, message in inbox:
            self.fly_to(min(max(delivered_ns, self.now_ns), now_ns))
            if kind == "adsb":
                self.seen[message["id"]] = self.now_ns
            elif kind == "heartbeat":
                self.terms = (max(self.terms[0], message["highest_term"]), *self.terms[1:])
            elif kind == "election":
                self.on_election(message, self.now_ns)
            elif kind == "cmd":
                out.append(self.on_command(message, self.now_ns))
        self.fly_to(now_ns)
        out += self.told(now_ns)
        if self.terms != before:
            out.append(("persistent_state", dict(zip(REMEMBERED, self.terms, strict=True))))
        rows = [(m["id"], k, m["seq"], m["t_ns"], at_ns, "received") for at_ns, k, m in inbox]
        rows += [(m["id"], k, m["seq"], m["t_ns"], 0, fate) for k, m, fate in failed]
        if rows:
            columns = zip(*rows, strict=True)
            out.append(("delivery", dict(zip(REPORT, columns, strict=True))))
        return [(suffix, self.headed(suffix, now_ns, fields)) for suffix, fields in out]

    def headed(self, suffix: str, now_ns: int, fields: Message) -> Message:
        """A message with its header; every class counts for itself, true states by the tick."""
        kind = suffix.partition("/")[0]
        count = self.counts[kind] = self.counts.get(kind, -1) + 1
        seq = now_ns // self.tick_ns if kind == "truth" else count
        return {"id": self.number, "seq": seq, "t_ns": now_ns, **fields}

    def told(self, now_ns: int) -> list[Sent]:
        """The true state, and when it is due the broadcast."""
        (guided, up, cruise, _), (heading, climb, speed, level) = self.guidance(), self.wanted()
        ahead = self.level_mps()
        velocity = [ahead * math.cos(self.heading), ahead * math.sin(self.heading), -self.climb]
        active = self.active or {"term": 0, "id": 0, "number": 0, "manoeuvre": ""}
        path = math.asin(self.climb / self.speed)
        flown: Message = {"position_ned_m": self.place, "velocity_ned_mps": velocity}
        flown |= {"speed_mps": self.speed, "heading_rad": self.heading, "flight_path_rad": path}
        flown |= {"guidance_heading_rad": guided, "guidance_climb_mps": up}
        flown |= {"commanded_heading_rad": heading, "commanded_climb_mps": climb}
        flown |= {"commanded_level_down_m": level, "command_term": active["term"]}
        flown |= {"command_issuer": active["id"], "command_number": active["number"]}
        arrived = self.index >= len(self.goals)
        mode = active["manoeuvre"] or ("arrived" if arrived else "plan")
        own: Message = {"commanded_speed_mps": speed} if mode == "speed" else {}
        truth = "truth", {**flown, **own, "mode": mode, "waypoint_index": self.index}
        period_ns = round(self.scenario["surveillance"]["broadcast_s"] * 1e9)
        due, self.told_ns = now_ns // period_ns > self.told_ns // period_ns, now_ns
        if not due:
            return [truth]
        own |= {"guidance_speed_mps": cruise} if self.speed != cruise else {}
        north, east, down = [*self.place[:2], self.goals[-1][2]]
        beyond = [north + 1000.0 * math.cos(guided), east + 1000.0 * math.sin(guided), down]
        goals = [*self.goals[self.index :], beyond]
        after = goals[1] if goals[1:] else goals[0]
        turn = wrapped(math.atan2(after[1] - goals[0][1], after[0] - goals[0][0]) - guided)
        reach = 1e6 if arrived else math.dist(self.place[:2], goals[0][:2]) / max(ahead, 1.0)
        intent: Message = {
            "waypoint_ned_m": goals[0],
            "next_waypoint_ned_m": after,
            "arrived": arrived,
        }
        intent |= {"reach_s": reach, "next_heading_rad": wrapped(guided + turn)}
        intent |= {"next_turn_rad": turn if goals[1:] else 0.0, "next_climb_mps": 0.0}
        intent |= {"manoeuvre": active["manoeuvre"], "applies_ns": now_ns}
        limit_ns = round(self.scenario["coordination"]["silence_limit_s"] * 1e9)
        group = self.mandate["members"] if self.mandate and self.valid() else self.seen
        hears = any(n in group and now_ns - at <= limit_ns for n, at in self.seen.items())
        terms = {"highest_term": self.terms[0], "mandate_term": self.terms[1]}
        terms |= {"mandate_valid": self.valid(), "hears": hears or now_ns <= limit_ns}
        return [("adsb/0", {**flown, **own, **intent, **terms, "equipment": "no_compute"}), truth]


if __name__ == "__main__":
    take_part(sys.argv[1], int(sys.argv[2]), Uav)
