"""The seed corpus: a file of inputs for each target, made by `python -m tests.hostile.seeds`."""

from __future__ import annotations

from pathlib import Path

import msgspec
import zstandard

FOLDER = Path(__file__).parent / "corpus"


def stored(name: str) -> list[bytes]:
    """The inputs that a target begins with."""
    packed = (FOLDER / f"{name}.msgpack.zst").read_bytes()
    return msgspec.msgpack.decode(zstandard.decompress(packed), type=list[bytes])


def store(name: str, inputs: list[bytes]) -> None:
    """Keep the inputs of a target."""
    FOLDER.mkdir(exist_ok=True)
    packed = zstandard.compress(msgspec.msgpack.encode(inputs), 19)
    (FOLDER / f"{name}.msgpack.zst").write_bytes(packed)
