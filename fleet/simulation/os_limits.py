"""Whether the operating system has room for what is to be started; said before anything is."""

from __future__ import annotations

import os
import resource
import tempfile

from fleet.errors import NoRoomError

FILES, FILES_EACH = 30, 3
"""Open files that a simulation needs by itself, and for each process: a socket and both its pipes.

Counted for 5 and for 17 processes (37 and 73), with a few in reserve.
"""

SOCKET_BYTES = 107
"""The longest name of a socket, without the null character at its end (Linux, unix(7))."""
_BELOW = len("/pymp-12345678/listener-12345678")
"""What multiprocessing puts below the folder for temporary files."""


def check_room(processes: int) -> None:
    """Make sure that so many processes can be started, raising the soft limit if need be.

    Raises:
        NoRoomError: a limit is too low.

    """
    needed = FILES + FILES_EACH * processes
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if not _allows(soft, needed) and _allows(hard, needed):
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
    elif not _allows(soft, needed):
        raise NoRoomError(
            f"{processes} processes need {needed} open files, and the limit is {soft}: raise it, "
            f"as with 'ulimit -n {needed}'"
        )
    folder = tempfile.gettempdir()
    most = SOCKET_BYTES - _BELOW
    if len(os.fsencode(folder)) > most:
        raise NoRoomError(
            f"the name of the folder for temporary files, {folder}, is too long for a socket in "
            f"it: set TMPDIR to one of at most {most} bytes, as /tmp"
        )


def _allows(limit: int, needed: int) -> bool:
    return limit == resource.RLIM_INFINITY or limit >= needed
