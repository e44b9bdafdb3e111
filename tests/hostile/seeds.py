"""Make the seed corpus of real runs.

Usage: python -m tests.hostile.seeds
"""

from __future__ import annotations

from collections import defaultdict
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import tomli_w

from fleet.config.loading import as_table, load_scenario, packaged
from fleet.config.scenario import Scenario
from fleet.faults.plan import plan_json
from fleet.faults.rules import Rule
from fleet.live.source import Change
from fleet.log.reader import Summary, read
from fleet.node.join_info import plan_bytes
from fleet.node.node import RestartState
from fleet.node.progress import ProgressReport
from fleet.protocol.classes import AUDIBLE
from fleet.protocol.codec import encode
from fleet.protocol.messages import PersistentState
from fleet.protocol.sample import attachment
from fleet.protocol.topics import topic_of
from fleet.simulation.fault_control import FaultAnswer, FaultRequest
from fleet.simulation.live_feed import LinkCount, LiveFrame
from tests.analysis.test_check_faults import SAMPLES as FAULT_SAMPLES
from tests.hostile import corpus, foreign_files
from tests.hostile.hostile_input import LISTED, SHIFTED, input_bytes
from tests.hostile.log_input import log_input, plain_copy
from tests.hostile.message_target import UNIX_NS
from tests.hostile.scene import ENCOUNTER, scenes
from tests.support.odd_logs import base_log
from tests.support.rewriting import logged
from tests.support.samples import CLOCK, SAMPLES, S, ack, command, truth

OF_TOPIC, OF_CLASS = 2, 10
ROOT = Path(__file__).parent.parent.parent
STUDIES = ("latency_loss", "validity", "electors", "traffic", "converging")
MARK = attachment(UNIX_NS - 5_000_000) or b""


def message_seeds() -> dict[str, list[bytes]]:
    """Inputs of each class: what was said in encounters, a few of each topic, and samples."""
    found: dict[str, dict[str, list[bytes]]] = defaultdict(lambda: defaultdict(list))
    for message in SAMPLES:
        topic = topic_of(message)
        found[message.kind][f"sample {topic}"] = [_seed(0, topic, encode(message))]
    for n, scene in enumerate(scenes()):
        for items in scene.moment.flown[0][scene.moment.begin :]:
            for topic, payload, message in items:
                if message.kind not in AUDIBLE and n:
                    continue
                kept = found[message.kind][f"{n % 3} {topic}"]
                if len(kept) < OF_TOPIC:
                    kept.append(_seed(n, topic, payload))
    return {kind: _few([i for kept in found[kind].values() for i in kept]) for kind in found}


def _seed(scene: int, topic: str, payload: bytes) -> bytes:
    return input_bytes(SHIFTED | LISTED | scene << 2, topic, payload, MARK)


def _few(inputs: list[bytes]) -> list[bytes]:
    return inputs[:: -(-len(inputs) // OF_CLASS)]


def _rules() -> tuple[Rule, ...]:
    """Rules of all kinds."""
    return tuple(rule for kind in FAULT_SAMPLES.values() for rule in kind[1])


def reply_seeds() -> dict[str, list[bytes]]:
    """Answers and questions as they are asked and given in a run."""
    scenario = ENCOUNTER.scenario
    rules = _rules()
    with_plan = msgspec.structs.replace(CLOCK, plan=plan_json(rules))
    restarts = {
        "1": RestartState(
            1, 5 * S, PersistentState(1, 0, S, 3, 3, 3, 1), truth(1, (0.0, 0.0, -300.0), S)
        )
    }
    generated = load_scenario("converge")
    topics = [(topic, payload) for topic, payload, _ in ENCOUNTER.flown[0][-1]]
    states = tuple(t for t in topics if t[0].endswith(("truth", "adsb/0")))
    said = tuple(
        (n, *one)
        for n, one in enumerate(
            zip(["1/cmd/2", "2/ack/1"], map(encode, (command(), ack(command()))), strict=True)
        )
    )
    frame = LiveFrame(
        9, 9 * S, states, said, (LinkCount(1, 2, 9, 1, S),), plan_json(rules[:3]), (1,), (2,)
    )
    ask = msgspec.json.encode
    return {
        "clock": [encode(CLOCK), encode(with_plan)],
        "plan": [
            plan_bytes("lockstep", scenario),
            plan_bytes("realtime", generated, 7.0, restarts),
        ],
        "progress": [ask(ProgressReport(7, "taking in", {"adsb/0": ((1, 5),)}, ("a.py:1 f",)))],
        "view": [msgspec.msgpack.encode(frame)],
        "answer": [
            ask(FaultAnswer(3, 0.3, rules[:4], "", ("it is idle",), 1)),
            ask(FaultAnswer(problem="no")),
        ],
        "change": [
            ask(Change({"loss": ["30%"], "partition": ["1,2/3"]}, end=(0,))),
            ask(Change(paused=True, speed=2.0, steps=3)),
        ],
        "request": [
            ask(FaultRequest(rules[n : n + 2], n % 2 == 0, (0,))) for n in range(0, len(rules), 4)
        ],
    }


def file_seeds() -> dict[str, list[bytes]]:
    """Files as users have them."""
    scenarios = [_packaged(name) for name in packaged()]
    full = as_table(msgspec.structs.replace(load_scenario("head_on"), fault=_rules()[:12]))
    return {
        "scenario": [*scenarios, tomli_w.dumps(_without_none(full)).encode()],
        "study": [(ROOT / "studies" / f"{name}.toml").read_bytes() for name in STUDIES],
        "hosts": [(ROOT / "examples" / "hosts.toml").read_bytes(), foreign_files.HOSTS.encode()],
        "bluesky": [text.encode() for text in foreign_files.BLUESKY],
        "daidalus": [text.encode() for text in foreign_files.DAIDALUS],
        "csv": [text.encode() for text in foreign_files.CSV],
    }


def log_seeds() -> dict[str, list[bytes]]:
    """Short runs, in lockstep; that of two UAVs as plain bytes too."""
    pair = apart_for(1.5)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pair.mcap"
        logged(path, pair)
        summary = Summary(path)
        plain = plain_copy(list(read(path, summary)), summary.metadata)
        small = log_input(path)
        meeting = log_input(base_log(Path(folder) / "meeting.mcap"))
    return {"log": [small, meeting], "file": [plain]}


def apart_for(duration_s: float) -> Scenario:
    """Two UAVs that meet, for a moment."""
    scenario = load_scenario("head_on", {"duration_s": duration_s})
    return msgspec.structs.replace(scenario, description="")


def _packaged(name: str) -> bytes:
    return (resources.files("fleet.config") / "scenarios" / f"{name}.toml").read_bytes()


def _without_none(tree: Any) -> Any:
    """TOML has no null."""
    if isinstance(tree, dict):
        return {name: _without_none(value) for name, value in tree.items() if value is not None}
    return [_without_none(value) for value in tree] if isinstance(tree, list | tuple) else tree


def main() -> None:
    """Make all files."""
    for name, inputs in {**message_seeds(), **reply_seeds(), **file_seeds(), **log_seeds()}.items():
        corpus.store(name, inputs)


if __name__ == "__main__":
    main()
