"""The digests of packaged scenarios and random cases on this machine, and on others: are they one?

    python -m tests.machines [--share 0.2] [--cases 20] [--python PATH ...] [--aarch64 FOLDER]

Flown are: this Python, plainly; the same with FMA and AVX2 switched off in the C library and all
extensions of the processor in numpy; every other Python that is named, with the project installed;
and with `--aarch64` a Debian of that architecture, unpacked in that folder if it is not there yet,
under emulation. That needs root, and the Debian packages qemu-user-static and debootstrap
(`--mirror` is where the latter loads from), and takes an hour, or a quarter of it with
`--share 0.2`. Exits with 1 if a digest differs.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
QEMU = "qemu-aarch64-static"


def restricted() -> dict[str, str]:
    """The environment that switches off what processors have beside the least."""
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return {
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4",
        "NPY_DISABLE_CPU_FEATURES": " ".join(simd.get("found", [])),
    }


def start(
    python: list[str], environment: Mapping[str, str], share: float, cases: int
) -> subprocess.Popen[str]:
    """Begin to fly all; the digests come as lines of JSON."""
    command = [*python, "-m", "tests.support.digests", "--share", f"{share}", "--cases", f"{cases}"]
    return subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, **environment}, stdout=subprocess.PIPE, text=True
    )


def digests(process: subprocess.Popen[str]) -> Iterator[tuple[str, str]]:
    """What was flown and the digest, as they come.

    Raises:
        CalledProcessError: it failed.

    """
    assert process.stdout is not None
    for line in process.stdout:
        yield from json.loads(line).items()
    if process.wait():
        raise subprocess.CalledProcessError(process.returncode, process.args)


def aarch64(folder: Path, mirror: str) -> tuple[list[str], dict[str, str]]:
    """The command and environment of a Python of another architecture, unpacked in a folder."""
    system, site = folder / "system", folder / "site"
    if not site.exists():
        options = ["--arch=arm64", "--foreign", "--variant=minbase", "--include=python3"]
        _run("debootstrap", *options, "bookworm", str(system), *([mirror] if mirror else []))
        for package in sorted((system / "var/cache/apt/archives").glob("*.deb")):
            _run("dpkg", "-x", str(package), str(system))
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        where = ["--platform", "manylinux_2_28_aarch64", "--platform", "manylinux2014_aarch64"]
        where += ["--python-version", "3.11", "--only-binary", ":all:", "--target", str(site)]
        pip = [sys.executable, "-m", "pip", "install", "--quiet", *where]
        _run(*pip, "-c", str(ROOT / "constraints.txt"), *project["dependencies"])
    python = [QEMU, "-L", str(system), str(system / "usr/bin/python3.11")]
    home = str(system / "usr")
    return python, {"PYTHONPATH": f"{ROOT}:{site}", "PYTHONHOME": home}


def _run(*command: str) -> None:
    subprocess.run(command, check=True)


def main() -> None:
    """Fly everything everywhere and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--python", nargs="*", default=[])
    parser.add_argument("--aarch64", type=Path)
    parser.add_argument("--mirror", default="")
    options = parser.parse_args()
    machines: dict[str, tuple[list[str], dict[str, str]]] = {
        "plain": ([sys.executable], {}),
        "restricted": ([sys.executable], restricted()),
        **{path: ([path], {}) for path in options.python},
    }
    if options.aarch64:
        machines["aarch64"] = aarch64(options.aarch64.resolve(), options.mirror)
    wanted: dict[str, str] = {}
    same = True
    for machine, (python, environment) in machines.items():
        found = dict(digests(start(python, environment, options.share, options.cases)))
        wanted = wanted or found
        differing = [name for name, digest in wanted.items() if found.get(name) != digest]
        same = same and not differing
        equal = f"{len(wanted) - len(differing)} of {len(wanted)} digests as plain"
        print(f"{machine}: {equal}{', not ' * bool(differing)}{', '.join(differing)}", flush=True)
    sys.exit(not same)


if __name__ == "__main__":
    main()
