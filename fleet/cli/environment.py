"""Environment variables in place of options, for units, containers and jobs.

`fleet run` takes them with `--external` alone: a run of one machine is not to change by them.
"""

from __future__ import annotations

CONNECT_VARIABLE = "FLEET_CONNECT"
RUN_VARIABLE = "FLEET_RUN"
ID_VARIABLE = "FLEET_ID"
SECURE_VARIABLE = "FLEET_SECURE"
ZENOH_CONFIG_VARIABLE = "FLEET_ZENOH_CONFIG"
