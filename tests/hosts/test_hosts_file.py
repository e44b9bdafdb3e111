"""`fleet hosts`: what starts each role, as commands and as files for what starts them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fleet.config.uav_numbers import numbers_in
from fleet.errors import FleetError, HostsFileError
from fleet.hosts.commands import shell_commands
from fleet.hosts.compose import compose_file
from fleet.hosts.hosts_file import load_hosts
from fleet.hosts.kubernetes import kubernetes_manifest
from fleet.hosts.slurm import slurm_script
from fleet.hosts.systemd import systemd_units
from fleet.hosts.yaml_text import yaml_text
from fleet.log.reader import summarise
from tests.conftest import Cli, fly
from tests.support.replay_tools import until

ROOT = Path(__file__).parent.parent.parent
EXAMPLE = ROOT / "examples" / "hosts.toml"
FLEET = Path(sys.executable).parent / "fleet"
ROLES = ("simulation", "coordinator", "uavs")
FIVE = """
scenario = "converge"
set = ["generate.count=5", "duration_s=10"]
port = {port}
command = "{command}"
wait_s = 30
[[host]]
name = "localhost"
roles = ["router", "simulation", "coordinator"]
uavs = "4"
[[host]]
name = "second"
uavs = "rest"
[[host]]
name = "Third.example"
uavs = "rest"
"""


def five(folder: Path) -> Path:
    """A hosts file with a free port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    file = folder / "hosts.toml"
    file.write_text(FIVE.format(port=port, command=FLEET), encoding="utf-8")
    return file


def documents(text: str) -> dict[str, Any]:
    """The documents of a manifest by kind and name."""
    return {f"{d['kind']} {d['metadata']['name']}": d for d in yaml.safe_load_all(text)}


def test_the_compose_file_of_the_repository_is_made_of_the_example() -> None:
    made = compose_file(load_hosts(str(EXAMPLE)))["compose.yaml"]
    assert (ROOT / "compose.yaml").read_text(encoding="utf-8") == made, (
        "stale: fleet hosts examples/hosts.toml --as compose > compose.yaml"
    )


def test_its_services_wait_for_a_healthy_router_and_run_as_nobody_of_the_host() -> None:
    services = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
    roles = ["router", "simulation", "coordinator", "uavs-beta", "uavs-gamma"]
    assert list(services) == roles
    users = {service["user"] for service in services.values()}
    recipe = (ROOT / "Containerfile").read_text(encoding="utf-8")
    assert {f"USER {user}" for user in users} <= set(recipe.splitlines())
    assert "healthcheck" in services.pop("router")
    for service in services.values():
        assert service["depends_on"] == {"router": {"condition": "service_healthy"}}
        assert service["environment"] == {"FLEET_CONNECT": "tcp/router:7447"}


def test_those_that_no_host_has_are_shared_by_those_who_take_the_rest(tmp_path: Path) -> None:
    deployment = load_hosts(str(five(tmp_path)), ["generate.count=8"])
    assert [host.uavs for host in deployment.hosts] == [(4,), (1, 2, 3), (5, 6, 7, 8)]
    assert deployment.uav_groups == ("4", "1-3", "5-8")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"router", ', "", "roles: no host has 'router'; one must have it"),
        ('"Third.example"', '"Third.example"\nroles = ["simulation"]', "roles: 2 host has"),
        ('"coordinator"', '"pilot"', "host.*roles.*Invalid enum value 'pilot'"),
        ('uavs = "4"', 'uavs = "4-6"', "uavs: the scenario has no UAV 6"),
        ('uavs = "4"', 'uavs = "four"', "'four': IDs from 1"),
        ('"second"\nuavs = "rest"', '"second"\nuavs = "4,5"', "uavs: UAV 4 on several hosts"),
        ('uavs = "rest"', 'uavs = "5"', "uavs: UAV 5 on several hosts"),
        ('"second"', '"third-EXAMPLE"', "host 'third-example' is there twice"),
        ('"second"', '"second; reboot"', "matching regex"),
        ('"converge"', '"nowhere"', "nowhere: no such scenario"),
        ("generate.count=5", "generate.cuont=5", "unknown key"),
        ("port = ", "prot = ", "unknown field `prot`"),
        ("wait_s = 30", "wait_s = ", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_told_with_file_and_key(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    file = five(tmp_path)
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(FleetError, match=said):
        load_hosts(str(file))


def test_a_scenario_beside_the_file_goes_with_it(tmp_path: Path) -> None:
    file = five(tmp_path)
    packaged = ROOT / "fleet" / "config" / "scenarios" / "converge.toml"
    (tmp_path / "own.toml").write_text(packaged.read_text(encoding="utf-8"), encoding="utf-8")
    text = file.read_text(encoding="utf-8").replace('"converge"', '"own.toml"')
    file.write_text(text, encoding="utf-8")
    deployment = load_hosts(str(file))
    simulation = yaml.safe_load(compose_file(deployment)["compose.yaml"])["services"]["simulation"]
    assert simulation["command"][:2] == ["run", "/scenario.toml"]
    assert simulation["volumes"] == ["logs:/logs", f"{tmp_path}/own.toml:/scenario.toml:ro"]
    [manifest] = kubernetes_manifest(deployment).values()
    told = documents(manifest)["ConfigMap converge-scenario"]["data"]["scenario.toml"]
    assert told == (tmp_path / "own.toml").read_text(encoding="utf-8")
    assert f"run {tmp_path}/own.toml" in systemd_units(deployment)["fleet-simulation.service"]


def secured(folder: Path, place: str) -> Path:
    """A hosts file whose fleet has certificates there."""
    file = five(folder)
    text = file.read_text(encoding="utf-8")
    file.write_text(f'secure = "{place}"\n{text}', encoding="utf-8")
    return file


def test_on_hosts_certificates_are_where_the_file_says(tmp_path: Path) -> None:
    deployment = load_hosts(str(secured(tmp_path, "/etc/fleet")))
    assert "export FLEET_SECURE=/etc/fleet" in shell_commands(deployment)["second.sh"]
    unit = systemd_units(deployment)["fleet-uavs-second.service"].splitlines()
    assert {"User=fleet", "Environment=FLEET_SECURE=/etc/fleet"} <= set(unit)


def told(text: str, begin: str) -> list[str]:
    """The commands that the comment at the head of a file tells."""
    lines = [line.removeprefix("#").strip() for line in text.splitlines() if line.startswith("#")]
    return [line for line in lines if line.startswith(begin)]


def test_services_fly_with_the_certificates_that_compose_mounts_for_each(
    cli: Cli, tmp_path: Path
) -> None:
    deployment = load_hosts(str(secured(tmp_path, "certs")))
    text = compose_file(deployment)["compose.yaml"]
    [making] = told(text, "fleet certs")
    assert cli.run(*making.split()[1:]).returncode == 0
    started, router = {}, f"tcp/router:{deployment.port}"
    for role, service in yaml.safe_load(text)["services"].items():
        inside = tmp_path / role
        inside.mkdir()
        for mount in service["volumes"]:
            source, target, *how = mount.split(":")
            if target.startswith("/certs/"):
                assert how == ["ro"]
                shutil.copy(tmp_path / source, inside)
        environment = service["environment"]
        assert environment.pop("FLEET_SECURE") == "/certs"
        assert environment == ({} if role == "router" else {"FLEET_CONNECT": router})
        here = {"FLEET_SECURE": str(inside), "FLEET_CONNECT": f"tcp/localhost:{deployment.port}"}
        words = [word.replace("/logs/", "") for word in service["command"]]
        started[role] = cli.start(*words, **here)
    assert not any("ca.key" in mount for mount in text.splitlines())
    router_process = started.pop("router")
    for process in started.values():
        out, err = process.communicate(timeout=60)
        assert process.returncode == 0, out + err
    router_process.terminate()
    assert summarise(tmp_path / "converge.mcap").metadata["result"]["digest"] == digest()


def test_secrets_have_what_each_role_needs_and_only_its_owner_reads_them(
    cli: Cli, tmp_path: Path
) -> None:
    deployment = load_hosts(str(secured(tmp_path, "certs")))
    [manifest] = kubernetes_manifest(deployment).values()
    [making] = told(manifest, "fleet certs")
    assert cli.run(*making.split()[1:]).returncode == 0
    stub = tmp_path / "kubectl"
    stub.write_text('#!/bin/bash\nmkdir "$4"; for f in "${@:5}"; do cp "${f#*=}" "$4"; done\n')
    stub.chmod(0o755)
    for command in told(manifest, "kubectl create secret generic"):
        path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
        subprocess.run(["bash", "-c", command], cwd=tmp_path, env=path, check=True)
    services = yaml.safe_load(compose_file(deployment)["compose.yaml"])["services"]
    for kind in ("Deployment converge-router", *(f"Job converge-{r}" for r in ROLES)):
        spec = documents(manifest)[kind]["spec"]["template"]["spec"]
        name = kind.partition(" ")[2]
        secret = {"secretName": name, "defaultMode": 0o400}
        assert {"name": "certs", "secret": secret} in spec["volumes"]
        assert spec["securityContext"]["fsGroup"] == spec["securityContext"]["runAsUser"]
        [container] = spec["containers"]
        assert {"name": "FLEET_SECURE", "value": "/certs"} in container["env"]
        assert {"name": "certs", "mountPath": "/certs"} in container["volumeMounts"]
        role = name.removeprefix("converge-")
        mounted = {
            mount.split(":")[1].removeprefix("/certs/")
            for service, found in services.items()
            if service.startswith(role)
            for mount in found["volumes"]
            if ":/certs/" in mount
        }
        assert {file.name for file in (tmp_path / name).iterdir()} == mounted


def test_a_file_of_zenohs_is_told_to_all_roles_on_hosts(tmp_path: Path) -> None:
    file = five(tmp_path)
    text = 'zenoh_config = "/etc/fleet/zenoh.json5"\n' + file.read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    deployment, variable = load_hosts(str(file)), "FLEET_ZENOH_CONFIG=/etc/fleet/zenoh.json5"
    made = [*shell_commands(deployment).values(), *slurm_script(deployment).values()]
    assert all(f"export {variable}\n" in script for script in made)
    assert all(f"Environment={variable}\n" in unit for unit in systemd_units(deployment).values())
    for make in (compose_file, kubernetes_manifest):
        with pytest.raises(HostsFileError, match=r"^zenoh_config: not for"):
            make(deployment)


def test_units_say_where_they_belong_and_quote_what_systemd_would_read(tmp_path: Path) -> None:
    units = systemd_units(load_hosts(str(five(tmp_path)), ["description=50 % of $HOME"]))
    assert sorted(units) == [
        "fleet-coordinator.service",
        "fleet-router.service",
        "fleet-simulation.service",
        "fleet-uavs-localhost.service",
        "fleet-uavs-second.service",
        "fleet-uavs-third-example.service",
    ]
    third = units["fleet-uavs-third-example.service"]
    assert third.startswith("# On Third.example")
    assert f"ExecStart={FLEET} uav 3,5 --wait 30\n" in third
    assert '"description=50 %% of $$HOME"' in units["fleet-simulation.service"]


def test_an_indexed_job_has_a_pod_for_the_uavs_of_each_host(tmp_path: Path) -> None:
    [manifest] = kubernetes_manifest(load_hosts(str(five(tmp_path)), ["generate.count=8"])).values()
    found = documents(manifest)
    assert sorted(found) == [
        "Deployment converge-router",
        "Job converge-coordinator",
        "Job converge-simulation",
        "Job converge-uavs",
        "PersistentVolumeClaim converge-logs",
        "Service converge-router",
    ]
    spec = found["Job converge-uavs"]["spec"]
    assert (spec["completionMode"], spec["completions"], spec["parallelism"]) == ("Indexed", 3, 3)
    words = spec["template"]["spec"]["containers"][0]["command"]
    assert words[:2] == ["sh", "-c"]
    script = words[2].replace(f"exec {FLEET}", "echo")
    told = [
        subprocess.run(
            ["sh", "-c", script],
            env={"JOB_COMPLETION_INDEX": str(k)},
            check=True,
            capture_output=True,
            text=True,
        ).stdout.split()[1]
        for k in range(3)
    ]
    assert sorted(n for ids in told for n in numbers_in(ids)) == list(range(1, 9))


def test_the_commands_of_all_hosts_fly_the_run_of_one(cli: Cli, tmp_path: Path) -> None:
    assert cli.run("hosts", str(five(tmp_path)), "--out", "made").returncode == 0
    names = ("localhost.sh", "second.sh", "Third.example.sh")
    assert {file.name for file in (tmp_path / "made").iterdir()} == set(names)
    started = [cli.command("bash", str(tmp_path / "made" / name)) for name in names]
    for process in started:
        out, err = process.communicate(timeout=60) if process is not started[0] else ("", "")
        assert process is started[0] or process.returncode == 0, out + err
    assert started[0].wait(timeout=60) == 0
    for pid in cli.members(started[0]):
        os.kill(pid, signal.SIGTERM)  # the router, which ends with nothing else
    assert summarise(tmp_path / "converge.mcap").metadata["result"]["digest"] == digest()


def test_the_batch_script_flies_the_run_of_one_and_ends_its_router(
    cli: Cli, tmp_path: Path
) -> None:
    tools = {
        # More names than a pipe takes: one who stopped reading would end it by SIGPIPE.
        "scontrol": '[ "$*" = "show hostnames localhost,b,c" ] && echo localhost && seq 20000',
        "srun": "for w; do case $w in --ntasks=*) n=${w#*=};; -*) ;; *) break;; esac; shift; done\n"
        'if [ "$n" = 1 ]; then exec "$@"; fi\n'
        'for k in $(seq 0 $((n - 1))); do SLURM_PROCID=$k "$@" & done; wait',
    }
    for name, text in tools.items():
        (tmp_path / name).write_text(f"#!/bin/bash\n{text}\n", encoding="utf-8")
        (tmp_path / name).chmod(0o755)
    [(name, text)] = slurm_script(load_hosts(str(five(tmp_path)))).items()
    (tmp_path / name).write_text(text, encoding="utf-8")
    path = f"{tmp_path}:{os.environ['PATH']}"
    job = cli.command("bash", name, PATH=path, SLURM_JOB_NODELIST="localhost,b,c")
    out, err = job.communicate(timeout=60)
    assert job.returncode == 0, out + err
    until(lambda: not cli.members(job))
    assert summarise(tmp_path / "converge.mcap").metadata["result"]["digest"] == digest()


def digest() -> str:
    """Of the same run on one host, in memory."""
    return fly("converge", "generate.count=5", "duration_s=10").digest


def test_files_that_are_there_stay_and_what_is_printed_is_what_is_written(
    cli: Cli, tmp_path: Path
) -> None:
    printed = cli.run("hosts", str(EXAMPLE), "--as", "slurm").stdout
    for code in (0, 2):
        assert cli.run("hosts", str(EXAMPLE), "--as", "slurm", "--out", "made").returncode == code
    assert (tmp_path / "made" / "four_way.sbatch").read_text(encoding="utf-8") == printed
    for name in ("nowhere.toml", str(tmp_path)):
        done = cli.run("hosts", name)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)


plain = st.text(max_size=6) | st.integers() | st.booleans()
keys = st.from_regex(r"[a-zA-Z][a-z_-]{0,8}x", fullmatch=True)


def nested(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Lists of plain values or of tables, and tables."""
    table = st.dictionaries(keys, inner, min_size=1, max_size=3)
    return st.lists(plain, max_size=3) | table | st.lists(table, max_size=3)


@given(st.dictionaries(keys, st.recursive(plain, nested, max_leaves=5), min_size=1, max_size=3))
def test_yaml_is_read_as_it_was_meant(table: dict[str, Any]) -> None:
    read = yaml.safe_load(yaml_text(table))
    assert json.loads(json.dumps(read)) == table
