"""Which certificate a process shows, and where its files are; whether they are good: `checking`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fleet.model.types import COORDINATOR
from fleet.protocol.topics import SIMULATION, issuer_name

CA = "ca"
"""The certificate authority, by which all others are signed."""
ROUTER, OPERATOR, OBSERVER = "router", "operator", "observer"
"""Who has a certificate and takes no part: routers, who changes faults, who only listens."""
ROLES = (SIMULATION, issuer_name(COORDINATOR), ROUTER, OPERATOR, OBSERVER)
LISTENING = (SIMULATION, ROUTER)
"""Whose certificates are for a host too, so that others can connect to it there."""
_UAV = "uav-"


def certificate_name(issuer: str) -> str:
    """The name in the certificate of a process, by its name in keys: `uav-7` of UAV 7."""
    return f"{_UAV}{issuer}" if issuer.isdigit() else issuer


def certified_uavs(folder: Path) -> list[int]:
    """Which UAVs have a certificate in a folder."""
    ends = (path.stem.removeprefix(_UAV) for path in folder.glob(f"{_UAV}*.pem"))
    return sorted(int(end) for end in ends if end.isdecimal())


@dataclass(frozen=True)
class Identity:
    """Who this process is, by the certificate of that name in a folder made by `fleet certs`."""

    folder: Path
    name: str

    @property
    def ca(self) -> Path:
        """The certificate of the authority: whoever is signed by it belongs to the fleet."""
        return self.folder / f"{CA}.pem"

    @property
    def certificate(self) -> Path:
        """The own certificate."""
        return self.folder / f"{self.name}.pem"

    @property
    def key(self) -> Path:
        """The private key of it."""
        return self.folder / f"{self.name}.key"


def identity_of(folder: str, issuer: str) -> Identity | None:
    """Who a process is, by its name in keys or its role; None without a folder: an open bus."""
    return Identity(Path(folder).absolute(), certificate_name(issuer)) if folder else None
