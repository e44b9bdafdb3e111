"""Rules of the realtime clock."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from fleet.conformance import realtime_script as script
from fleet.conformance.evidence import Evidence, HeardMessage, MessageName
from fleet.conformance.realtime_play import AHEAD
from fleet.conformance.rule import REALTIME, Judge, NotTriedError, protocol_rule
from fleet.faults.channel import Channel, Fate
from fleet.faults.draws import LinkMessage
from fleet.protocol.messages import Done, Late, Truth
from fleet.protocol.phases import phase_ns

_REALTIME_CLOCK = "clocks.md#the-realtime-clock"
_EARLY_NS = 2_000_000
"""The clocks of two processes may differ by so much, to be granted."""
_LATE_TICKS = 1.5
"""Who steps later than this has to tell; the phase is in it, and time for the step itself."""
_SLACK_NS = 450_000_000
"""So much later than due something may be delivered on a busy machine."""
_MARKED_NS = 1_000_000_000
"""A mark of publication is at most so far from arrival."""


@protocol_rule("steps at each tick of the wall clock", _REALTIME_CLOCK, REALTIME)
def _timely(e: Evidence) -> Iterator[str]:
    """Not before its time."""
    told = {h.message.t_ns: h for h in e.heard if isinstance(h.message, Truth)}
    if not e.epoch_unix_ns:
        raise NotTriedError("the play did not come so far")
    missing = [n for n in range(e.scenario.ticks + 1) if n * e.scenario.tick_ns not in told]
    if missing and not any(e.of(Late)):
        yield f"no true state of tick {missing[0]}" + (
            f" and {len(missing) - 1} more" if missing[1:] else ""
        )
    for t_ns, h in told.items():
        ahead_ns = e.epoch_unix_ns + t_ns + phase_ns(e.number, e.scenario.tick_ns) - _put_ns(h)
        if ahead_ns > _EARLY_NS:
            yield f"the step of {t_ns / 1e9:g} s was {ahead_ns / 1e6:.0f} ms before its time"


@protocol_rule("tells when a step begins late", _REALTIME_CLOCK, REALTIME)
def _tells_late(e: Evidence) -> Iterator[str]:
    """By `late`."""
    if not e.epoch_unix_ns:
        raise NotTriedError("the play did not come so far")
    told = {late.t_ns for late in e.of(Late)}
    for h in e.heard:
        if isinstance(h.message, Truth):
            behind_ns = _put_ns(h) - e.epoch_unix_ns - h.message.t_ns
            if behind_ns > _LATE_TICKS * e.scenario.tick_ns and h.message.t_ns not in told:
                t_s, late_ms = h.message.t_ns / 1e9, behind_ns / 1e6
                yield f"the step of {t_s:g} s came {late_ms:.0f} ms late, untold"


@protocol_rule(
    "marks what it sends with the time of publication", "wire-format.md#deliveryreport", REALTIME
)
def _marked(e: Evidence) -> Iterator[str]:
    """Unix time in the attachment."""
    for h in e.heard:
        apart_ns = abs(h.sample.arrived_unix_ns - h.sample.put_unix_ns)
        if not h.sample.put_unix_ns:
            yield f"{h.sample.topic} in tick {h.tick} has no time of publication"
        elif apart_ns > _MARKED_NS:
            yield f"{h.sample.topic} in tick {h.tick} is marked {apart_ns / 1e9:.1f} s off"


@protocol_rule("lets no time go back", "clocks.md#who-may-speak", REALTIME)
def _no_time_back(e: Evidence) -> Iterator[str]:
    """In each class."""
    last: defaultdict[str, int] = defaultdict(int)
    for h in e.heard:
        if h.message is not None:
            if h.message.t_ns < last[h.message.kind]:
                yield f"{h.message.kind} {h.message.seq} has t_ns {h.message.t_ns}, before the last"
            last[h.message.kind] = h.message.t_ns


@protocol_rule("is done once, after the last tick", _REALTIME_CLOCK, REALTIME)
def _done_once(e: Evidence) -> Iterator[str]:
    """Not between ticks."""
    told = [done.tick for done in e.of(Done) if done.tick >= 0]
    if not e.epoch_unix_ns:
        raise NotTriedError("the play did not come so far")
    if told != [e.scenario.ticks]:
        yield f"done of ticks {told[:5]}, where {e.scenario.ticks} is the last"


@protocol_rule("delivers on arrival, or so much later as the plan says", _REALTIME_CLOCK, REALTIME)
def _delivers(e: Evidence) -> Iterator[str]:
    """By its own clock, since the epoch."""
    told = e.rows
    for name, sent_ns, fate in _fates(e):
        due = sorted(sent_ns + d.delay_ns for d in fate.deliveries)
        came = sorted(at_ns for _, at_ns, _ in told.get(name, []) if at_ns)
        if len(due) == len(came):
            for due_ns, at_ns in zip(due, came, strict=True):
                if not -_EARLY_NS <= at_ns - due_ns <= _SLACK_NS:
                    (kind, src, seq), off_ms = name, (at_ns - due_ns) / 1e6
                    yield f"{kind} {seq} of {src}: delivered {off_ms:.0f} ms after it was due"


@protocol_rule(
    "applies the fault plan, also when it changes",
    "faults.md#from-a-message-to-its-deliveries",
    REALTIME,
)
def _applies(e: Evidence) -> Iterator[str]:
    """Loses what is to be lost, and nothing else."""
    told = e.rows
    for name, _, fate in _fates(e):
        fates = [fate_told for _, _, fate_told in told.get(name, [])]
        due = [fate.dropped_by] if fate.dropped_by else ["received"] * len(fate.deliveries)
        if fates != due:
            yield f"{name[0]} {name[2]} of {name[1]}: it reports {fates}, due is {due}"


@protocol_rule("uses no number twice", "clocks.md#early-and-late-messages", REALTIME)
def _number_twice(e: Evidence) -> Iterator[str]:
    """Of a topic, what is not above the last number is old."""
    said = e.labelled("repeated")
    if not said or e.stalled:
        raise NotTriedError("the play did not come so far")
    answers = len(e.acks(script.REALTIME_OBEYED.message))
    if answers != 2:
        yield f"{answers} answers to a command that came twice, and once more under its old number"


@protocol_rule("uses nothing that is from the future", "clocks.md#who-may-speak", REALTIME)
def _future(e: Evidence) -> Iterator[str]:
    """By more than 5 s."""
    if e.stalled:
        raise NotTriedError("the play did not come so far")
    for said in e.labelled(AHEAD):
        name = said.message.kind, said.message.id, said.message.seq
        if name in e.rows:
            yield f"it reports {name[0]} {name[2]} of {name[1]}, which was from the future"


@protocol_rule("uses nothing of strangers, and no garbage", "clocks.md#who-may-speak", REALTIME)
def _nothing_strange(e: Evidence) -> Iterator[str]:
    """What it does not report it does not use."""
    if e.stalled:
        raise NotTriedError("the play did not come so far")
    sent = {(s.message.kind, s.message.id, s.message.seq) for s in e.said}
    for kind, src, seq in sorted(e.rows.keys() - sent):
        yield f"it reports {kind} {seq} of {src}, which nobody had to use"


def _answers(label: str, reason: str) -> Judge:
    def judge(e: Evidence) -> Iterator[str]:
        cue = next(cue for cue in script.REALTIME_COMMANDS if cue.label == label)
        if not e.labelled(label) or e.stalled:
            raise NotTriedError("the play did not come so far")
        reasons = [ack.reason for ack in e.acks(cue.message)]
        if reason not in reasons:
            yield f"the command {label} was answered {reasons}, where it is {reason or 'obeyed'}"

    return judge


for _cue in script.REALTIME_COMMANDS:
    protocol_rule(
        f"refuses what is `{_cue.reason}`" if _cue.reason else "obeys a command of its mandate",
        "elections-and-commands.md#refusals",
        REALTIME,
    )(_answers(_cue.label, _cue.reason))


def _put_ns(h: HeardMessage) -> int:
    """Unix time of publication, as it is marked; that of arrival, if it is not."""
    return h.sample.put_unix_ns or h.sample.arrived_unix_ns


def _fates(e: Evidence) -> Iterator[tuple[MessageName, int, Fate]]:
    """What was said to it and has to be reported by the end: when it was sent, and its fate."""
    if not e.epoch_unix_ns or e.stalled:
        raise NotTriedError("the play did not come so far")
    channel, ticks = Channel(e.plan, e.scenario.seed, e.scenario.tick_ns), e.scenario.ticks
    last_ns = ticks * e.scenario.tick_ns - _SLACK_NS
    for said in e.said:
        m = said.message
        link = LinkMessage(m.id, e.number, m.kind, m.seq, m.t_ns, 8 * len(said.payload))
        if (
            said.listed
            and m.is_for(e.number)
            and said.sent_unix_ns - e.epoch_unix_ns < last_ns - _SLACK_NS
        ):
            fate = channel.fate(link)
            since_ns = said.sent_unix_ns - e.epoch_unix_ns - phase_ns(m.id, e.scenario.tick_ns)
            yield (m.kind, m.id, m.seq), max(0, since_ns), fate
