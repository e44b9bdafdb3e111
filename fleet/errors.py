"""Everything that this package raises on purpose: one tree, so that `except FleetError` is enough.

Each message says what, where and what to do. Wrong arguments of a call are ValueError, as anywhere
in Python; ArgumentError and ScenarioError are both.
"""

from __future__ import annotations


class FleetError(Exception):
    """What was asked for cannot be done; the message says why, and what to do."""


class ArgumentError(FleetError, ValueError):
    """An argument of a call is nothing that it takes; the message says what it needs."""


class ScenarioError(FleetError, ValueError):
    """The scenario cannot be used; the message says file, key and remedy."""


class TooDenseError(ScenarioError):
    """No starting positions without overlapping zones were found."""


class StudyError(FleetError, ValueError):
    """The study file, or a folder of results, cannot be used; the message says what to do."""


class HostsFileError(FleetError, ValueError):
    """The hosts file cannot be used; the message says file, key and remedy."""


class LogError(FleetError):
    """The log cannot be written or read."""


class BusError(FleetError):
    """The bus could not be opened."""


class SecurityError(FleetError):
    """A certificate is missing or no good; the message says which, and what is wrong with it."""


class MissingExtraError(FleetError):
    """A library is not installed; the message has the command that installs it."""


class FailedError(FleetError):
    """What was asked for is possible, but went wrong on the way."""


class LogWriteError(LogError, FailedError):
    """The log could be begun but not be written to its end (disk full)."""


class NoRoomError(FailedError):
    """The operating system's limits are too low; the message says which, and what is needed."""


class ResolverError(FailedError):
    """A resolver failed, or gave something that cannot be flown; the message says where."""


class ProgramError(FailedError):
    """The program that flies a relay's UAV has gone, is silent, or answers what cannot be sent."""


class FleetStoppedError(FailedError):
    """The run cannot go on; the message says who and why."""
