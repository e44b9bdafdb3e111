"""The certificates of a deployment in containers: each role gets the files that it needs alone."""

from __future__ import annotations

from fleet.hosts.deployment import Deployment
from fleet.model.types import COORDINATOR
from fleet.protocol.topics import SIMULATION, issuer_name
from fleet.security.identity import CA, ROUTER, certificate_name

INSIDE = "/certs"
"""Where a container has them."""
_NAMES = {
    "router": ROUTER,
    "simulation": certificate_name(SIMULATION),
    "coordinator": certificate_name(issuer_name(COORDINATOR)),
}
"""The certificate of each role but the UAVs."""


def certificate_files(role: str, uavs: tuple[int, ...]) -> list[str]:
    """What a role, or these UAVs in one container, must have in its folder.

    A router lets those UAVs in whose certificates it has, without keys.
    """
    of_uavs = [certificate_name(str(uav)) for uav in uavs]
    shown = [_NAMES[role]] if role in _NAMES else of_uavs
    files = [f"{CA}.pem", *(f"{name}{end}" for name in shown for end in (".pem", ".key"))]
    return [*files, *(f"{name}.pem" for name in of_uavs if role == "router")]


def making_certificates(deployment: Deployment, host: str) -> str:
    """The command that makes them all, for a router that is reached by this name."""
    uavs = ",".join(deployment.uav_groups)
    return f"fleet certs {deployment.secure} --uavs {uavs} --host {host}"


def secret_command(deployment: Deployment, name: str, role: str) -> str:
    """The command that makes a secret of Kubernetes of what a role, or all UAVs, must have."""
    patterns = {"uavs": ["uav-*"], "router": [f"{ROUTER}.*", "uav-*.pem"]}
    files = [f"{CA}.pem", *patterns.get(role, [f"{_NAMES.get(role, role)}.*"])]
    given = " ".join(f"{deployment.secure}/{file}" for file in files)
    return f"kubectl create secret generic {name} $(printf -- '--from-file=%s ' {given})"
