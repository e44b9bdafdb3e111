"""Rules of joining, leaving and keeping step."""

from __future__ import annotations

from collections.abc import Iterator

from fleet.conformance import script
from fleet.conformance.evidence import Evidence
from fleet.conformance.rule import LOCKSTEP, NotTriedError, protocol_rule
from fleet.protocol.messages import Done

_CLOCKS = "clocks.md"


@protocol_rule(
    "is ready before anything else, and has sent nothing", f"{_CLOCKS}#the-lockstep-clock"
)
def _ready(e: Evidence) -> Iterator[str]:
    """The first word is Done of tick -1."""
    first = e.heard[0].message
    if not isinstance(first, Done) or first.tick != -1:
        yield f"the first message was {e.heard[0].sample.topic}, not `done` with tick -1"
    elif (first.seq, first.t_ns, first.sent, first.digests) != (0, 0, {}, {}):
        yield f"`done` of tick -1 had seq {first.seq}, t_ns {first.t_ns}, sent {first.sent}"


@protocol_rule(
    "declares its liveliness token before it is ready", f"{_CLOCKS}#liveliness-and-aborts"
)
def _token(e: Evidence) -> Iterator[str]:
    """The token is there."""
    if not e.alive_when_ready:
        yield f"no token {e.number}/alive when it was ready"


@protocol_rule("takes part to the end", f"{_CLOCKS}#the-lockstep-clock")
def _to_the_end(e: Evidence) -> Iterator[str]:
    """Nothing that is due fails to come."""
    if e.stalled:
        yield e.stalled


@protocol_rule("leaves when the run is over", f"{_CLOCKS}#the-lockstep-clock")
def _leaves(e: Evidence) -> Iterator[str]:
    """Its token goes."""
    if e.left is None or not e.alive_when_ready:
        raise NotTriedError("it had no token that could go")
    if not e.left:
        yield "its token was still there after `stop`"


@protocol_rule("waits for all that the manifest lists", f"{_CLOCKS}#the-lockstep-clock", LOCKSTEP)
def _waits(e: Evidence) -> Iterator[str]:
    """It is not done before that has come."""
    if e.hasty is None:
        raise NotTriedError("the play did not come so far")
    if e.hasty:
        tick = script.RESUMED.tick + 1
        yield f"it was done with tick {tick} before a message had come that its grant listed"


@protocol_rule(
    "uses nothing that no manifest lists", f"{_CLOCKS}#early-and-late-messages", LOCKSTEP
)
def _unlisted(e: Evidence) -> Iterator[str]:
    """Not answered, not reported."""
    said = e.labelled(script.UNLISTED.label)
    if not said:
        raise NotTriedError("the play did not come so far")
    message = said[0].message
    if (message.kind, message.id, message.seq) in e.rows:
        yield f"it reports {message.kind} {message.seq} of UAV {message.id}, which no grant listed"
    if e.acks(script.UNLISTED.message):
        yield "it answered a command that no grant listed"


@protocol_rule(
    "keeps what comes early until it is listed", f"{_CLOCKS}#early-and-late-messages", LOCKSTEP
)
def _early(e: Evidence) -> Iterator[str]:
    """Of two commands of which one is early, each is handled in its tick."""
    for cue in (script.EARLIER, script.EARLY):
        due = cue.tick + 1
        if e.stalled and e.last_tick == due - 1:
            yield f"it was not done with tick {due}, whose grant lists the command {cue.label}"
        elif e.last_tick < due:
            raise NotTriedError("the play did not come so far")
        for said in e.labelled(cue.label):
            name = said.message.kind, said.message.id, said.message.seq
            steps = [step_ns // script.TICK_NS for step_ns, _, _ in e.rows.get(name, [])]
            if steps != [due]:
                yield f"the command {cue.label} was handled in ticks {steps}, not in {due}"


@protocol_rule(
    "says to be done after all that it sends in a tick",
    f"{_CLOCKS}#the-lockstep-clock",
    LOCKSTEP,
)
def _done_last(e: Evidence) -> Iterator[str]:
    """Nothing of a tick comes after its `done`."""
    done_ns = -1
    for h in e.heard:
        if isinstance(h.message, Done):
            done_ns = h.message.t_ns if h.message.tick >= 0 else -1
        elif h.message is not None and h.message.t_ns <= done_ns:
            yield f"{h.sample.topic} of {h.message.t_ns / 1e9:g} s came after `done` of that tick"


@protocol_rule("steps on no grant but the next", f"{_CLOCKS}#the-lockstep-clock", LOCKSTEP)
def _forged(e: Evidence) -> Iterator[str]:
    """A grant of a later tick is not the simulation's."""
    if e.last_tick < script.FORGED - 1:
        raise NotTriedError("the play did not come so far")
    far = script.FORGED + 50
    if any(h.tick < far and isinstance(h.message, Done) and h.message.tick == far for h in e.heard):
        yield f"it stepped to tick {far} when tick {script.FORGED} was the next"


@protocol_rule("does not step while it is held", f"{_CLOCKS}#processes-that-come-and-go", LOCKSTEP)
def _held(e: Evidence) -> Iterator[str]:
    """It says nothing then."""
    if e.last_tick < script.HELD[-1]:
        raise NotTriedError("the play did not come so far")
    for h in e.heard:
        if h.tick in script.HELD:
            yield f"{h.sample.topic} came in tick {h.tick}, in which it was held"
