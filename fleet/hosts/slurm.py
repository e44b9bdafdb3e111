"""A deployment as a Slurm batch script: one node for each host that has UAVs."""

from __future__ import annotations

import shlex

from fleet.hosts.deployment import Deployment

_SCRIPT = """\
#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --nodes={nodes}
#SBATCH --ntasks-per-node=1
#SBATCH --output=%x-%j.out
# The first node has router, simulation and coordinator too; the log is where this is submitted.
set -euo pipefail

nodes=$(scontrol show hostnames "$SLURM_JOB_NODELIST")
router=${{nodes%%$'\\n'*}}
export FLEET_CONNECT="tcp/$router:{port}"
{links}first=(srun --overlap --nodes=1 --ntasks=1 --nodelist="$router")

"${{first[@]}}" {router} &
router_pid=$!
trap 'kill "$router_pid" 2>/dev/null || true; wait' EXIT
{coordinator}srun --overlap --nodes={nodes} --ntasks={nodes} --ntasks-per-node=1 \\
    bash -c {uavs} &
"${{first[@]}}" {simulation}
"""


def slurm_script(deployment: Deployment) -> dict[str, str]:
    """The script, by name of file. The names of the hosts are those that Slurm gives."""

    def fleet(words: list[str]) -> str:
        return shlex.join([deployment.command, *words])

    coordinator = f'"${{first[@]}}" {fleet(deployment.coordinator_words())} &\n'
    links = deployment.link_environment().items()
    text = _SCRIPT.format(
        name=deployment.name,
        nodes=len(deployment.uav_groups),
        port=deployment.port,
        links="".join(f"export {name}={shlex.quote(path)}\n" for name, path in links),
        router=fleet(deployment.router_words()),
        coordinator=coordinator if deployment.has_coordinator else "",
        uavs=shlex.quote(nth_group(deployment, "SLURM_PROCID")),
        simulation=fleet(deployment.simulation_words(deployment.log)),
    )
    return {f"{deployment.name}.sbatch": text}


def nth_group(deployment: Deployment, variable: str) -> str:
    """A shell's command that is the UAVs of the group whose number, from 0, is in a variable."""
    groups = " ".join(deployment.uav_groups)
    _, _, *rest = deployment.uav_words("")
    fleet = shlex.join([deployment.command, "uav"])
    return f'set -- {groups}; shift "${variable}"; exec {fleet} "$1" {shlex.join(rest)}'
