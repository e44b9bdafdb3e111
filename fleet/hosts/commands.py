"""A deployment as commands: what to type, or to run by a shell, on each host."""

from __future__ import annotations

import shlex

from fleet.hosts.deployment import Deployment


def shell_commands(deployment: Deployment) -> dict[str, str]:
    """A shell script for each host, by name of file."""
    scripts = {}
    for host in deployment.hosts:
        roles = deployment.roles_on(host)
        lines = [f"# {host.name}"]
        for name, value in deployment.environment().items() if roles else ():
            lines.append(f"export {name}={shlex.quote(value)}")
        *first, last = [shlex.join([deployment.command, *words]) for words in roles.values()] or [
            "# nothing to start"
        ]
        lines += [f"{line} &" for line in first]
        scripts[f"{host.name}.sh"] = "\n".join([*lines, last]) + "\n"
    return scripts
