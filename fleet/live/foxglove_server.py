"""A run or a log in Foxglove and Lichtblick while it flies: the scene of exports, as it is.

The topics are those of `fleet export --foxglove`. Faults and pace are parameters of the viewer:
told to each, and changed by viewers only where that is asked for, since the protocol's server knows
no token and takes any site that is open in a browser on this machine for a viewer.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from fleet.config.scenario import Scenario
from fleet.errors import BusError
from fleet.export.foxglove import TimedMessage, messages
from fleet.export.scene import scene_of
from fleet.extras import import_extra
from fleet.live.source import Change, ChangeOutcome, Source
from fleet.live.view import rules_in_force
from fleet.log.schema import self_contained
from fleet.protocol import codec
from fleet.protocol.messages import Truth
from fleet.simulation.live_feed import LiveFrame

SCENE_S = 0.1
REDRAWN_NS, TRAIL_KEPT_NS = 1_000_000_000, 60_000_000_000
TRAILS = "/trails"
NO_EVENTS = sys.maxsize
"""Those after this number are none: viewers are told no events."""
FAULT_PARAMETERS = ("latency", "loss", "range", "partition")
"""Each is the text of an option of `fleet fault`; empty: no such rule."""
RULES_TOLD = "rules"
"""All rules in force or to come, in words: told alone."""
CLOSED = "nothing can be changed from here; start with --foxglove-control if it should be"


class LiveScene:
    """Makes the newest message of each topic of frames that come in order of time."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._before: list[Truth] = []
        self._trail: dict[int, list[Truth]] = {}
        self._drawn_ns = -REDRAWN_NS

    def take(self, frame: LiveFrame) -> Iterator[TimedMessage]:
        """What is new since the last frame; trails once a second."""
        told = (codec.decode(topic, payload) for topic, payload in frame.states)
        now = [message for message in told if isinstance(message, Truth)]
        if self._before and now and now[0].t_ns < self._before[0].t_ns:
            self._trail.clear()
            self._drawn_ns = -REDRAWN_NS
        newest = _newest(messages(scene_of(self._scenario, now), ()))
        newest.pop(TRAILS, None)
        yield from newest.values()
        self._before = now
        if frame.t_ns - self._drawn_ns >= REDRAWN_NS:
            self._drawn_ns = frame.t_ns
            yield from self._trails(now)

    def _trails(self, now: Sequence[Truth]) -> Iterator[TimedMessage]:
        for truth in now:
            own = [*self._trail.get(truth.id, ()), truth]
            self._trail[truth.id] = [t for t in own if t.t_ns >= truth.t_ns - TRAIL_KEPT_NS]
        flown = [t for own in self._trail.values() for t in own]
        trails = _newest(messages(scene_of(self._scenario, flown), ())).get(TRAILS)
        if trails is not None:
            yield trails


def _newest(said: Iterator[TimedMessage]) -> dict[str, TimedMessage]:
    return {message.topic: message for message in said}


class FaultParameters:
    """Faults and pace as parameters by name, and what a change of some of them asks for."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._given: dict[str, tuple[str, tuple[int, ...]]] = {}
        self._frame: LiveFrame | None = None

    def note(self, frame: LiveFrame) -> None:
        """Take in what is in force."""
        self._frame = frame
        there = {rule["kind"] for rule in rules_in_force(frame)}
        for name in FAULT_PARAMETERS:
            if name not in there:  # ended by somebody else
                self._given.pop(name, None)

    def values(self) -> dict[str, Any]:
        """All parameters as they are."""
        frame = self._frame
        return {
            **{name: self._in_force(name) for name in FAULT_PARAMETERS},
            RULES_TOLD: [rule["text"] for rule in self._rules()],
            "kill": ",".join(self._killed()),
            "paused": frame.paused if frame else False,
            "speed": frame.speed if frame else 0.0,
        }

    def set(self, name: str, value: Any) -> ChangeOutcome:
        """Change one."""
        if name == "paused":
            if not isinstance(value, bool):
                return ChangeOutcome(good=False, text=f"'{value}' is neither true nor false")
            return self._source.change(Change(paused=bool(value)))
        if name == "speed":
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and math.isfinite(value)):
                return ChangeOutcome(good=False, text=f"'{value}' is no number")
            return self._source.change(Change(speed=float(value)))
        text = str(value or "").strip()
        if name == "kill":
            return self._source.change(self._killing(text))
        if name not in FAULT_PARAMETERS:
            return ChangeOutcome(good=False, text=f"no parameter {name}")
        faults = {name: [text]} if text else {}
        outcome = self._source.change(Change(faults=faults, end=self._numbers(name)))
        if outcome.good:
            self._given[name] = text, self._numbers(name)
        return outcome

    def _in_force(self, name: str) -> str:
        """The text that was given, if its rule is the only one of its kind; else all, in words."""
        text, ended = self._given.get(name, ("", ()))
        others = [r for r in self._rules() if r["kind"] == name and r["n"] not in ended]
        if text and len(others) <= 1:
            return text
        return "; ".join(rule["text"] for rule in others)

    def _killing(self, text: str) -> Change:
        """To kill who is named and flies, and start again who is killed and not named."""
        wanted = {part.strip() for part in text.split(",") if part.strip()}
        killed = [rule for rule in self._rules() if rule["kind"] == "kill"]
        ended = tuple(rule["n"] for rule in killed if rule["node"] not in wanted)
        new = sorted(wanted.difference(self._killed()))
        return Change(faults={"kill": new} if new else {}, end=ended)

    def _killed(self) -> list[str]:
        """Who is killed by the plan: a run that is paused kills nobody until it goes on."""
        killed = [rule for rule in self._rules() if rule["kind"] == "kill" and rule["on"]]
        return list(dict.fromkeys(rule["node"] for rule in killed))

    def _numbers(self, kind: str) -> tuple[int, ...]:
        return tuple(rule["n"] for rule in self._rules() if rule["kind"] == kind)

    def _rules(self) -> list[dict[str, Any]]:
        return rules_in_force(self._frame) if self._frame else []


class FoxgloveServer:
    """Serves a source until it is over."""

    def __init__(self, source: Source, scenario: Scenario, *, control: bool) -> None:
        """`control`: viewers may set parameters."""
        self._source, self._scenario = source, scenario
        self._control = control
        self._sdk = import_extra("foxglove", "foxglove", "--foxglove")
        self._channels: dict[str, Any] = {}
        self._lock = threading.Lock()
        self._controls = FaultParameters(source)
        self._server: Any = None

    def serve(self, host: str, port: int, ready: Callable[[int], None]) -> None:
        """Serve until the source is over; `ready(port)` is called when viewers may come.

        Raises:
            BusError: the port is taken.
        """
        sdk = self._sdk
        sdk.set_log_level("ERROR")
        try:
            server = sdk.start_server(
                name=self._source.title,
                host=host,
                port=port,
                capabilities=[sdk.Capability.Parameters],
                server_listener=self._listener(),
                supported_encodings=["json"],
            )
        except RuntimeError as error:
            what = "LOG" if self._source.recorded else "RUN"
            raise BusError(
                f"cannot serve Foxglove at {host}:{port} ({error}); "
                f"'fleet live {what} --foxglove --port 0' takes any port that is free"
            ) from error
        self._server = server
        ready(server.port)
        try:
            self._publish(server)
        finally:
            server.stop()

    def _publish(self, server: Any) -> None:
        scene, shown = LiveScene(self._scenario), dict[str, Any]()
        while True:
            begun_s = time.monotonic()
            with self._lock:
                frame = self._source.frame(NO_EVENTS)
                if frame is not None:
                    self._controls.note(frame)
            if frame is None and self._source.is_over():
                return
            if frame is not None:
                for message in scene.take(frame):
                    self._log(message)
                values = self._controls.values()
                if values != shown:
                    server.publish_parameter_values(self._parameters(values))
                shown = values
            time.sleep(max(0.0, begun_s + SCENE_S - time.monotonic()))

    def _log(self, said: TimedMessage) -> None:
        channel = self._channels.get(said.topic)
        if channel is None:
            schema = json.dumps(self_contained(type(said.message), said.schema)).encode()
            kind = self._sdk.Schema(name=said.schema, encoding="jsonschema", data=schema)
            channel = self._sdk.Channel(said.topic, message_encoding="json", schema=kind)
            self._channels[said.topic] = channel
        channel.log(msgspec.json.encode(said.message), log_time=said.t_ns)

    def _parameters(self, values: Mapping[str, Any]) -> list[Any]:
        return [self._sdk.Parameter(name, value=value) for name, value in values.items()]

    def _listener(self) -> Any:
        outer = self

        class Listener(self._sdk.ServerListener):  # type: ignore[misc, name-defined]
            """What viewers ask of parameters."""

            def on_get_parameters(self, *_: Any, **__: Any) -> list[Any]:
                return outer._parameters(outer._controls.values())

            def on_set_parameters(self, _client: Any, given: Any, _id: Any = None) -> list[Any]:
                with outer._lock:
                    changed = [outer._set(one.name, one.get_value()) for one in given]
                    if any(changed) and (frame := outer._source.frame(NO_EVENTS)) is not None:
                        outer._controls.note(frame)  # or the answer would tell what was before
                    return outer._parameters(outer._controls.values())

        return Listener()

    def _set(self, name: str, value: Any) -> bool:
        """Change a parameter, if viewers may; tell them why not. Whether it was changed."""
        outcome = ChangeOutcome(good=False, text=CLOSED)
        if self._control:
            outcome = self._controls.set(name, value)
            if not outcome.good:
                print(f"fleet: {name}: {outcome.text}", file=sys.stderr, flush=True)
        if not outcome.good:
            self._server.publish_status(f"{name}: {outcome.text}", self._sdk.StatusLevel.Error)
        return outcome.good
