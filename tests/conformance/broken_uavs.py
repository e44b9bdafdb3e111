"""UAVs that break one rule each: small mutations of the example of a foreign UAV."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.conformance.script import PLAN_KEYS
from fleet.model.words import ClockMode

LOCKSTEP, REALTIME = ClockMode.LOCKSTEP, ClockMode.REALTIME


@dataclass(frozen=True)
class Mutation:
    """A text of a file of the example, what stands in its place, and the rule that this breaks."""

    file: str
    old: str
    new: str
    breaks: str
    clock: ClockMode = LOCKSTEP
    also: tuple[str, ...] = ()
    """Further rules that it breaks."""


STEP = "                self.step(last)\n                self.done(last)"
PUT = "            self.put(suffix, message)"
HELD = 'if self.number not in grant.get("held", ())'
TOKEN = 'watch, tokens.declare_token(f"{key}/{self.number}/alive")'
RETURN = '            if grant["state"] == "stop":\n                return'
NEWEST = 'if newest.get(key, -1) < found[1]["seq"]'
TIMELY = "        self.step(tick)\n"

NOT_OBEYED = "no_mandate", "stale_term", "unknown_term", "unknown_manoeuvre", "beyond_limits"

MUTATIONS: dict[str, Mutation] = {
    "silent": Mutation(
        "joining", PUT, "            pass", "tells its true state once in every step"
    ),
    "never done": Mutation(
        "joining", STEP, "                self.step(last)", "takes part to the end"
    ),
    "done before it has sent": Mutation(
        "joining",
        STEP,
        "                self.done(last)\n                self.step(last)",
        "says to be done after all that it sends in a tick",
    ),
    "in haste": Mutation(
        "joining",
        "while not self.waiting.keys() >= set(pairs)",
        "pairs = [p for p in pairs if p[0] != 1 or p in self.waiting]\n"
        "        while not self.waiting.keys() >= set(pairs)",
        "waits for all that the manifest lists",
    ),
    "forgets what is early": Mutation(
        "joining",
        "return [self.waiting.pop(pair) for pair in pairs]",
        "taken, self.waiting = [self.waiting[pair] for pair in pairs], {}\n        return taken",
        "keeps what comes early until it is listed",
    ),
    "steps on any grant": Mutation(
        "joining",
        'last is not None and grant["tick"] != last + 1',
        "False",
        "steps on no grant but the next",
    ),
    "steps while it is held": Mutation(
        "joining", HELD, "if True", "does not step while it is held"
    ),
    "no liveliness token": Mutation(
        "joining", TOKEN, "watch", "declares its liveliness token before it is ready"
    ),
    "never leaves": Mutation(
        "joining",
        RETURN,
        "            if False:\n                return",
        "leaves when the run is over",
    ),
    "wrong counts": Mutation(
        "joining",
        "{suffix: count for suffix",
        "{suffix: count + 1 for suffix",
        "says how much it has sent",
    ),
    "wrong digests": Mutation(
        "joining", "digest_size=8", "digest_size=16", "tells the digests of what it has sent"
    ),
    "not a number": Mutation(
        "uav",
        '{"speed_mps": self.speed, ',
        '{"speed_mps": math.nan, ',
        "sends nothing that is malformed",
    ),
    "in another's name": Mutation(
        "direct",
        '{"id": self.number, "seq"',
        '{"id": 3, "seq"',
        "speaks on topics of its own",
    ),
    "gaps in its numbers": Mutation(
        "direct",
        "self.counts.get(kind, -1) + 1",
        "self.counts.get(kind, -2) + 2",
        "numbers the messages of each class from 0, without a gap",
    ),
    "marks a wrong time": Mutation(
        "direct",
        '"t_ns": t_ns, **fields}',
        '"t_ns": max(0, t_ns - self.tick_ns), **fields}',
        "marks messages with the time of the step",
    ),
    "broadcasts too seldom": Mutation(
        "direct",
        'round(scenario["surveillance"]["broadcast_s"] * 1e9)',
        "400_000_000",
        "broadcasts whenever it is due, and then alone",
    ),
    "broadcasts another place": Mutation(
        "direct",
        "{**self.shared(truth), **fields}",
        '{**self.shared(truth), "position_ned_m": [0.0, 0.0, 0.0], **fields}',
        "broadcasts its true state",
    ),
    "says to be equipped otherwise": Mutation(
        "direct",
        '"equipment": self.equipment',
        '"equipment": "full"',
        "says the equipment that the scenario gives it",
    ),
    "ignores elections": Mutation(
        "uav",
        '        term, issuer = election["term"], election["id"]',
        '        return\n        term, issuer = election["term"], election["id"]',
        "keeps the election that names it",
    ),
    "wrong term": Mutation(
        "uav",
        'not in election["members"] or term < self.terms[1]',
        'not in election["members"]',
        "ignores elections of a lower term",
    ),
    "believes terms of others": Mutation(
        "uav", "whose != issuer or ", "", "ignores elections in a term that is not their issuer's"
    ),
    "mandate for ever": Mutation(
        "uav",
        'return self.mandate is not None and self.now_ns <= self.mandate["valid_until_ns"]',
        "return self.mandate is not None",
        "lets a mandate end at its time",
    ),
    "mandate as long as the elector says": Mutation(
        "uav",
        "min(until_ns, limit_ns)",
        "until_ns",
        "lets a mandate last no longer than `election_valid_s` after it heard it",
    ),
    "always hears": Mutation(
        "uav",
        '"hears": hears',
        '"hears": True',
        "says whether it hears others",
    ),
    "forgets": Mutation(
        "uav",
        "if self.terms != before:",
        "if False:",
        "tells what must outlive it, whenever that changes",
    ),
    "wrong issuer": Mutation(
        "uav",
        '"wrong_issuer": command["id"] != mandate["computing"]',
        '"wrong_issuer": False',
        "refuses what is `wrong_issuer`",
    ),
    "answers expired commands": Mutation(
        "uav",
        '"expired": self.now_ns > command["expiry_ns"]',
        '"expired": False',
        "refuses what is `expired`",
    ),
    "applies twice": Mutation(
        "uav", "if name == applied:", "if False:", "refuses what is `duplicate`"
    ),
    "never answers": Mutation(
        "uav",
        "out.append(self.on_command(message, at_ns))",
        "self.on_command(message, at_ns)",
        "answers every command once",
    ),
    "does not fly what it accepts": Mutation(
        "uav",
        'self.pending = {**command, "start_ns": start_ns}',
        "pass",
        "flies what it has accepted, from then on",
    ),
    "never returns": Mutation(
        "uav",
        '"manoeuvre_end_ns"] <= self.now_ns:\n                self.active = None',
        '"manoeuvre_end_ns"] <= self.now_ns:\n'
        '                self.active["manoeuvre_end_ns"] += 10**12',
        "returns to its plan when a manoeuvre lapses",
    ),
    "handles as it comes": Mutation(
        "joining",
        "ORDER.index(d[1])",
        "-ORDER.index(d[1])",
        "handles an election before the commands of its tick",
    ),
    "deaf to the plan": Mutation(
        "link_faults",
        "for place, rule in enumerate(self.plan):",
        "for place, rule in ():",
        "applies faults of kind `loss`",
        also=tuple(f"applies faults of kind `{kind}`" for kind, _ in PLAN_KEYS),
    ),
    "draws in another order": Mutation(
        "link_faults",
        "labels = count, sent.dst, sent.src, sent.seq",
        "labels = count, sent.src, sent.dst, sent.seq",
        "applies faults of kind `duplicate`",
    ),
    "does not say where it is": Mutation(
        "joining",
        'self.placed = any(rule["kind"] == "range" for rule in plan)',
        "self.placed = False",
        "tells where it is while the plan has a rule of `range`",
    ),
    "late": Mutation(
        "joining",
        TIMELY + "        if behind_ns > self.tick_ns // 10:",
        "        time.sleep(0.2)\n" + TIMELY + "        if False:",
        "tells when a step begins late",
        REALTIME,
    ),
    "ahead of its time": Mutation(
        "joining",
        "wait_s = (due_ns - time.time_ns())",
        "wait_s = (due_ns - 50_000_000 - time.time_ns())",
        "steps at each tick of the wall clock",
        REALTIME,
    ),
    "all at once": Mutation(
        "joining",
        " + self.phase_ns(self.number)",
        "",
        "steps at each tick of the wall clock",
        REALTIME,
    ),
    "no time of publication": Mutation(
        "joining",
        "attachment = mark if self.timed or self.placed else None",
        "attachment = None",
        "marks what it sends with the time of publication",
        REALTIME,
    ),
    "uses old numbers": Mutation("joining", NEWEST, "if True", "uses no number twice", REALTIME),
    "done in every tick": Mutation(
        "joining",
        TIMELY,
        TIMELY + "        self.done(tick)\n",
        "is done once, after the last tick",
        REALTIME,
    ),
    "obeys everything": Mutation(
        "uav",
        "        mandate, (_, minimum, *applied) = self.mandate, self.terms",
        '        return ""\n        mandate, (_, minimum, *applied) = self.mandate, self.terms',
        "refuses what is `superseded`",
        also=tuple(f"refuses what is `{reason}`" for reason in NOT_OBEYED),
    ),
    "obeys nothing": Mutation(
        "uav",
        "        if name == applied:",
        '        if name:\n            return "no_mandate"\n        if name == applied:',
        "obeys a command of its mandate",
        also=("flies a commanded speed",),
    ),
    "flies what it refuses": Mutation(
        "uav", "        if not reason:\n", "        if True:\n", "flies nothing that it has refused"
    ),
    "uses what nobody listed": Mutation(
        "joining",
        "return [self.waiting.pop(pair) for pair in pairs]",
        "old = {p for p in self.waiting for q in pairs if p[0] == q[0] and p[1] < q[1]}\n"
        "        return [self.waiting.pop(pair) for pair in {*pairs, *old}]",
        "uses nothing that no manifest lists",
    ),
    "does not number by tick": Mutation(
        "joining",
        '"id": self.number, "seq": seq, "t_ns"',
        '"id": self.number, "seq": 0, "t_ns"',
        "numbers `done` by its tick",
    ),
    "too fast": Mutation(
        "uav", "p + dt * v for", "p + 100 * dt * v for", "flies no faster than it says"
    ),
    "a UAV's heartbeat": Mutation(
        "joining",
        'good = good and (kind != "heartbeat" or message["id"] == 0)',
        "pass",
        "uses nothing of strangers, and no garbage",
        REALTIME,
    ),
    "a UAV elects another": Mutation(
        "uav",
        'issuer not in (0, election["computing"])',
        "False",
        "ignores a UAV that elects another UAV",
    ),
    "its own group alone": Mutation(
        "uav",
        "        self.terms[0] = max(self.terms[0], term)\n        if self.number",
        "        if self.number",
        "tells the highest term of all elections, of any group",
    ),
    "does not say from when": Mutation(
        "uav",
        '"actuate_ns": start_ns',
        '"actuate_ns": 0',
        "tells when a command begins to be flown",
    ),
    "does not resume": Mutation(
        "uav",
        'self.pending if self.pending["manoeuvre"] != "resume" else None',
        "self.pending",
        "returns to its plan on `resume`",
    ),
    "elects": Mutation(
        "uav",
        '        out.append(("truth", self.truth()))',
        '        out += [("truth", self.truth()), ("heartbeat", {"highest_term": 0})]',
        "elects nobody that it may not",
    ),
    "reports nothing": Mutation(
        "direct",
        "        if rows:",
        "        if rows[100:]:",
        "reports all that it takes in, as of when it was delivered",
    ),
    "reports in another order": Mutation(
        "direct",
        "columns = zip(*rows, strict=True)",
        "columns = zip(*rows[::-1], strict=True)",
        "reports in the order in which it handles",
    ),
    "delivers at once": Mutation(
        "joining",
        "at_ns = arrived_ns + delay_ns if self.timed",
        "at_ns = arrived_ns if self.timed",
        "delivers on arrival, or so much later as the plan says",
        REALTIME,
    ),
    "keeps its plan": Mutation(
        "joining",
        'if said.get("plan")',
        "if False",
        "applies the fault plan, also when it changes",
        REALTIME,
    ),
    "believes in the future": Mutation(
        "joining",
        "FUTURE_NS = 5_000_000_000",
        "FUTURE_NS = 10**18",
        "uses nothing that is from the future",
        REALTIME,
    ),
    "believes anybody": Mutation(
        "joining",
        'good = self.issuers[issuer] == message["id"]',
        "good = True",
        "uses nothing of strangers, and no garbage",
        REALTIME,
    ),
}
"""By what is wrong with them."""

SEVERAL = (
    "does not number by tick",
    "a UAV elects another",
    "does not say from when",
    "elects",
    "reports in another order",
)
"""These do not get in each other's way: one UAV has all of them."""

STALLING = ("never done", "never leaves", "forgets what is early")
"""What these have to do never comes: they are waited for no longer than it takes."""
