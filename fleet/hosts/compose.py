"""A deployment as compose.yaml: a container for each role, and one for the UAVs of each host.

More UAVs, or more containers for them, are another hosts file or `--set generate.count=N`.
"""

from __future__ import annotations

from collections.abc import Collection

from fleet.hosts.certificates import INSIDE, certificate_files, making_certificates
from fleet.hosts.deployment import Deployment
from fleet.hosts.yaml_text import YamlValue, yaml_text

USER = "10001:10001"
"""Nobody of the host; the image has the folder for logs for it (Containerfile)."""
_HEAD = """\
# {name} with every role in a container of its own, made by `fleet hosts FILE --as compose`:
#   docker compose up --build --exit-code-from simulation     (or podman-compose)
#   docker compose cp simulation:{log} .
"""
_CERTIFICATES = """\
# Before, with certificates, whose keys only their owner can read:
#   {make}
#   sudo chown {user} {keys}
"""


def compose_file(deployment: Deployment) -> dict[str, str]:
    """compose.yaml, by that name. Hosts are services, and the router is the host `router`.

    Raises:
        HostsFileError: it has a file of zenoh's configuration, which may name others.

    """
    inside = deployment.in_containers("/scenario.toml", INSIDE)
    log = f"/logs/{deployment.log}"
    roles: dict[str, list[str]] = {
        "router": inside.router_words(),
        "simulation": [*inside.simulation_words(log), "--force"],
    }
    if deployment.has_coordinator:
        roles["coordinator"] = inside.coordinator_words()
    uavs = {f"uavs-{host.label}": host for host in deployment.hosts if host.uavs}
    roles |= {role: inside.uav_words(host.uav_ids) for role, host in uavs.items()}
    services = {role: _service(inside, role, words) for role, words in roles.items()}
    for role, service in services.items():
        own = uavs[role].uavs if role in uavs else deployment.uav_ids
        volumes = _volumes(deployment, role, own)
        if volumes:
            service["volumes"] = volumes
    table: YamlValue = {"services": services, "volumes": {"logs": {}}}
    head = _HEAD.format(name=deployment.name, log=log)
    return {"compose.yaml": head + _certificates_head(deployment, roles) + yaml_text(table)}


def _volumes(deployment: Deployment, role: str, uavs: tuple[int, ...]) -> list[str]:
    """What a service has of the host: single files, that it can read and not write; and the log."""
    volumes = []
    if role == "simulation":
        volumes.append("logs:/logs")
        if deployment.scenario_text:
            volumes.append(f"{_beside(deployment.scenario)}:/scenario.toml:ro")
    if deployment.secure:
        folder = _beside(deployment.secure)
        names = certificate_files(role, uavs)
        volumes += [f"{folder}/{name}:{INSIDE}/{name}:ro" for name in names]
    return volumes


def _certificates_head(deployment: Deployment, roles: Collection[str]) -> str:
    """How the files come to be there, as a comment."""
    if not deployment.secure:
        return ""
    files = {n for role in roles for n in certificate_files(role, deployment.uav_ids)}
    whose = sorted({name for name in files if name.endswith(".key") and "uav-" not in name})
    keys = " ".join(f"{deployment.secure}/{name}" for name in [*whose, "uav-*.key"])
    return _CERTIFICATES.format(
        make=making_certificates(deployment, "router"), user=USER, keys=keys
    )


def _service(inside: Deployment, role: str, words: list[str]) -> dict[str, YamlValue]:
    service: dict[str, YamlValue] = {
        "image": inside.image,
        "build": {"context": ".", "dockerfile": "Containerfile"},
        "init": True,
        "user": USER,
        "cap_drop": ["ALL"],
        "security_opt": ["no-new-privileges:true"],
        "command": words,
    }
    if role == "router":
        probe = f"import socket; socket.create_connection(('127.0.0.1', {inside.port}), 2)"
        service["healthcheck"] = {
            "test": ["CMD", "python3", "-c", probe],
            "interval": "2s",
            "timeout": "5s",
            "retries": 30,
        }
        if inside.link_environment():
            service["environment"] = inside.link_environment()
    else:
        service["environment"] = inside.environment("router")
        service["depends_on"] = {"router": {"condition": "service_healthy"}}
    return service


def _beside(path: str) -> str:
    """A path as compose takes it for a file: else it is the name of a volume."""
    return path if path.startswith(("/", "./", "../")) else f"./{path}"
