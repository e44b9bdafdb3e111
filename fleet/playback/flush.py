"""Waiting until what was published has left this process.

zenoh gives what is queued for a slow subscriber two seconds when a session is closed, then drops
it, and does not tell how much is queued. But a queue can only be there while a socket's send buffer
is full, and how full that is the kernel tells (where it does not, nothing is waited for).
"""

from __future__ import annotations

import fcntl
import struct
import termios
import time
from collections.abc import Callable
from pathlib import Path

LOOK_S = 0.02
EMPTY_LOOKS = 3
"""A batch may just be on its way from the queue to the buffer."""


def unsent_bytes() -> int:
    """What the sockets of this process hold that has not been taken at the other end."""
    total = 0
    try:
        descriptors = list(Path("/proc/self/fd").iterdir())
    except OSError:
        return 0
    for entry in descriptors:
        try:
            if str(entry.readlink()).startswith("socket:"):
                answer = fcntl.ioctl(int(entry.name), termios.TIOCOUTQ, struct.pack("i", 0))
                total += struct.unpack("i", answer)[0]
        except OSError:  # closed meanwhile, or a socket that does not send
            continue
    return total


def flush(
    patience_s: float,
    unsent: Callable[[], int] = unsent_bytes,
    now_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> bool:
    """Wait until nothing is unsent; False if nothing moves for as long as the patience."""
    empty, before, moved_s = 0, -1, now_s()
    while empty < EMPTY_LOOKS:
        left = unsent()
        if left != before:
            before, moved_s = left, now_s()
        elif left and now_s() - moved_s > patience_s:
            return False
        empty = 0 if left else empty + 1
        sleep(LOOK_S)
    return True
