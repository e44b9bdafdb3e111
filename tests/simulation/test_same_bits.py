"""A digest is the same whatever the C library and numpy make of the processor.

`python -m tests.machines` also asks another architecture and other versions of Python.
"""

from __future__ import annotations

import sys

from tests.machines import digests, restricted, start

SHARE, CASES = 0.1, 3


def test_neither_the_c_library_nor_numpy_changes_a_digest_by_the_processor() -> None:
    python = [sys.executable]
    with (
        start(python, {}, SHARE, CASES) as plain,
        start(python, {**restricted(), "PYTHONHASHSEED": "1"}, SHARE, CASES) as least,
    ):
        wanted = dict(digests(plain))
        assert dict(digests(least)) == wanted
    assert len(wanted) == len(set(wanted.values())) == 5 + CASES
