"""`fleet hosts`: how to start each role of a run on its host."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from fleet.hosts.commands import shell_commands
from fleet.hosts.compose import compose_file
from fleet.hosts.deployment import Deployment
from fleet.hosts.hosts_file import load_hosts
from fleet.hosts.kubernetes import kubernetes_manifest
from fleet.hosts.slurm import slurm_script
from fleet.hosts.systemd import systemd_units
from fleet.log.new_files import keep, new_folder


class HostsFormat(StrEnum):
    """What starts the roles."""

    commands = "commands"
    systemd = "systemd"
    kubernetes = "kubernetes"
    slurm = "slurm"
    compose = "compose"


_MAKERS = {
    HostsFormat.commands: shell_commands,
    HostsFormat.systemd: systemd_units,
    HostsFormat.kubernetes: kubernetes_manifest,
    HostsFormat.slurm: slurm_script,
    HostsFormat.compose: compose_file,
}


def made_of(kind: HostsFormat, deployment: Deployment) -> dict[str, str]:
    """The files of a format that start a deployment, by name."""
    return _MAKERS[kind](deployment)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("hosts")(hosts)


def hosts(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A hosts file (docs/hosts.md).")],
    kind: Annotated[
        HostsFormat, typer.Option("--as", help="What is to start the roles.")
    ] = HostsFormat.commands,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change any scenario field, as in generate.count=50. Can be given many times.",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="A folder for the files, instead of printing them.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files there.")] = False,
) -> int:
    """Tell how to start each role of a run on its host: commands, or files for what starts them.

    \b
    Examples:
      fleet hosts hosts.toml
      fleet hosts hosts.toml --as systemd --out units
      fleet hosts hosts.toml --as slurm --set generate.count=50
    """  # noqa: D301 (the \b keeps the lines apart)
    made = made_of(kind, load_hosts(str(file), settings or []))
    if out is None:
        named = kind is HostsFormat.systemd
        texts = [f"# {name}\n{text}" if named else text for name, text in made.items()]
        sys.stdout.write("\n".join(texts))
        return 0
    keep(file, *(out / name for name in made))
    with new_folder(out, overwrite=force) as folder:
        for name, text in made.items():
            (folder / name).write_text(text, encoding="utf-8")
    print(f"{out}: {', '.join(made)}")
    return 0
