"""What a burst took goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

BURST = """
import resource
from fleet.transport.free_memory import give_back_free_memory

def resident_mib():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 2**20

give_back_free_memory()
before = resident_mib()
burst = [bytes(700) for _ in range(60_000)]
last = bytes(700)
burst.clear()
kept = resident_mib() - before
given = give_back_free_memory()
print(kept > 30, given, resident_mib() - before < 5)
"""
"""What was allocated last stays, so that the C library cannot give back what is below it."""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="others cannot be asked")
def test_memory_of_a_burst_goes_back() -> None:
    done = subprocess.run(
        [sys.executable, "-c", BURST], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == ["True", "True", "True"]
