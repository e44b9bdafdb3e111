"""A deployment as a Kubernetes manifest: an indexed Job for the UAVs, a pod for each host's."""

from __future__ import annotations

import re

from fleet.errors import HostsFileError
from fleet.hosts.deployment import Deployment
from fleet.hosts.slurm import nth_group
from fleet.hosts.yaml_text import YamlValue, yaml_text

USER_ID = 10001
LOG_SIZE = "1Gi"


def kubernetes_manifest(deployment: Deployment) -> dict[str, str]:
    """The manifest, by name of file. The router is reached by the name of its service.

    Raises:
        HostsFileError: it has certificates, which would have to be secrets.

    """
    if deployment.zenoh_config:
        raise HostsFileError(
            "zenoh_config: not for containers; set FLEET_ZENOH_CONFIG in the image"
        )
    if deployment.secure:
        raise HostsFileError("secure: not for kubernetes yet; restrict the bus by a NetworkPolicy")
    name = re.sub(r"[^a-z0-9]+", "-", deployment.name.lower()).strip("-")[:40] or "fleet"
    inside = deployment.with_scenario_at("/scenario/scenario.toml")
    router = f"{name}-router"
    environment = inside.environment(router)
    groups = len(deployment.uav_groups)
    indexed = ["sh", "-c", nth_group(inside, "JOB_COMPLETION_INDEX")]
    documents: list[YamlValue] = [
        *_router(inside, router),
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
    if deployment.has_coordinator:
        words = [inside.command, *inside.coordinator_words()]
        documents.append(_job(f"{name}-coordinator", {}, _pod(inside, words, environment)))
    spread: dict[str, YamlValue] = {
        "completionMode": "Indexed",
        "completions": groups,
        "parallelism": groups,
    }
    documents.append(_job(f"{name}-uavs", spread, _pod(inside, indexed, environment)))
    return {f"{name}.yaml": "---\n".join(yaml_text(document) for document in documents)}


def _router(inside: Deployment, name: str) -> list[YamlValue]:
    labels: YamlValue = {"app": name}
    words = [inside.command, *inside.router_words()]
    probe: YamlValue = {"tcpSocket": {"port": inside.port}}
    pod = _pod(inside, words, {}, {"readinessProbe": probe})
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
    mounts: list[YamlValue] = [{"name": "logs", "mountPath": "/logs"}]
    volumes: list[YamlValue] = [
        {"name": "logs", "persistentVolumeClaim": {"claimName": f"{name}-logs"}}
    ]
    if inside.scenario_text:
        mounts.append({"name": "scenario", "mountPath": "/scenario"})
        volumes.append({"name": "scenario", "configMap": {"name": f"{name}-scenario"}})
    pod = _pod(inside, words, environment, {"volumeMounts": mounts})
    return _job(f"{name}-simulation", {}, {**pod, "volumes": volumes})


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
    container |= more or {}
    return {
        "restartPolicy": "Never",
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER_ID,
            "runAsGroup": USER_ID,
            "fsGroup": USER_ID,
        },
        "containers": [container],
    }
