"""The operator's requests: changes of the fault plan while a run is on (`fleet fault`)."""

from __future__ import annotations

import queue
from collections.abc import Callable, Sequence

import msgspec

from fleet.config.checks import problem_with
from fleet.config.idle_rules import idle_rules
from fleet.config.scenario import Scenario
from fleet.errors import BusError
from fleet.faults import registry
from fleet.faults.lifecycle import ProcessRule
from fleet.faults.rules import Rule
from fleet.model.units import to_s
from fleet.protocol.topics import FAULT
from fleet.transport.zenoh_bus import Bus

LONGEST_BYTES = 1 << 20
"""A longer request is refused unread."""
MOST_REQUESTS = 64
"""So many requests wait for the next tick; others are answered at once that there is no room."""


class FaultRequest(msgspec.Struct, frozen=True):
    """Rules to add, after ending all others if `clear`, or those with these numbers in the plan.

    Times without a window begin at once.
    """

    rules: tuple[registry.FaultRule, ...] = ()
    clear: bool = False
    end: tuple[int, ...] = ()


class FaultAnswer(msgspec.Struct, frozen=True):
    """When it takes effect and what the plan is then, or what is wrong with the request.

    `idle` names rules of that plan which do nothing, with the reason. `first` is the number of the
    first rule of the request in the plan, as `problem` and `idle` name it.
    """

    tick: int = 0
    t_s: float = 0.0
    plan: tuple[registry.FaultRule, ...] = ()
    problem: str = ""
    idle: tuple[str, ...] = ()
    first: int = 0


class FaultControl:
    """Takes requests on a thread of the bus, and answers them at the next tick."""

    def __init__(
        self, scenario: Scenario, *, processes: bool = True, realtime: bool = False
    ) -> None:
        """`processes`: whether the simulation can kill and stop processes."""
        self._scenario = scenario
        self._realtime = realtime
        self._processes = processes
        self.lacked_room = 0
        self._waiting: queue.SimpleQueue[tuple[bytes, Callable[[bytes], None]]] = (
            queue.SimpleQueue()
        )

    def listen(self, bus: Bus) -> None:
        """Take requests from now on."""
        bus.answer(FAULT, self._take)

    def _take(self, payload: bytes, reply: Callable[[bytes], None]) -> None:
        """Let a request wait, if there is room."""
        if self._waiting.qsize() < MOST_REQUESTS:
            self._waiting.put((payload, reply))
            return
        self.lacked_room += 1
        reply(msgspec.json.encode(FaultAnswer(problem=f"{MOST_REQUESTS} requests wait; ask again")))

    def new_plan(self, plan: tuple[Rule, ...], tick: int) -> tuple[Rule, ...] | None:
        """The plan from this tick on, given the one so far; None if nobody asked for a change."""
        changed = None
        while not self._waiting.empty():
            payload, reply = self._waiting.get()
            now_ns, first = tick * self._scenario.tick_ns, len(changed or plan)
            try:
                request = request_of(payload)
                wanted = amended(changed or plan, request, now_ns)
                scenario = msgspec.structs.replace(self._scenario, fault=wanted)
                problem = problem_with(scenario) or self._beyond_reach(request)
            except ValueError as error:
                problem = str(error)
            if problem:
                reply(msgspec.json.encode(FaultAnswer(problem=problem, first=first)))
                continue
            changed = wanted
            before = self._idle(msgspec.structs.replace(scenario, fault=plan))
            idle = tuple(why for why in self._idle(scenario) if why not in before)
            reply(
                msgspec.json.encode(
                    FaultAnswer(tick, to_s(now_ns), changed, idle=idle, first=first)
                )
            )
        return changed

    def _idle(self, scenario: Scenario) -> list[str]:
        return idle_rules(scenario, realtime=self._realtime)

    def _beyond_reach(self, request: FaultRequest) -> str:
        if self._processes or not any(isinstance(r, ProcessRule) for r in request.rules):
            return ""
        return "its simulation has not started the processes, and cannot kill or stop them"


def request_of(payload: bytes) -> FaultRequest:
    """The request of a payload that anybody can have sent; raises ValueError."""
    if len(payload) > LONGEST_BYTES:
        raise ValueError(f"a request of {len(payload)} bytes; at most {LONGEST_BYTES} are taken")
    try:
        return msgspec.json.decode(payload, type=FaultRequest)
    except RecursionError as error:
        raise ValueError("a request nested too deeply") from error


def answer_of(reply: bytes) -> FaultAnswer:
    """The answer in a reply, which anybody on the bus can have given; raises BusError."""
    try:
        return msgspec.json.decode(reply, type=FaultAnswer)
    except (ValueError, RecursionError) as error:
        raise BusError(f"what the run answers is no answer to a request: {error}") from error


def amended(plan: Sequence[Rule], request: FaultRequest, now_ns: int) -> tuple[Rule, ...]:
    """The plan with a request carried out at `now_ns`.

    Rules are only added or ended earlier, so that the whole plan, run from the start, repeats what
    the changes did.

    Raises:
        ValueError: a rule that is to end is not there.

    """
    strange = sorted(set(request.end) - set(range(len(plan))))
    if strange:
        there = f"its rules are 0 to {len(plan) - 1}" if plan else "it has none"
        raise ValueError(f"no rule {', '.join(map(str, strange))} in the fault plan; {there}")
    now_s = to_s(now_ns)
    kept = [
        rule.ended(now_ns) if request.clear or n in request.end else rule
        for n, rule in enumerate(plan)
    ]
    added = []
    for rule in request.rules:
        late_s = max(0.0, now_s - rule.start_s)
        end_s = None if rule.end_s is None else rule.end_s + late_s
        added.append(
            msgspec.structs.replace(rule, start_s=rule.start_s + late_s, end_s=end_s)
            if late_s
            else rule
        )
    return (*kept, *added)
