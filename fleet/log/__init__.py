"""The log: MCAP in and out.

import fleet.log

log = fleet.log.open("run.mcap")
log["3/truth"].position_ned_m  # (n, 3)
"""

from fleet.errors import LogError
from fleet.log.columns import Columns
from fleet.log.store import Log, LogWarning

__all__ = ["Columns", "Log", "LogError", "LogWarning", "open"]

open = Log  # noqa: A001
