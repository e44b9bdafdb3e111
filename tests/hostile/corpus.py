"""The seed corpus: a file of inputs for each target, made by `python -m tests.hostile.seeds`."""

from __future__ import annotations

from pathlib import Path

import msgspec

FOLDER = Path(__file__).parent / "corpus"


def stored(name: str) -> list[bytes]:
    """The inputs that a target begins with."""
    return msgspec.msgpack.decode((FOLDER / f"{name}.msgpack").read_bytes(), type=list[bytes])


def store(name: str, inputs: list[bytes]) -> None:
    """Keep the inputs of a target."""
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / f"{name}.msgpack").write_bytes(msgspec.msgpack.encode(inputs))
