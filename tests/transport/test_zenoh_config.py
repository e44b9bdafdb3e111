"""A file of zenoh's own configuration: what it may say, and that all sessions go by it."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.cli.environment import CONNECT_VARIABLE, ZENOH_CONFIG_VARIABLE
from fleet.errors import BusError
from fleet.log.reader import summarise
from fleet.transport.zenoh_config import laid_below
from fleet.transport.zenoh_session import SessionOptions, open_client, open_router
from tests.conftest import Cli, fly
from tests.support.replay_tools import until

PASSWORD = """{ // nobody joins without it
  transport: {auth: {usrpwd: {user: 'fleet', password: 'secret', dictionary_file: 'USERS'}}},
}"""


@pytest.fixture
def password(tmp_path: Path) -> str:
    """A file by which a router asks for a password, and others give it."""
    users, file = tmp_path / "users", tmp_path / "zenoh.json5"
    users.write_text("fleet:secret\n", encoding="utf-8")
    file.write_text(PASSWORD.replace("USERS", str(users)), encoding="utf-8")
    return str(file)


def test_what_the_fleet_sets_lies_above_what_the_file_says() -> None:
    own = {"mode": "client", "transport/link/tx/lease": 60_000, "connect/retry": {"period": 1}}
    table = {"mode": "client", "transport": {"link": {"tx": {"threads": 2}}}, "qos": {"a": []}}
    assert laid_below(own, table, "x.json5") == {
        "mode": "client",
        "transport": {"link": {"tx": {"threads": 2, "lease": 60_000}}},
        "connect": {"retry": {"period": 1}},
        "qos": {"a": []},
    }
    assert table["transport"] == {"link": {"tx": {"threads": 2}}}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("{transport: {link: {tx: {lease: 3}}}}", "transport/link/tx/lease: the fleet sets it"),
        ("{scouting: {multicast: {enabled: true}}}", "scouting/multicast/enabled: the fleet sets"),
        ("{mode: 'peer'}", "mode: the fleet sets it itself; leave it out"),
        ("{connect: {endpoints: {client: []}}}", "connect/endpoints: the fleet sets it itself"),
        ("{connect: {endpoints: ['tcp/192.0.2.1:1']}}", "connect/endpoints: the fleet sets"),
        ("{id: 'ab'}", "id: each process has its own"),
        ("{transport: {link: {tx: {leas: 3}}}}", "unknown field `leas`$"),
        ("{mode 'peer'}", "line 1, column [0-9]+: expected [^\\n]+$"),
        ("[]", "no table"),
        ("{a: " + "[" * 100_000, "nested over 64 deep"),
        ("{a: " + "1" * 2_000_000, "too large"),
    ],
)
def test_a_file_that_is_no_good_is_told_in_a_line_before_anything_begins(
    cli: Cli, tmp_path: Path, text: str, why: str
) -> None:
    (tmp_path / "bad.json5").write_text(text, encoding="utf-8")
    with pytest.raises(BusError, match=rf"bad\.json5: {why}"):
        open_client(
            "tcp/127.0.0.1:1", 1.0, SessionOptions(zenoh_config=str(tmp_path / "bad.json5"))
        )
    if text.startswith(("{connect", "[]", "{mode '")):
        done = cli.run("run", "head_on", "--zenoh-config", "bad.json5", "--out", "x.mcap")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert not (tmp_path / "x.mcap").exists()


def test_a_file_that_is_not_there_is_told_in_a_line(cli: Cli) -> None:
    for options in (("uav", "1"), ("router",), ("coordinator",)):
        done = cli.run(*options, "--zenoh-config", "nowhere.json5")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert "nowhere.json5: cannot be read" in done.stderr


def test_a_router_asks_all_for_the_password_of_its_file(password: str) -> None:
    session, where = open_router("tcp/127.0.0.1:0", zenoh_config=password)
    try:
        with pytest.raises(BusError, match="no zenoh router answers"):
            open_client(where, 0.5)
        open_client(where, 30.0, SessionOptions(zenoh_config=password)).close()
    finally:
        session.close()


def test_every_process_of_a_run_goes_by_the_file(cli: Cli, tmp_path: Path, password: str) -> None:
    flags = ("--duration", "5", "--zenoh-config", password, "--out", "x.mcap")
    done = cli.run("run", "head_on", *flags)
    assert done.returncode == 0, done.stderr
    digest = summarise(tmp_path / "x.mcap").metadata["result"]["digest"]
    assert digest == fly("head_on", "duration_s=5").digest


def test_roles_by_hand_take_the_file_from_their_environment(
    cli: Cli, tmp_path: Path, password: str
) -> None:
    here = {ZENOH_CONFIG_VARIABLE: password}
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0", **here)
    assert router.stderr is not None
    here[CONNECT_VARIABLE] = router.stderr.readline().split()[-1]
    run = cli.start("run", "head_on", "--external", "--duration", "5", "--out", "x.mcap", **here)
    others = [cli.start(*words, **here) for words in (("uav", "1-2"), ("coordinator",))]
    for process in (run, *others):
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    router.terminate()
    until(lambda: router.poll() is not None)
    digest = summarise(tmp_path / "x.mcap").metadata["result"]["digest"]
    assert digest == fly("head_on", "duration_s=5").digest


def test_who_changes_a_run_finds_its_file(cli: Cli, tmp_path: Path, password: str) -> None:
    here = {"XDG_RUNTIME_DIR": str(tmp_path)}
    flags = ("--duration", "600", "--speed", "1", "--zenoh-config", password, "--out", "x.mcap")
    run = cli.start("run", "head_on", *flags, **here)
    assert run.stderr is not None
    name = run.stderr.readline().split()[1].rstrip(":")
    until(lambda: any(tmp_path.glob(f"fleet-*/{name}.json")))
    done = cli.run("fault", name, "--loss", "20%", **here)
    assert done.returncode == 0, done.stderr
    run.terminate()
    run.communicate(timeout=60)
