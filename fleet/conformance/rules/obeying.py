"""Rules of commands: which are obeyed, how each is answered, and what is flown."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from fleet.agents.obedience import REFUSAL_REASONS
from fleet.conformance import script
from fleet.conformance.evidence import Evidence
from fleet.conformance.rule import LOCKSTEP, Judge, NotTriedError, protocol_rule
from fleet.conformance.script import TICK_NS, CommandCue
from fleet.protocol.messages import Ack, Command, Truth

_COMMANDS = "elections-and-commands.md#commands"
_REFUSALS = "elections-and-commands.md#refusals"


@protocol_rule("answers every command once", _REFUSALS, LOCKSTEP)
def _once(e: Evidence) -> Iterator[str]:
    """And nothing else."""
    if not any(_commands(e)):
        raise NotTriedError("the play did not come so far")
    said = [(c.term, c.number, c.id) for c in _commands(e)]
    answers = [(a.term, a.number, a.target) for a in e.of(Ack)]
    for name in dict.fromkeys([*said, *answers]):
        if said.count(name) != answers.count(name):
            term, number, issuer = name
            yield (
                f"{answers.count(name)} answers to command {number} of term {term} by UAV "
                f"{issuer}, which came {said.count(name)} times"
            )


@protocol_rule("obeys a command of its mandate", _REFUSALS, LOCKSTEP)
def _obeys(e: Evidence) -> Iterator[str]:
    """All that nothing is wrong with, and tells from when."""
    for cue in _reached(e, [c for c in script.LOCKSTEP_COMMANDS if _obeyed(c)]):
        ack = _first(e, cue)
        if ack is None or not ack.accepted:
            yield f"the command {cue.label} was {_answer(ack)}, where it is to be obeyed"


@protocol_rule("tells when a command begins to be flown", "wire-format.md#ack", LOCKSTEP)
def _actuation(e: Evidence) -> Iterator[str]:
    """`actuate_ns`: at `start_ns`, or on delivery; 0 if it is refused."""
    for cue in _reached(e, script.LOCKSTEP_COMMANDS):
        for ack in e.acks(cue.message):
            starts_ns = max(cue.message.start_ns, ack.t_ns) if ack.accepted else 0
            if ack.actuate_ns != starts_ns:
                yield f"actuate_ns of the command {cue.label} is {ack.actuate_ns}, not {starts_ns}"
            if ack.issued_ns != cue.message.issued_ns or ack.accepted == bool(ack.reason):
                yield f"the answer to the command {cue.label} does not go with it"


def _refuses(reason: str) -> Judge:
    def judge(e: Evidence) -> Iterator[str]:
        for cue in _reached(e, [c for c in script.LOCKSTEP_COMMANDS if c.reason == reason]):
            acks = e.acks(cue.message)
            ack = acks[-1] if acks else None
            if cue is script.REPEATED and len(acks) < 2:
                ack = None
            if ack is None or ack.accepted or ack.reason != reason:
                yield f"the command {cue.label} was {_answer(ack)}, where it is {reason}"

    return judge


for _reason in REFUSAL_REASONS:
    if _reason != "wrong_target":  # such a command comes on the topic of another
        protocol_rule(f"refuses what is `{_reason}`", _REFUSALS, LOCKSTEP)(_refuses(_reason))


@protocol_rule(
    "handles an election before the commands of its tick",
    "faults.md#from-a-message-to-its-deliveries",
    LOCKSTEP,
)
def _in_order(e: Evidence) -> Iterator[str]:
    """By issuer, and then by class, whatever comes first."""
    for cue in _reached(e, [script.AFTER_ELECTION, script.AFTER_LOCAL]):
        ack = _first(e, cue)
        if ack is None or not ack.accepted:
            yield f"the command {cue.label} was {_answer(ack)}"


@protocol_rule("flies what it has accepted, from then on", "foreign.md#how-it-may-fly", LOCKSTEP)
def _flies(e: Evidence) -> Iterator[str]:
    """As its true states tell."""
    command, start = script.OBEYED.message, script.OBEYED.message.start_ns // TICK_NS
    before, during = _truth(e, start - 1), _truth(e, start + 3)
    if before.command_number == command.number:
        yield f"it flew command {command.number} before its start"
    if _in_force(during) != (command.term, command.id, command.number):
        at_s, number = during.t_ns / 1e9, during.command_number
        yield f"at {at_s:g} s command {number} is in force, where {command.number} is to be"
    elif during.mode != command.manoeuvre:
        yield f"mode is {during.mode} while it flies a {command.manoeuvre}"
    elif abs(during.commanded_heading_rad - command.heading_rad) > 1e-9:
        yield f"it aims at {during.commanded_heading_rad:g} rad, not {command.heading_rad:g}"
    elif during.heading_rad == before.heading_rad:
        yield "it does not turn"


@protocol_rule("flies nothing that it has refused", "foreign.md#how-it-may-fly", LOCKSTEP)
def _not_refused(e: Evidence) -> Iterator[str]:
    """No command is in force that was not accepted."""
    if all(ack.accepted for ack in e.of(Ack)):
        raise NotTriedError("it has refused nothing")
    accepted = {(a.term, a.target, a.number) for a in e.of(Ack) if a.accepted}
    strange = {_in_force(t) for t in e.of(Truth)} - accepted - {(0, 0, 0)}
    for term, issuer, number in sorted(strange):
        yield f"command {number} of term {term} by UAV {issuer} is in force, and was not accepted"


@protocol_rule("returns to its plan on `resume`", _COMMANDS, LOCKSTEP)
def _resumes(e: Evidence) -> Iterator[str]:
    """From its start on."""
    yield from _on_plan(_truth(e, script.RESUMED.message.start_ns // TICK_NS + 1))


@protocol_rule("returns to its plan when a manoeuvre lapses", _COMMANDS, LOCKSTEP)
def _lapses(e: Evidence) -> Iterator[str]:
    """At `manoeuvre_end_ns`."""
    end = script.LAPSING.message.manoeuvre_end_ns // TICK_NS
    if _truth(e, end - 2).mode != script.LAPSING.message.manoeuvre:
        yield f"it did not fly the command {script.LAPSING.label}"
    yield from _on_plan(_truth(e, end + 1))


@protocol_rule("flies a commanded speed", _COMMANDS, LOCKSTEP)
def _speeds(e: Evidence) -> Iterator[str]:
    """And tells it."""
    wanted = script.FASTER.message.speed_mps
    truth = _truth(e, script.FASTER.message.start_ns // TICK_NS + 15)
    if truth.commanded_speed_mps != wanted:
        yield f"commanded_speed_mps is {truth.commanded_speed_mps}, not {wanted}"
    elif truth.speed_mps <= e.scenario.uav[1].speed_mps:
        yield f"it flies {truth.speed_mps:g} m/s where it is to accelerate to {wanted}"


def _obeyed(cue: CommandCue) -> bool:
    return not cue.reason and cue.how is not script.How.UNLISTED


def _commands(e: Evidence) -> Iterator[Command]:
    """Commands that it has taken in by the end of the play."""
    last_ns = e.last_tick * TICK_NS
    for said in e.said:
        if isinstance(said.message, Command) and said.listed and said.message.t_ns < last_ns:
            yield said.message


def _reached(e: Evidence, cues: Iterable[CommandCue]) -> list[CommandCue]:
    """Those whose answers are there; raises NotTriedError if there are none."""
    reached = [cue for cue in cues if cue.tick < e.last_tick]
    if not reached:
        raise NotTriedError("the play did not come so far")
    return reached


def _first(e: Evidence, cue: CommandCue) -> Ack | None:
    return next(iter(e.acks(cue.message)), None)


def _answer(ack: Ack | None) -> str:
    if ack is None:
        return "not answered"
    return "obeyed" if ack.accepted else f"refused as {ack.reason}"


def _truth(e: Evidence, tick: int) -> Truth:
    truth = e.truth(tick)
    if truth is None:
        raise NotTriedError("the play did not come so far")
    return truth


def _in_force(truth: Truth) -> tuple[int, int, int]:
    return truth.command_term, truth.command_issuer, truth.command_number


def _on_plan(truth: Truth) -> Iterator[str]:
    if truth.mode not in ("plan", "arrived") or _in_force(truth) != (0, 0, 0):
        yield f"at {truth.t_ns / 1e9:g} s it flies {truth.mode} by command {truth.command_number}"
