"""A deployment: who is where, and the words of the command that starts each role."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from fleet.config.uav_numbers import ranges_of
from fleet.errors import HostsFileError


@dataclass(frozen=True)
class HostRoles:
    """A host, by the name under which others reach it, with its roles and the UAVs on it."""

    name: str
    roles: tuple[str, ...]
    uavs: tuple[int, ...]

    @property
    def label(self) -> str:
        """Its name as units and services may be named."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-")

    @property
    def uav_ids(self) -> str:
        """Its UAVs as `fleet uav` takes them: `1-3,7`."""
        return ranges_of(self.uavs).replace(" ", "")


@dataclass(frozen=True)
class Deployment:
    """A scenario spread over hosts.

    `scenario` is a packaged one or a path, `scenario_text` what is in that file, `wait_s` how long
    those who come first wait for the others, `command` how `fleet` is called, `secure` a folder
    with certificates on each host, `zenoh_config` a file of zenoh's own configuration there, and
    `image` that of containers.
    """

    name: str
    scenario: str
    scenario_text: str
    settings: tuple[str, ...]
    clock: str
    port: int
    wait_s: float
    command: str
    secure: str
    zenoh_config: str
    image: str
    hosts: tuple[HostRoles, ...]

    @property
    def router(self) -> str:
        """The host that the others connect to."""
        return next(host.name for host in self.hosts if "router" in host.roles)

    @property
    def has_coordinator(self) -> bool:
        """Whether some host has one."""
        return any("coordinator" in host.roles for host in self.hosts)

    @property
    def uav_groups(self) -> tuple[str, ...]:
        """The UAVs of each host that has some, as `fleet uav` takes them."""
        return tuple(host.uav_ids for host in self.hosts if host.uavs)

    @property
    def uav_ids(self) -> tuple[int, ...]:
        """All UAVs, by number."""
        return tuple(sorted(uav for host in self.hosts for uav in host.uavs))

    @property
    def endpoint(self) -> str:
        """Where the router is reached."""
        return self.endpoint_at(self.router)

    @property
    def log(self) -> str:
        """The name of the log."""
        return f"{self.name}.mcap"

    def endpoint_at(self, host: str) -> str:
        """The endpoint of a router on a host."""
        return f"tcp/{f'[{host}]' if ':' in host else host}:{self.port}"

    def in_containers(self, scenario: str, certificates: str) -> Deployment:
        """The same, as containers see it: where they find what is a file or folder on a host.

        Raises:
            HostsFileError: it has a file of zenoh's configuration, which may name others.

        """
        if self.zenoh_config:
            raise HostsFileError(
                "zenoh_config: not for containers; set FLEET_ZENOH_CONFIG in the image"
            )
        return replace(
            self,
            scenario=scenario if self.scenario_text else self.scenario,
            secure=certificates if self.secure else "",
        )

    def router_words(self) -> list[str]:
        """Arguments of `fleet` for the router, on all addresses of its host."""
        return ["router", "--listen", self.endpoint_at("0.0.0.0")]  # noqa: S104 (others join)

    def simulation_words(self, log: str) -> list[str]:
        """Arguments of `fleet` for the simulation, which logs there; FLEET_CONNECT says where."""
        words = ["run", self.scenario]
        for setting in self.settings:
            words += ["--set", setting]
        if self.clock != "lockstep":
            words += ["--clock", self.clock]
        wait = f"{self.wait_s:g}"
        words += ["--external", "--join-timeout", wait, "--wait", wait]
        return [*words, "--out", log]

    def coordinator_words(self) -> list[str]:
        """Arguments of `fleet` for the coordinator; FLEET_CONNECT says where."""
        return ["coordinator", *self._waiting()]

    def uav_words(self, ids: str) -> list[str]:
        """Arguments of `fleet` for these UAVs; FLEET_CONNECT says where."""
        return ["uav", ids, *self._waiting()]

    def _waiting(self) -> list[str]:
        return ["--wait", f"{self.wait_s:g}"]

    def environment(self, host: str = "") -> dict[str, str]:
        """What each role is told by its environment; `host` instead of the router's own name."""
        where = {"FLEET_CONNECT": self.endpoint_at(host) if host else self.endpoint}
        return where | self.link_environment()

    def link_environment(self) -> dict[str, str]:
        """The part of it that the router is told, too: how links are."""
        told = {"FLEET_SECURE": self.secure, "FLEET_ZENOH_CONFIG": self.zenoh_config}
        return {name: path for name, path in told.items() if path}

    def roles_on(self, host: HostRoles) -> dict[str, list[str]]:
        """Arguments of `fleet` by role for what is on a host, in the order of starting."""
        words = {"router": self.router_words(), "coordinator": self.coordinator_words()}
        words = {role: words[role] for role in words if role in host.roles}
        if host.uavs:
            words[f"uavs-{host.label}"] = self.uav_words(host.uav_ids)
        if "simulation" in host.roles:
            words["simulation"] = self.simulation_words(self.log)
        return words
