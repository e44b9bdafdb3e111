// The UAV of uav.py in JavaScript, with Node.js alone: `fleet relay NUMBER -- node uav.js`.
//
// Written from docs/protocol/foreign.md: the relay asks by a line of JSON on standard input, the
// answer is a line on standard output. It computes for nobody: its `equipment` is `no_compute`.
"use strict";
const readline = require("node:readline");

const MANOEUVRES = ["turn", "climb", "turn_climb", "speed", "resume"];
const REMEMBERED = ["highest_term", "mandate_term", "applied_term", "applied_number"];
const NO_COMMAND = { term: 0, id: 0, number: 0, manoeuvre: "" };
const TAU = 2 * Math.PI;

const radians = (degrees) => degrees * (Math.PI / 180);

/** `b` as far as it is from `a` by no more than `most`. */
function near(a, b, most) {
  return a + Math.min(Math.max(b - a, -most), most);
}

/** The same direction in [-pi, pi]. */
function wrapped(angle) {
  const rest = angle % TAU;
  if (rest > Math.PI) return rest - TAU;
  return rest < -Math.PI ? rest + TAU : rest;
}

/** Horizontal distance of two places. */
function distance(a, b) {
  return Math.sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]));
}

/** Flight, elections and obedience: `step` says what is to be sent. */
class Uav {
  constructor(plan) {
    this.scenario = plan.scenario;
    this.uav = plan.uav;
    this.limits = plan.uav.performance;
    this.number = plan.number;
    this.electors = [0, ...plan.uavs];
    this.goals = plan.uav.waypoints_ned_m;
    this.place = plan.start.position_ned_m;
    this.index = plan.start.waypoint_index;
    this.nowNs = plan.start.t_ns;
    this.speed = plan.start.speed_mps;
    this.climb = plan.start.climb_mps;
    this.heading = this.course = plan.start.heading_rad;
    this.terms = REMEMBERED.map((name) => plan.start[name]);
    this.mandate = this.pending = this.active = null;
  }

  /** Heading, climb and speed to the active waypoint; after the last one, straight on. */
  guidance() {
    const goal = this.goals[Math.min(this.index, this.goals.length - 1)];
    const climb = (this.place[2] - goal[2]) / this.scenario.guidance.level_off_s;
    if (this.index < this.goals.length) {
      this.course = Math.atan2(goal[1] - this.place[1], goal[0] - this.place[0]);
    }
    const { guidance_climb_mps: most, speed_mps: speed } = this.uav;
    return { heading: this.course, climb: near(0, climb, most), speed, level: goal[2] };
  }

  /** The same, with the manoeuvre in place of what it replaces. */
  wanted() {
    const course = this.guidance();
    const { manoeuvre, heading_rad, climb_mps, level_down_m, speed_mps } = this.active ?? NO_COMMAND;
    if (manoeuvre === "turn" || manoeuvre === "turn_climb") course.heading = heading_rad;
    if (manoeuvre === "climb" || manoeuvre === "turn_climb") {
      course.level = level_down_m;
      course.climb = near(0, this.place[2] - level_down_m, Math.abs(climb_mps));
    }
    if (manoeuvre === "speed") course.speed = speed_mps;
    return course;
  }

  /** Fly on, and switch exactly when a command says so. */
  flyTo(timeNs) {
    for (;;) {
      if (this.pending && this.pending.start_ns <= this.nowNs) {
        this.active = this.pending.manoeuvre === "resume" ? null : this.pending;
        this.pending = null;
      }
      if (this.active && this.active.manoeuvre_end_ns <= this.nowNs) this.active = null;
      if (this.nowNs >= timeNs) return;
      const ends = [timeNs, this.nowNs + 200_000_000];
      if (this.pending) ends.push(this.pending.start_ns);
      if (this.active) ends.push(this.active.manoeuvre_end_ns);
      this.moveTo(Math.min(...ends));
    }
  }

  /** Turn at the bank limit, climb at the limit of the rate, for 0.2 s at most. */
  moveTo(untilNs) {
    const dt = (untilNs - this.nowNs) / 1e9;
    const { heading, climb, speed } = this.wanted();
    const rate = (9.80665 * Math.tan(radians(this.limits.max_bank_deg))) / this.speed;
    const turn = near(0, wrapped(heading - this.heading), rate * dt);
    const pull = this.speed * radians(this.limits.max_flight_path_rate_degps) * dt;
    this.climb = near(this.climb, climb, pull);
    this.speed = near(this.speed, speed, this.limits.max_acceleration_mps2 * dt);
    const [level, middle] = [this.levelMps(), this.heading + turn / 2];
    const moved = [level * Math.cos(middle), level * Math.sin(middle), -this.climb];
    this.place = this.place.map((p, n) => p + dt * moved[n]);
    this.heading = wrapped(this.heading + turn);
    this.nowNs = untilNs;
    const radius = this.scenario.guidance.arrival_radius_m;
    while (!this.arrived() && distance(this.place, this.goals[this.index]) < radius) {
      this.index += 1;
    }
  }

  arrived() {
    return this.index >= this.goals.length;
  }

  /** The part of the speed that is level. */
  levelMps() {
    return Math.sqrt(this.speed * this.speed - this.climb * this.climb);
  }

  /** Whether the mandate is in force. */
  valid() {
    return this.mandate !== null && this.nowNs <= this.mandate.valid_until_ns;
  }

  /** Keep the highest one that names this UAV; the others tell of their terms alone. */
  onElection(election, atNs) {
    const { term, id, computing } = election;
    if (term < 1 || this.electors[term % this.electors.length] !== id) return;
    if (id !== 0 && id !== computing) return;
    this.terms[0] = Math.max(this.terms[0], term);
    if (!election.members.includes(this.number) || term < this.terms[1]) return;
    this.terms[1] = term;
    const before = this.mandate?.term === term ? this.mandate.valid_until_ns : 0;
    const limit = atNs + Math.round(this.scenario.coordination.election_valid_s * 1e9);
    const until = Math.min(Math.max(election.valid_until_ns, before), limit);
    this.mandate = { ...election, valid_until_ns: until };
  }

  /** Why a command is not obeyed; empty if it is. The first reason counts. */
  refusal(command) {
    const [, minimum, appliedTerm, appliedNumber] = this.terms;
    const { term, number, manoeuvre } = command;
    if (term === appliedTerm && number === appliedNumber) return "duplicate";
    if (term < minimum) return "stale_term";
    if (this.mandate === null) return "no_mandate";
    if (term > this.mandate.term) return "unknown_term";
    if (command.id !== this.mandate.computing) return "wrong_issuer";
    if (term < appliedTerm || (term === appliedTerm && number < appliedNumber)) return "superseded";
    if (!this.valid()) return "no_mandate";
    if (this.nowNs > command.expiry_ns) return "expired";
    if (!MANOEUVRES.includes(manoeuvre)) return "unknown_manoeuvre";
    const share = (command.speed_mps ?? 0) / this.uav.speed_mps;
    const flyable = this.limits.min_speed_share <= share && share <= this.limits.max_speed_share;
    return manoeuvre === "speed" && !flyable ? "beyond_limits" : "";
  }

  /** Obey it or not; the answer says which, and why. */
  onCommand(command, atNs) {
    const { id: target, term, number } = command;
    const reason = this.refusal(command);
    const actuate_ns = reason ? 0 : Math.max(command.start_ns, atNs);
    if (!reason) {
      this.pending = { ...command, start_ns: actuate_ns };
      this.terms.splice(2, 2, term, number);
    }
    return ["ack", { target, term, number, accepted: !reason, reason, actuate_ns }];
  }

  /** Fly to the time that is asked for, acting on each message at its own; what to send. */
  step(asked) {
    const [told, before] = [[], String(this.terms)];
    for (const [atNs, kind, message] of asked.inbox) {
      this.flyTo(atNs);
      if (kind === "heartbeat") this.terms[0] = Math.max(this.terms[0], message.highest_term);
      else if (kind === "election") this.onElection(message, atNs);
      else if (kind === "cmd") told.push(this.onCommand(message, atNs));
    }
    this.flyTo(asked.t_ns);
    told.push(["truth", this.truth()]);
    if (asked.broadcast) told.push(["adsb", this.intent(asked.present)]);
    if (String(this.terms) !== before) {
      const kept = this.terms.map((value, n) => [REMEMBERED[n], value]);
      told.push(["persistent_state", Object.fromEntries(kept)]);
    }
    return told;
  }

  /** The true state, and what is flown. */
  truth() {
    const [guided, wanted, ahead] = [this.guidance(), this.wanted(), this.levelMps()];
    const active = this.active ?? NO_COMMAND;
    const velocity = [ahead * Math.cos(this.heading), ahead * Math.sin(this.heading), -this.climb];
    return {
      position_ned_m: this.place,
      velocity_ned_mps: velocity,
      speed_mps: this.speed,
      heading_rad: this.heading,
      flight_path_rad: Math.asin(this.climb / this.speed),
      mode: active.manoeuvre || (this.arrived() ? "arrived" : "plan"),
      waypoint_index: this.index,
      guidance_heading_rad: guided.heading, guidance_climb_mps: guided.climb,
      commanded_heading_rad: wanted.heading,
      commanded_climb_mps: wanted.climb,
      commanded_level_down_m: wanted.level,
      command_term: active.term, command_issuer: active.id, command_number: active.number,
      ...(active.manoeuvre === "speed" && { commanded_speed_mps: wanted.speed }),
    };
  }

  /** What a broadcast tells beside the true state: where to, and under which election. */
  intent(present) {
    const { heading, speed } = this.guidance();
    const [north, east] = this.place;
    const down = this.goals[this.goals.length - 1][2];
    const beyond = [north + 1000 * Math.cos(heading), east + 1000 * Math.sin(heading), down];
    const goals = [...this.goals.slice(this.index), beyond];
    const [goal, after] = [goals[0], goals[Math.min(1, goals.length - 1)]];
    const turn = wrapped(Math.atan2(after[1] - goal[1], after[0] - goal[0]) - heading);
    const group = this.valid() ? this.mandate.members : present;
    const deafNs = Math.round(this.scenario.coordination.silence_limit_s * 1e9);
    const reach = distance(this.place, goal) / Math.max(this.levelMps(), 1);
    return {
      waypoint_ned_m: goal,
      next_waypoint_ned_m: after,
      hears: present.some((n) => group.includes(n)) || this.nowNs <= deafNs,
      reach_s: this.arrived() ? 1e6 : reach,
      next_heading_rad: wrapped(heading + turn),
      next_turn_rad: this.arrived() ? 0 : turn,
      next_climb_mps: 0,
      highest_term: this.terms[0],
      mandate_term: this.terms[1],
      mandate_valid: this.valid(),
      ...(this.speed !== speed && { guidance_speed_mps: speed }),
    };
  }
}

let uav = null;
readline.createInterface({ input: process.stdin }).on("line", (line) => {
  let asked = null;
  try {
    asked = JSON.parse(line);
  } catch {} // no relay has asked that
  if (!asked || !(asked.plan || uav)) {
    console.error("usage: fleet relay NUMBER -- node uav.js");
    process.exit(2);
  }
  if (asked.plan) uav = new Uav(asked.plan);
  console.log(JSON.stringify(asked.tick === undefined ? [] : uav.step(asked)));
});
