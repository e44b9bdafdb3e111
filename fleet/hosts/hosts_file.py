"""The hosts file: which host has which roles (docs/hosts.md explains every key)."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from fleet.config.loading import MAX_BYTES, packaged, read_scenario
from fleet.config.scenario import ConfigTable
from fleet.config.text_files import file_text
from fleet.config.traffic import participants, uavs_of
from fleet.config.uav_numbers import numbers_in, ranges_of
from fleet.errors import HostsFileError, ScenarioError
from fleet.hosts.deployment import Deployment, HostRoles
from fleet.model.types import COORDINATOR

THE_REST = "rest"
_SHELL_SAFE = r"^[A-Za-z0-9_./:-]{1,200}$"

HostAddress = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9.:-]{0,252}$")]
PlainPath = Annotated[str, Meta(pattern=_SHELL_SAFE)]
MaybePath = Annotated[str, Meta(pattern=r"^[A-Za-z0-9_./:-]{0,200}$")]


class HostTable(ConfigTable, frozen=True):
    """[[host]]: one host, by the name or address under which the others reach it.

    `uavs` are as in `1-4,7`, or `rest`: of all others that share those which nobody else has.
    """

    name: HostAddress
    roles: tuple[Literal["router", "simulation", "coordinator"], ...] = ()
    uavs: Annotated[str, Meta(max_length=1000)] = ""


class HostsTable(ConfigTable, frozen=True):
    """A whole hosts file."""

    scenario: Annotated[str, Meta(pattern=_SHELL_SAFE)]
    set: tuple[Annotated[str, Meta(min_length=3, max_length=1000)], ...] = ()
    clock: Literal["lockstep", "realtime"] = "lockstep"
    port: Annotated[int, Meta(ge=1, le=65535)] = 7447
    wait_s: Annotated[float, Meta(ge=1.0, le=3600.0)] = 600.0
    command: PlainPath = "fleet"
    secure: MaybePath = ""
    zenoh_config: MaybePath = ""
    image: PlainPath = "zenoh-fleet"
    host: Annotated[tuple[HostTable, ...], Meta(min_length=1, max_length=10_000)] = ()


def load_hosts(source: str, settings: Sequence[str] = ()) -> Deployment:
    """The deployment of a hosts file, with `KEY=VALUE` settings over its scenario.

    A scenario that is a file is looked for beside the hosts file.

    Raises:
        HostsFileError: it is not found, not TOML, or nobody or two have a role; file, key, remedy.
        ScenarioError: its scenario cannot be used.

    """
    hosts = _hosts_of(source)
    settings = (*hosts.set, *settings)
    own = hosts.scenario not in packaged()
    path = str(Path(source).parent / hosts.scenario) if own else hosts.scenario
    loaded = read_scenario(path, settings)
    needed = participants(loaded.scenario)
    try:
        shared = _shared(hosts.host, [uav.id for uav in uavs_of(loaded.scenario)])
        problem = next(_problems(hosts.host, has_coordinator=COORDINATOR in needed), "")
    except ValueError as error:
        problem = str(error)
    if problem:
        raise HostsFileError(f"{source}: {problem}")
    return Deployment(
        name=loaded.scenario.name,
        scenario=path if own else hosts.scenario,
        scenario_text=loaded.text if own else "",
        settings=settings,
        clock=hosts.clock,
        port=hosts.port,
        wait_s=hosts.wait_s,
        command=hosts.command,
        secure=hosts.secure,
        zenoh_config=hosts.zenoh_config,
        image=hosts.image,
        hosts=tuple(
            HostRoles(host.name, host.roles, uavs)
            for host, uavs in zip(hosts.host, shared, strict=True)
        ),
    )


def _hosts_of(source: str) -> HostsTable:
    try:
        text = file_text(Path(source), source, MAX_BYTES, "a hosts file", "TOML file")
        return msgspec.convert(tomllib.loads(text), HostsTable)
    except ScenarioError as error:
        raise HostsFileError(str(error)) from error
    except msgspec.ValidationError as error:
        what, _, where = str(error).partition(" - at `$")
        path = where.rstrip("`").lstrip(".")
        raise HostsFileError(f"{source}: {f'{path}: ' if path else ''}{what}") from error
    except OSError as error:
        raise HostsFileError(f"{source}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise HostsFileError(f"{source}: not valid TOML: {error}") from error


def _shared(hosts: Sequence[HostTable], ids: Sequence[int]) -> list[tuple[int, ...]]:
    """The UAVs of each host; raises ValueError unless each of the scenario is on one."""
    named = [() if h.uavs in ("", THE_REST) else tuple(numbers_in(h.uavs)) for h in hosts]
    count = Counter(number for numbers in named for number in numbers)
    strange, twice = count.keys() - set(ids), [n for n, times in count.items() if times > 1]
    if strange:
        raise ValueError(f"uavs: the scenario has no UAV {ranges_of(strange)}")
    if twice:
        raise ValueError(f"uavs: UAV {ranges_of(twice)} on several hosts")
    left = [number for number in sorted(ids) if number not in count]
    takers = [index for index, host in enumerate(hosts) if host.uavs == THE_REST]
    if left and not takers:
        raise ValueError(
            f"uavs: no host has UAV {ranges_of(left)} (uavs = '{THE_REST}' takes them)"
        )
    out = list(named)
    for k, index in enumerate(takers):
        out[index] = tuple(left[k * len(left) // len(takers) : (k + 1) * len(left) // len(takers)])
    return out


def _problems(hosts: Sequence[HostTable], *, has_coordinator: bool) -> Iterator[str]:
    labels = Counter(HostRoles(host.name, (), ()).label for host in hosts)
    for label, times in labels.items():
        if times > 1:
            yield f"host '{label}' is there twice: give it all its roles at once"
    count = Counter(role for host in hosts for role in host.roles)
    for role in ("router", "simulation", *(("coordinator",) if has_coordinator else ())):
        if count[role] != 1:
            yield f"roles: {count[role] or 'no'} host has '{role}'; one must have it"
    if count["coordinator"] and not has_coordinator:
        yield "roles: the scenario has no coordinator (coordination.electors = 'local')"
