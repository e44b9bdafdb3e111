"""A deployment as a Kubernetes manifest: an indexed Job for the UAVs, a pod for each host's."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from fleet.hosts.certificates import INSIDE, making_certificates, secret_command
from fleet.hosts.deployment import Deployment
from fleet.hosts.slurm import nth_group
from fleet.hosts.yaml_text import YamlValue, yaml_text

USER_ID = 10001
LOG_SIZE = "1Gi"
READ_BY_OWNER = 0o400
"""Of the files of a secret; by `fsGroup` the group of the pod may read them, too."""
_CERTIFICATES = """\
# Before, with certificates, of which each role gets its own:
#   {make}
{secrets}
"""


@dataclass(frozen=True)
class _Volume:
    """What a pod has at a path; `source` as Kubernetes names where it comes from."""

    name: str
    path: str
    source: dict[str, YamlValue]


def kubernetes_manifest(deployment: Deployment) -> dict[str, str]:
    """The manifest, by name of file. The router is reached by the name of its service.

    Raises:
        HostsFileError: it has a file of zenoh's configuration, which may name others.

    """
    name = re.sub(r"[^a-z0-9]+", "-", deployment.name.lower()).strip("-")[:40] or "fleet"
    inside = deployment.in_containers("/scenario/scenario.toml", INSIDE)
    environment = inside.environment(f"{name}-router")
    groups = len(deployment.uav_groups)
    indexed = ["sh", "-c", nth_group(inside, "JOB_COMPLETION_INDEX")]
    documents: list[YamlValue] = [
        *_router(inside, f"{name}-router"),
        {
            "apiVersion": "v1",
            "kind": "PersistentVolumeClaim",
            "metadata": {"name": f"{name}-logs"},
            "spec": {
                "accessModes": ["ReadWriteOnce"],
                "resources": {"requests": {"storage": LOG_SIZE}},
            },
        },
        _simulation(inside, name, environment),
    ]
    if deployment.scenario_text:
        documents.insert(0, _scenario(deployment, name))
    roles = ["router", "simulation", "uavs"]
    if deployment.has_coordinator:
        roles.append("coordinator")
        words = [inside.command, *inside.coordinator_words()]
        own = f"{name}-coordinator"
        documents.append(_job(own, {}, _pod(inside, words, environment, _secret(inside, own))))
    spread: dict[str, YamlValue] = {
        "completionMode": "Indexed",
        "completions": groups,
        "parallelism": groups,
    }
    uavs = f"{name}-uavs"
    documents.append(_job(uavs, spread, _pod(inside, indexed, environment, _secret(inside, uavs))))
    text = "---\n".join(yaml_text(document) for document in documents)
    return {f"{name}.yaml": _certificates_head(deployment, name, roles) + text}


def _certificates_head(deployment: Deployment, name: str, roles: Sequence[str]) -> str:
    """How the secrets are made, as a comment."""
    if not deployment.secure:
        return ""
    commands = (secret_command(deployment, f"{name}-{role}", role) for role in roles)
    return _CERTIFICATES.format(
        make=making_certificates(deployment, f"{name}-router"),
        secrets="\n".join(f"#   {command}" for command in commands),
    )


def _secret(inside: Deployment, name: str) -> list[_Volume]:
    """The certificates of a role, from the secret of that name; none on an open bus."""
    if not inside.secure:
        return []
    secret: YamlValue = {"secretName": name, "defaultMode": READ_BY_OWNER}
    return [_Volume("certs", INSIDE, {"secret": secret})]


def _router(inside: Deployment, name: str) -> list[YamlValue]:
    labels: YamlValue = {"app": name}
    words = [inside.command, *inside.router_words()]
    probe: YamlValue = {"tcpSocket": {"port": inside.port}}
    volumes = _secret(inside, name)
    pod = _pod(inside, words, inside.link_environment(), volumes, {"readinessProbe": probe})
    service: YamlValue = {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": name},
        "spec": {"selector": labels, "ports": [{"port": inside.port}]},
    }
    runner: YamlValue = {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name},
        "spec": {
            "replicas": 1,
            "selector": {"matchLabels": labels},
            "template": {
                "metadata": {"labels": labels},
                "spec": {**pod, "restartPolicy": "Always"},
            },
        },
    }
    return [service, runner]


def _simulation(inside: Deployment, name: str, environment: dict[str, str]) -> YamlValue:
    words = [inside.command, *inside.simulation_words(f"/logs/{inside.log}")]
    claim: YamlValue = {"claimName": f"{name}-logs"}
    volumes = [_Volume("logs", "/logs", {"persistentVolumeClaim": claim})]
    if inside.scenario_text:
        scenario: YamlValue = {"name": f"{name}-scenario"}
        volumes.append(_Volume("scenario", "/scenario", {"configMap": scenario}))
    own = f"{name}-simulation"
    return _job(own, {}, _pod(inside, words, environment, [*volumes, *_secret(inside, own)]))


def _scenario(deployment: Deployment, name: str) -> YamlValue:
    return {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {"name": f"{name}-scenario"},
        "data": {"scenario.toml": deployment.scenario_text},
    }


def _job(name: str, spread: dict[str, YamlValue], pod: dict[str, YamlValue]) -> YamlValue:
    """A job that is not tried again: nobody who has left a run is taken back."""
    return {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": name},
        "spec": {**spread, "backoffLimit": 0, "template": {"spec": pod}},
    }


def _pod(
    inside: Deployment,
    words: list[str],
    environment: dict[str, str],
    volumes: Sequence[_Volume] = (),
    more: dict[str, YamlValue] | None = None,
) -> dict[str, YamlValue]:
    """A pod of one container, which has `more` too."""
    container: dict[str, YamlValue] = {
        "name": "fleet",
        "image": inside.image,
        "command": words,
        "securityContext": {
            "allowPrivilegeEscalation": False,
            "capabilities": {"drop": ["ALL"]},
        },
    }
    if environment:
        container["env"] = [{"name": k, "value": v} for k, v in environment.items()]
    if volumes:
        container["volumeMounts"] = [{"name": v.name, "mountPath": v.path} for v in volumes]
    container |= more or {}
    placed: YamlValue = [{"name": v.name, **v.source} for v in volumes]
    return {
        "restartPolicy": "Never",
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER_ID,
            "runAsGroup": USER_ID,
            "fsGroup": USER_ID,
        },
        "containers": [container],
        **({"volumes": placed} if volumes else {}),
    }
