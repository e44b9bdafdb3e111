"""A deployment as systemd units, one for each role on each host."""

from __future__ import annotations

from fleet.errors import HostsFileError
from fleet.hosts.deployment import Deployment

_UNIT = """\
# On {host}: put it into /etc/systemd/system
[Unit]
Description={what} of {name} (zenoh-fleet)
Wants=network-online.target
After=network-online.target

[Service]
Type=exec
{user}
StateDirectory=fleet
WorkingDirectory=%S/fleet
{environment}
ExecStart={start}
LimitNOFILE=65536
NoNewPrivileges=yes
ProtectSystem=strict
ProtectHome=read-only
PrivateTmp=yes

[Install]
WantedBy=multi-user.target
"""


def systemd_units(deployment: Deployment) -> dict[str, str]:
    """Units by name of file; each says on which host it belongs. None is restarted by itself.

    (In lockstep nobody who has left is taken back, and a run that has ended is not to begin anew.)

    Raises:
        HostsFileError: the scenario is a file without an absolute path.

    """
    if deployment.scenario_text and not deployment.scenario.startswith("/"):
        raise HostsFileError(
            "scenario: for systemd give its absolute path on the simulation's host"
        )
    # Keys can be read by their owner alone.
    user = "User=fleet" if deployment.secure else "DynamicUser=yes"
    units = {}
    for host in deployment.hosts:
        for role, words in deployment.roles_on(host).items():
            environment = deployment.environment().items()
            units[f"fleet-{role}.service"] = _UNIT.format(
                host=host.name,
                what=f"UAVs {host.uav_ids}" if role.startswith("uavs-") else role.capitalize(),
                user=user,
                name=deployment.name,
                environment="\n".join(f"Environment={_quoted(f'{k}={v}')}" for k, v in environment),
                start=" ".join(map(_quoted, [deployment.command, *words])),
            )
    return units


def _quoted(word: str) -> str:
    """A word as systemd reads it: specifiers and variables are not expanded."""
    plain = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%").replace("$", "$$")
    return f'"{plain}"' if plain != word or any(c in word for c in " ';\t") else word
