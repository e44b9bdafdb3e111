"""Compose files run by podman, for real: logs are checked, digests must be that of one host.

    python -m tests.hosts.containers [--base IMAGE] [--runtime NAME] [--build OPTION] [--run OPTION]

By hand, as root, on Linux with podman: it builds the image of Containerfile and starts a container
for each service as compose.yaml says: order by health, user, capabilities, network, volumes, names.
Then once more with certificates, as `fleet hosts --as compose` says for the same hosts file with
`secure`: they are made and handed over by the commands at the head of the compose file. Each
container must have the files of its own role alone, and its user can read them and not write.

Without --base the image begins with that of Containerfile; one of Debian packages does too, if it
has Python with its module venv (debootstrap --include=python3,python3-venv,ca-certificates, then
podman import). --build and --run are handed on to podman, as --run=--ulimit=nofile=20000:20000.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import yaml

import fleet
from fleet.hosts.compose import compose_file
from fleet.hosts.hosts_file import load_hosts

ROOT = Path(__file__).parent.parent.parent
PATIENCE_S = 300.0
OWN_FILES = {
    "router": "router.key router.pem uav-1.pem uav-2.pem uav-3.pem uav-4.pem",
    "simulation": "sim.key sim.pem",
    "coordinator": "coordinator.key coordinator.pem",
    "uavs-beta": "uav-1.key uav-1.pem uav-2.key uav-2.pem",
    "uavs-gamma": "uav-3.key uav-3.pem uav-4.key uav-4.pem",
}
"""What the containers of examples/hosts.toml must have of the certificates, beside ca.pem."""
LOOK = """
import os, pathlib
for file in pathlib.Path("/certs").iterdir():
    unread = " cannot be read" * (not os.access(file, os.R_OK))
    print(file.name + unread + " can be written" * os.access(file, os.W_OK))
"""
"""Python code for a container: which certificates are there, and what is wrong with them."""


class Containers:
    """The services of a compose file as containers; a context that leaves none behind."""

    def __init__(self, podman: list[str], options: list[str], folder: Path) -> None:
        """`podman` is how it is called, `options` what each run of a container gets too.

        `folder` is where the compose file is, and the files that it mounts.
        """
        self._podman, self._options, self._folder = podman, options, folder
        self._prefix = f"fleet-{os.getpid()}"
        self._started: list[str] = []
        self._hosts: list[str] = []

    def __enter__(self) -> Containers:
        """A network of its own."""
        self._call("network", "create", self._prefix)
        return self

    def __exit__(self, *_: object) -> None:
        """Take everything away."""
        for name in reversed(self._started):
            self._call("rm", "--force", "--time", "2", self._name(name), check=False)
        self._call("network", "rm", self._prefix, check=False)
        self._call("volume", "rm", self._prefix, check=False)

    def start(self, name: str, service: dict[str, Any]) -> None:
        """Start a service in the background; those after it reach it by its name, without DNS."""
        words = ["--detach", "--init", "--name", self._name(name), "--network", self._prefix]
        self._started.append(name)
        self._run([*words, *self._hosts], service, service["command"])
        where = "{{range .NetworkSettings.Networks}}{{.IPAddress}}{{end}}"
        address = self._call("inspect", "--format", where, self._name(name)).stdout.strip()
        self._hosts.append(f"--add-host={name}:{address}")

    def certificates(self, service: dict[str, Any]) -> list[str]:
        """The names of those that a container of this service has, as its user finds them."""
        words = ["--rm", "--network", "none", "--entrypoint", "python3"]
        return sorted(self._run(words, service, ["-c", LOOK]).stdout.splitlines())

    def await_health(self, name: str, probe: dict[str, Any]) -> None:
        """Until the test of its health passes; raises TimeoutError."""
        deadline_s = time.monotonic() + PATIENCE_S
        while self._call("exec", self._name(name), *probe["test"][1:], check=False).returncode:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"{name} is not healthy")
            time.sleep(1.0)

    def exit_code(self, name: str) -> int:
        """Wait for a service to end."""
        return int(self._call("wait", self._name(name)).stdout)

    def said(self, name: str) -> str:
        """What a service has said."""
        done = self._call("logs", self._name(name))
        return done.stdout + done.stderr

    def fetch(self, name: str, path: str, to: Path) -> None:
        """A file out of a container."""
        self._call("cp", f"{self._name(name)}:{path}", str(to))

    def _name(self, service: str) -> str:
        return f"{self._prefix}-{service}"

    def _run(
        self, words: list[str], service: dict[str, Any], command: list[str]
    ) -> subprocess.CompletedProcess[str]:
        """A container with what the service says of user, rights, environment and volumes."""
        words = ["run", *words, "--user", service["user"]]
        words += [f"--cap-drop={capability}" for capability in service["cap_drop"]]
        words += [
            f"--security-opt={option.partition(':')[0]}" for option in service["security_opt"]
        ]
        words += [f"--env={key}={value}" for key, value in service.get("environment", {}).items()]
        for volume in service.get("volumes", []):
            words.append(f"--volume={volume.replace('logs:', f'{self._prefix}:', 1)}")
        return self._call(*words, *self._options, service["image"], *command)

    def _call(self, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        call = [*self._podman, *words]
        done = subprocess.run(call, cwd=self._folder, check=False, capture_output=True, text=True)
        if check and done.returncode:
            raise RuntimeError(f"{' '.join(call)}: {done.stderr.strip()}")
        return done


def services_in(compose: str) -> dict[str, Any]:
    """The services of a compose file, by name."""
    services: dict[str, Any] = yaml.safe_load(compose)["services"]
    return services


def secured_services(folder: Path) -> dict[str, Any]:
    """The services of the example with certificates, which are in the folder afterwards.

    They are made by what the head of the compose file tells its reader to do.
    """
    hosts = folder / "hosts.toml"
    example = (ROOT / "examples" / "hosts.toml").read_text(encoding="utf-8")
    hosts.write_text(f'secure = "certs"\n{example}', encoding="utf-8")
    compose = compose_file(load_hosts(str(hosts)))["compose.yaml"]
    told = [line.removeprefix("#   ") for line in compose.splitlines() if line.startswith("#   ")]
    making = [line for line in told if line.startswith(("fleet certs ", "sudo chown "))]
    script = "\n".join(line.removeprefix("sudo ") for line in making)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    subprocess.run(["sh", "-ec", script], cwd=folder, check=True, env=os.environ | {"PATH": path})
    return services_in(compose)


def holds_its_own(services: dict[str, Any], containers: Containers) -> bool:
    """Whether each service has the certificates of its role and no others; tells which."""
    own = {name: sorted(["ca.pem", *OWN_FILES[name].split()]) for name in services}
    found = {name: containers.certificates(service) for name, service in services.items()}
    for name, files in found.items():
        print(f"{name}: has {', '.join(files)}{'' if files == own[name] else ': WRONG'}")
    return found == own


def fly(services: dict[str, Any], containers: Containers, log: Path) -> bool:
    """Run all services to their end and fetch the log; whether each ended as it should."""
    inside = services["simulation"]["command"]
    for name, service in services.items():
        containers.start(name, service)
        if "healthcheck" in service:
            containers.await_health(name, service["healthcheck"])
    codes = {name: containers.exit_code(name) for name in services if name != "router"}
    for name, code in codes.items():
        print(f"{name}: exit code {code}")
        if code:
            print(containers.said(name))
    print(f"router: {containers.said('router').strip()}")
    containers.fetch("simulation", inside[inside.index("--out") + 1], log)
    return not any(codes.values())


def is_as_alone(log: Path, digest: str) -> bool:
    """Whether a log is valid and has the digest of one host; tells both."""
    flown = fleet.open_log(log)
    verdict = fleet.check(flown).overall
    print(f"digest {flown.digest}, one host: {digest}\nfleet check: {verdict}")
    return flown.digest == digest and verdict == "valid"


def main() -> int:
    """Build, run, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", default="")
    parser.add_argument("--runtime", default="")
    parser.add_argument("--build", action="append", default=[])
    parser.add_argument("--run", action="append", default=[])
    given = parser.parse_args()
    podman = ["podman", *(["--runtime", given.runtime] if given.runtime else [])]
    services = services_in((ROOT / "compose.yaml").read_text(encoding="utf-8"))
    base = [f"--build-arg=BASE={given.base}"] if given.base else []
    image = services["router"]["image"]
    build = [*podman, "build", *base, *given.build, "-t", image, "-f", "Containerfile", "."]
    if subprocess.run(build, cwd=ROOT, check=False, stdout=subprocess.DEVNULL).returncode:
        return 1  # podman has told why
    digest = fleet.run(services["simulation"]["command"][1]).digest
    with tempfile.TemporaryDirectory() as temporary:
        folder, log = Path(temporary), Path(temporary) / "run.mcap"
        print(f"{len(services)} containers on an open bus")
        with Containers(podman, given.run, folder) as containers:
            good = fly(services, containers, log) and is_as_alone(log, digest)
        print(f"{len(services)} containers with certificates")
        secured = secured_services(folder)
        with Containers(podman, given.run, folder) as containers:
            flown = holds_its_own(secured, containers) and fly(secured, containers, log)
            closed = flown and "listening on tls/" in containers.said("router")
            good &= closed and is_as_alone(log, digest)
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
