"""Memory that is free goes back to the system, also after a burst.

What comes when a silent link is heard again takes some 20 MiB for a moment. The C library of most
Linux systems (glibc) keeps it, for each thread by itself, and the next burst takes more in another.
"""

from __future__ import annotations

import ctypes

GIVE_BACK_EVERY_S = 60.0
"""A process that flies by the wall clock gives back so often, not all at once: it takes some ms."""


def give_back_free_memory() -> bool:
    """Whether anything went back; other C libraries do it by themselves, or cannot be asked."""
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError):
        return False
    return bool(trim(ctypes.c_size_t(0)))
