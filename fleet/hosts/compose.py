"""A deployment as compose.yaml: a container for each role, and one for the UAVs of each host.

More UAVs, or more containers for them, are another hosts file or `--set generate.count=N`.
"""

from __future__ import annotations

from fleet.errors import HostsFileError
from fleet.hosts.deployment import Deployment
from fleet.hosts.yaml_text import YamlValue, yaml_text

USER = "10001:10001"
"""Nobody of the host; the image has the folder for logs for it (Containerfile)."""
_HEAD = """\
# {name} with every role in a container of its own, made by `fleet hosts FILE --as compose`:
#   docker compose up --build --exit-code-from simulation     (or podman-compose)
#   docker compose cp simulation:{log} .
"""


def compose_file(deployment: Deployment) -> dict[str, str]:
    """compose.yaml, by that name. Hosts are services, and the router is the host `router`.

    Raises:
        HostsFileError: it has certificates, whose owner compose cannot set.

    """
    if deployment.zenoh_config:
        raise HostsFileError(
            "zenoh_config: not for containers; set FLEET_ZENOH_CONFIG in the image"
        )
    if deployment.secure:
        raise HostsFileError("secure: not for compose; its network is closed to others as it is")
    inside = deployment.with_scenario_at("/scenario.toml")
    log = f"/logs/{deployment.log}"
    roles: dict[str, list[str]] = {
        "router": inside.router_words(),
        "simulation": [*inside.simulation_words(log), "--force"],
    }
    if deployment.has_coordinator:
        roles["coordinator"] = inside.coordinator_words()
    for host in deployment.hosts:
        if host.uavs:
            roles[f"uavs-{host.label}"] = inside.uav_words(host.uav_ids)
    services = {role: _service(inside, role, words) for role, words in roles.items()}
    if deployment.scenario_text:
        services["simulation"]["volumes"] = [
            "logs:/logs",
            f"{_beside(deployment.scenario)}:/scenario.toml:ro",
        ]
    table: YamlValue = {"services": services, "volumes": {"logs": {}}}
    head = _HEAD.format(name=deployment.name, log=log)
    return {"compose.yaml": head + yaml_text(table)}


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
    else:
        service["environment"] = inside.environment("router")
        service["depends_on"] = {"router": {"condition": "service_healthy"}}
    if role == "simulation":
        service["volumes"] = ["logs:/logs"]
    return service


def _beside(path: str) -> str:
    """A path as compose takes it for a file: else it is the name of a volume."""
    return path if path.startswith(("/", "./", "../")) else f"./{path}"
