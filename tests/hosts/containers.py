"""compose.yaml run by podman, for real: its log is checked, its digest must be that of one host.

    python -m tests.hosts.containers [--base IMAGE] [--runtime NAME] [--build OPTION] [--run OPTION]

By hand, as root, on Linux with podman: it builds the image of Containerfile and starts a container
for each service as compose.yaml says: order by health, user, capabilities, network, volume, names.
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

ROOT = Path(__file__).parent.parent.parent
PATIENCE_S = 300.0


class Containers:
    """The services of a compose file as containers; a context that leaves none behind."""

    def __init__(self, podman: list[str], options: list[str]) -> None:
        """`podman` is how it is called, `options` what each run of a container gets too."""
        self._podman, self._options = podman, options
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
        words = ["run", "--detach", "--init", "--name", self._name(name), "--network", self._prefix]
        words += ["--user", service["user"], *self._hosts]
        words += [f"--cap-drop={capability}" for capability in service["cap_drop"]]
        words += [
            f"--security-opt={option.partition(':')[0]}" for option in service["security_opt"]
        ]
        words += [f"--env={key}={value}" for key, value in service.get("environment", {}).items()]
        for volume in service.get("volumes", []):
            words.append(f"--volume={volume.replace('logs:', f'{self._prefix}:', 1)}")
        self._started.append(name)
        self._call(*words, *self._options, service["image"], *service["command"])
        where = "{{range .NetworkSettings.Networks}}{{.IPAddress}}{{end}}"
        address = self._call("inspect", "--format", where, self._name(name)).stdout.strip()
        self._hosts.append(f"--add-host={name}:{address}")

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

    def _call(self, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        call = [*self._podman, *words]
        done = subprocess.run(call, check=False, capture_output=True, text=True)
        if check and done.returncode:
            raise RuntimeError(f"{' '.join(call)}: {done.stderr.strip()}")
        return done


def fly(services: dict[str, Any], podman: list[str], options: list[str], log: Path) -> bool:
    """Run all services to their end and fetch the log; whether each ended as it should."""
    inside = services["simulation"]["command"]
    with Containers(podman, options) as containers:
        for name, service in services.items():
            containers.start(name, service)
            if "healthcheck" in service:
                containers.await_health(name, service["healthcheck"])
        codes = {name: containers.exit_code(name) for name in services if name != "router"}
        for name, code in codes.items():
            print(f"{name}: exit code {code}")
            if code:
                print(containers.said(name))
        containers.fetch("simulation", inside[inside.index("--out") + 1], log)
    return not any(codes.values())


def main() -> int:
    """Build, run, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", default="")
    parser.add_argument("--runtime", default="")
    parser.add_argument("--build", action="append", default=[])
    parser.add_argument("--run", action="append", default=[])
    given = parser.parse_args()
    podman = ["podman", *(["--runtime", given.runtime] if given.runtime else [])]
    services = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
    base = [f"--build-arg=BASE={given.base}"] if given.base else []
    image = services["router"]["image"]
    build = [*podman, "build", *base, *given.build, "-t", image, "-f", "Containerfile", "."]
    subprocess.run(build, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap"
        ended = fly(services, podman, given.run, log)
        flown, alone = fleet.open_log(log), fleet.run(services["simulation"]["command"][1])
        verdict = fleet.check(flown).overall
    print(f"{len(services)} containers: digest {flown.digest}, one host: {alone.digest}")
    print(f"fleet check: {verdict}")
    return int(not ended or flown.digest != alone.digest or verdict != "valid")


if __name__ == "__main__":
    sys.exit(main())
