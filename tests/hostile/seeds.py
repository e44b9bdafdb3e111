"""Make the seed corpus of real runs.

Usage: python -m tests.hostile.seeds
"""

from __future__ import annotations

from collections import defaultdict

from fleet.protocol.classes import AUDIBLE, MESSAGES
from fleet.protocol.codec import encode
from fleet.protocol.sample import attachment
from fleet.protocol.topics import topic_of
from tests.hostile import corpus
from tests.hostile.hostile_input import LISTED, SHIFTED, input_bytes
from tests.hostile.message_target import UNIX_NS
from tests.hostile.scene import scenes
from tests.support.samples import SAMPLES

OF_TOPIC, OF_CLASS = 2, 10
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


def main() -> None:
    """Make all files."""
    found = message_seeds()
    for cls in MESSAGES:
        corpus.store(cls.kind, found[cls.kind])


if __name__ == "__main__":
    main()
