"""The messages, one frozen class each; docs/protocol is checked against them.

A class declares who hears it, and if participants do, its rank in the delivery order; everything
else that depends on the class is derived from that (docs/extending/message.md).

Every message has `id` (the issuer: a UAV's number, 0 for the coordinator), `seq` (counts that
issuer's messages of that class; of `done` it is the tick) and `t_ns` (simulated time of sending).
SI units, NED, radians, heading clockwise from north, climb positive up. Speeds that are None are
left out of the payload. (gc=False: messages hold no cycles, and the collector need not look at
them.)
"""

from __future__ import annotations

from collections.abc import Sized
from itertools import pairwise
from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from fleet.model.types import COORDINATOR
from fleet.protocol.advisories import LoggedAdvisory
from fleet.protocol.audience import Audience, Issuers
from fleet.protocol.bounds import (
    Airspeed,
    Angle,
    Coordinate,
    Count,
    DifferenceNs,
    HeardTerm,
    Name,
    NedVector,
    Seconds,
    Speed,
    TickNumber,
    TimeNs,
)


class Message(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """What every message begins with."""

    id: Count
    seq: Count
    t_ns: TimeNs

    kind: ClassVar[str] = ""
    cell: ClassVar[str] = ""
    """What a broadcast is keyed by where there is one cell for all, if it is."""
    by_cell: ClassVar[bool] = True
    """Whether UAVs tell it to the cell that they are in, if all hear it and the run has cells."""
    audience: ClassVar[Audience] = Audience.RECORDER
    issuers: ClassVar[Issuers] = Issuers.ANY
    rank: ClassVar[int] = 0
    """Place in the delivery order, if participants hear it."""

    @property
    def suffix(self) -> str:
        """The topic without its issuer."""
        return f"{self.kind}/{self.cell}" if self.cell else self.kind

    def is_for(self, number: int) -> bool:
        """Whether a participant hears it; a broadcast does not return to its issuer."""
        if number == COORDINATOR and self.audience is not Audience.ALL:
            return False
        return self.audience is not Audience.RECORDER and number != self.id


class AddressedMessage(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """What goes to one participant alone."""

    target: Count

    audience: ClassVar[Audience] = Audience.TARGET

    @property
    def suffix(self) -> str:
        """Keyed by the target."""
        return f"{self.kind}/{self.target}"

    def is_for(self, number: int) -> bool:
        """Whether a participant is its target."""
        return number == self.target


class StateBroadcast(
    Message, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False
):
    """The broadcast: state and intent of one UAV, heard by all.

    `applies_ns` is the time of the state by the UAV's own clock. `highest_term` is that of all
    elections seen, `mandate_term` that of those which name this UAV, valid still or not. `hears`
    says whether it hears the UAVs that it would lead, and they it, `equipment` what it can do at
    all. Speeds are told where they are not that of the plan: the one that guidance regains, and
    that of a manoeuvre.
    """

    applies_ns: TimeNs
    position_ned_m: NedVector
    velocity_ned_mps: tuple[Speed, Speed, Speed]
    speed_mps: Airspeed
    heading_rad: Angle
    flight_path_rad: Angle
    waypoint_ned_m: NedVector
    next_waypoint_ned_m: NedVector
    arrived: bool
    guidance_heading_rad: Angle
    guidance_climb_mps: Speed
    reach_s: Seconds
    next_heading_rad: Angle
    next_turn_rad: Angle
    next_climb_mps: Speed
    manoeuvre: Name
    commanded_heading_rad: Angle
    commanded_climb_mps: Speed
    commanded_level_down_m: Coordinate
    command_term: Count
    command_issuer: Count
    command_number: Count
    highest_term: HeardTerm
    mandate_term: HeardTerm
    mandate_valid: bool
    hears: bool
    equipment: Name
    guidance_speed_mps: Airspeed | None = None
    commanded_speed_mps: Airspeed | None = None

    kind: ClassVar[str] = "adsb"
    issuers: ClassVar[Issuers] = Issuers.UAVS
    cell: ClassVar[str] = "0"
    audience: ClassVar[Audience] = Audience.ALL
    rank: ClassVar[int] = 10

    def __post_init__(self) -> None:
        """Only UAVs broadcast."""
        if self.id == COORDINATOR:
            raise ValueError("a broadcast needs the ID of a UAV, at least 1")


class Heartbeat(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """The coordinator is there. A UAV that hears none for too long takes part in local election."""

    highest_term: HeardTerm

    kind: ClassVar[str] = "heartbeat"
    issuers: ClassVar[Issuers] = Issuers.COORDINATOR
    by_cell: ClassVar[bool] = False
    audience: ClassVar[Audience] = Audience.UAVS
    rank: ClassVar[int] = 20


class Election(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """Who computes for a conflict group; repeated while the group lasts, each time valid longer.

    The issuer is the elector: the coordinator, or without one the computing UAV itself. Members
    rise, so that nobody is named twice: a round does its work for each of them.
    """

    term: HeardTerm
    group: Count
    members: Annotated[tuple[Count, ...], Meta(max_length=4096)]
    computing: Count
    valid_until_ns: TimeNs

    kind: ClassVar[str] = "election"
    audience: ClassVar[Audience] = Audience.UAVS
    rank: ClassVar[int] = 30
    """Before the commands that are given in its term."""

    def __post_init__(self) -> None:
        """Every member once, rising."""
        if any(later <= member for member, later in pairwise(self.members)):
            raise ValueError("members do not rise")


class Command(
    AddressedMessage, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False
):
    """A manoeuvre for one UAV, identified by (term, id, number); a repetition changes seq and t_ns.

    `manoeuvre` is turn, climb, turn_climb, speed or resume. A turn flies `heading_rad`, guidance's
    heading changed by `turn_rad` (tc); a climb flies `climb_mps` (cc) and levels off at
    `level_down_m`; `speed` flies the plan at `speed_mps`.
    """

    term: Count
    number: Count
    issued_ns: TimeNs
    manoeuvre: Name
    heading_rad: Angle
    turn_rad: Angle
    climb_mps: Speed
    level_down_m: Coordinate
    start_ns: TimeNs
    manoeuvre_end_ns: TimeNs
    expiry_ns: TimeNs
    speed_mps: Airspeed | None = None

    kind: ClassVar[str] = "cmd"
    issuers: ClassVar[Issuers] = Issuers.UAVS
    rank: ClassVar[int] = 40


class Ack(AddressedMessage, frozen=True, forbid_unknown_fields=True, gc=False):
    """The answer to a command: accepted, and when it is flown, or why not."""

    term: Count
    number: Count
    issued_ns: TimeNs
    accepted: bool
    reason: Name
    actuate_ns: TimeNs

    kind: ClassVar[str] = "ack"
    issuers: ClassVar[Issuers] = Issuers.UAVS
    rank: ClassVar[int] = 50


class Truth(Message, frozen=True, forbid_unknown_fields=True, omit_defaults=True, gc=False):
    """The true state of a UAV, for the recorder alone; the speed of a manoeuvre, if it has one."""

    position_ned_m: NedVector
    velocity_ned_mps: tuple[Speed, Speed, Speed]
    speed_mps: Airspeed
    heading_rad: Angle
    flight_path_rad: Angle
    mode: Name
    waypoint_index: Count
    guidance_heading_rad: Angle
    guidance_climb_mps: Speed
    commanded_heading_rad: Angle
    commanded_climb_mps: Speed
    commanded_level_down_m: Coordinate
    command_term: Count
    command_issuer: Count
    command_number: Count
    commanded_speed_mps: Airspeed | None = None

    kind: ClassVar[str] = "truth"
    issuers: ClassVar[Issuers] = Issuers.UAVS


class PersistentState(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """What outlives a process that is killed; for the recorder, whenever it changes.

    Highest term seen or used; term of the highest election that named this UAV; and the last
    command applied.
    """

    highest_term: HeardTerm
    mandate_term: HeardTerm
    applied_term: Count
    applied_number: Count

    kind: ClassVar[str] = "persistent_state"


class Decision(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """What the computing UAV decided in one round, when it decided anything new."""

    term: Count
    encounters: Annotated[tuple[LoggedAdvisory, ...], Meta(max_length=4096)]

    kind: ClassVar[str] = "decision"
    issuers: ClassVar[Issuers] = Issuers.UAVS


class Conflict(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """The coordinator's picture: pairs at risk and the time to their violation, when it changes.

    `leaderless` are the members of groups that nobody can lead.
    """

    pairs: tuple[tuple[Count, Count], ...]
    time_to_violation_s: tuple[Seconds, ...]
    leaderless: tuple[Count, ...]

    kind: ClassVar[str] = "conflict"
    issuers: ClassVar[Issuers] = Issuers.COORDINATOR

    def __post_init__(self) -> None:
        """One time for each pair."""
        if len(self.pairs) != len(self.time_to_violation_s):
            raise ValueError("pairs and times differ in number")


class DeliveryReport(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """What came to one process in a step: columns, one entry a message.

    `fates`: received, altered (received, with bits flipped), implausible (received, not believed),
    or the fault that kept it away, with `delivered_ns` 0. Measured in realtime, empty in lockstep:
    `transit_ns`, what zenoh took by the two clocks as they are (below 0 where the sender's is ahead
    by more; 0: not measured); `delay_ns`, the delay that faults intended; `slip_ns`, how much later
    than intended it was delivered.
    """

    src: tuple[Count, ...]
    kinds: tuple[Name, ...]
    seqs: tuple[Count, ...]
    sent_ns: tuple[TimeNs, ...]
    delivered_ns: tuple[TimeNs, ...]
    fates: tuple[Name, ...]
    transit_ns: tuple[DifferenceNs, ...] = ()
    delay_ns: tuple[TimeNs, ...] = ()
    slip_ns: tuple[TimeNs, ...] = ()

    kind: ClassVar[str] = "delivery"

    def __post_init__(self) -> None:
        """One entry a message in every column."""
        columns: tuple[Sized, ...] = (self.src, self.kinds, self.seqs, self.sent_ns)
        columns += (self.delivered_ns, self.fates)
        measured = (self.transit_ns, self.delay_ns, self.slip_ns)
        if any(measured):
            columns += measured
        if len({len(c) for c in columns}) > 1:
            raise ValueError("columns differ in length")


class Late(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """Realtime only: a step began this long after its time."""

    late_ns: TimeNs

    kind: ClassVar[str] = "late"


class Done(Message, frozen=True, forbid_unknown_fields=True, gc=False):
    """A step is over (realtime: the last one): what was sent, by topic without issuer.

    `digests` are BLAKE2b, of 8 bytes, over the payloads of each topic in order of sending: so that
    nobody else's message can be taken for one of this issuer.
    """

    tick: TickNumber
    sent: dict[str, Count]
    digests: dict[str, Name]

    kind: ClassVar[str] = "done"


class Clock(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """The simulation grants a tick; `expected` lists what the tick before sent to each topic.

    By topic without issuer, each message by its issuer and its sequence number.
    `state` is epoch (realtime: the run begins then), run, plan (realtime: the fault plan changes)
    or stop; `epoch_unix_ns` is 0 in lockstep. `held` names paused processes, which take what is
    sent but do not step, `down` those that have been killed. `plan` is the whole fault plan from
    this tick on, as JSON, when it has been changed while the run is on; else empty.
    """

    tick: TickNumber
    t_ns: TimeNs
    state: Name
    expected: dict[str, tuple[tuple[Count, Count], ...]]
    epoch_unix_ns: TimeNs = 0
    held: tuple[Count, ...] = ()
    down: tuple[Count, ...] = ()
    plan: str = ""

    kind: ClassVar[str] = "clock"


class Digest(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """The simulation closes a lockstep tick: the digest of everything up to it. In the log only."""

    tick: TickNumber
    t_ns: TimeNs
    digest: Name

    kind: ClassVar[str] = "digest"


class Rejected(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """What the simulation refused to take for a message of the run, and why. In the log only.

    `count` of them came on this topic since the last such record.
    """

    t_ns: TimeNs
    topic: Annotated[str, Meta(max_length=200)]
    why: Name
    count: Count

    kind: ClassVar[str] = "rejected"


class RoundTime(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """How long a round of the resolver took a UAV, as it measured it. In the log only."""

    t_ns: TimeNs
    id: Count
    took_ns: TimeNs

    kind: ClassVar[str] = "round_time"


class Outage(Struct, frozen=True, forbid_unknown_fields=True, gc=False):
    """Realtime: nothing came of a participant from `since_ns` to `t_ns`. In the log only.

    `end` is how that ended: back (it was heard again), restarted (another process came in its
    place, as its next incarnation), or lost (not before the run did).
    """

    t_ns: TimeNs
    id: Count
    since_ns: TimeNs
    end: Name

    kind: ClassVar[str] = "outage"


Logged = Message | Clock | Digest | Rejected | RoundTime | Outage
"""What a log has: messages, and what the simulation adds."""
