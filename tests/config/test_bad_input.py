"""Wrong usage: one clear line, exit code 2, no traceback, no file left, no process started."""

from __future__ import annotations

import codecs
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.cli import main
from fleet.config.loading import read_scenario

UAV = """
[[uav]]
id = 1
position_ned_m = [0, 0, -300]
heading_deg = 0
waypoints_ned_m = [[1000, 0, -300]]
"""
GOOD = f"name = 'x'\nduration_s = 10\n{UAV}"

FILES = {
    "not TOML": ("name = 'x", "not valid TOML"),
    "unknown key": (f"{GOOD}\n[zone]\nradus_m = 3", "zone.radus_m: unknown key (did you mean 'rad"),
    "unknown table": (f"{GOOD}\n[zones]\nradius_m = 3", "zones: unknown key (did you mean 'zone'"),
    "unknown key of a UAV": (GOOD + "speed = 3", "uav.1.speed: unknown key"),
    "unknown key of the second UAV": (
        GOOD + UAV.replace("id = 1", "id = 7") + "speed = 3",
        "broken.toml: uav.7.speed: unknown key",
    ),
    "no ID": (
        GOOD + UAV.replace("id = 1\n", ""),
        "broken.toml: uav (table 2 of 2).id: missing; add it",
    ),
    "ID that is a text": (
        GOOD.replace("id = 1", "id = 'one'"),
        "broken.toml: uav (table 1 of 1).id: expected a whole number, got text",
    ),
    "unknown key of one of two with the same ID": (
        GOOD + UAV + "speed = 3",
        "broken.toml: uav (table 2 of 2).speed: unknown key",
    ),
    "UAV that is no table": (
        "name = 'x'\nduration_s = 9\nuav = [3]",
        "broken.toml: uav (table 1 of 1): expected a table, got a whole number",
    ),
    "key of other traffic": (
        "name='x'\nduration_s=9\n[generate]\nkind='converge'\ndensity_per_km2=1",
        "generate.density_per_km2: unknown key of kind 'converge', but one of 'crossing'; possible "
        "here: kind, count, radius_m,",
    ),
    "key of another fault": (
        f"{GOOD}\n[[fault]]\nkind = 'latency'\nmean_ticks = 3",
        "fault[0].mean_ticks: unknown key of kind 'latency', but one of 'burst'; possible here: ",
    ),
    "same ID twice": (GOOD + UAV, "ID 1 is used more than once"),
    "too many UAVs": (
        "name = 'x'\nduration_s = 9\n"
        + "".join(UAV.replace("1", str(n), 1) for n in range(1, 1002)),
        "uav: expected a list of length <= 1000",
    ),
    "nobody flies": ("name = 'x'\nduration_s = 10", "uav: nobody flies"),
    "wrong type": (f"name = 'x'\nduration_s = 'ten'\n{UAV}", "duration_s: expected a number"),
    "no range": (
        f"{GOOD}\n[surveillance]\nrange_m = 'far'",
        "surveillance.range_m: expected a number, got text",
    ),
    "a range of nothing": (
        f"{GOOD}\n[coordination]\nrange_m = 0",
        "coordination.range_m: expected a number >= 0.001",
    ),
    "missing key": (f"name = 'x'\n{UAV}", "duration_s: missing"),
    "unknown traffic": (
        "name='x'\nduration_s=9\n[generate]\nkind='swarm'",
        "generate.kind: invalid",
    ),
    "listed and generated": (f"{GOOD}\n[generate]\nkind='converge'", "both are given"),
    "ID 0": (GOOD.replace("id = 1", "id = 0"), "uav.0.id: expected a whole number >= 1"),
    "two coordinates": (GOOD.replace("[0, 0, -300]", "[0, 0]", 1), "list of length 3, got 2"),
    "not a number": (GOOD.replace("[0, 0, -300]", "[nan, 0, -300]", 1), "position_ned_m[0]"),
    "no waypoint": (GOOD.replace("[[1000, 0, -300]]", "[]"), "uav.1.waypoints_ned_m: "),
    "bad name": (GOOD.replace("'x'", "'x y'"), "name: expected"),
    "even count of candidates": (f"{GOOD}\n[resolution]\nturn_candidates = 12", "12 is even"),
    "sectors that overlap": (
        f"{GOOD}\n[resolution]\nrear_deg = 20",
        "resolution.rear_deg: less than head_on_deg; raise it",
    ),
    "too steep": (f"{GOOD}\n[resolution]\nmax_climb_mps = 20", "more than uav.1 can fly"),
    "no time at all": (
        f"{GOOD}\n[surveillance]\nbroadcast_s = 5e-324",
        "broken.toml: surveillance.broadcast_s: ",
    ),
    "off the tick": (f"{GOOD}\n[surveillance]\nbroadcast_s = 0.25", "not a multiple of tick_s"),
    "unknown fault": (f"{GOOD}\n[[fault]]\nkind = 'gremlin'", "fault[0].kind: invalid value"),
    "bursts that lose too much": (
        f"{GOOD}\n[[fault]]\nkind='burst'\nloss=0.9\nmean_ticks=5",
        "fault[0].mean_ticks: bursts so short cannot make up a mean loss of 0.9; make it 9 or more",
    ),
    "fault of nobody": (f"{GOOD}\n[[fault]]\nkind='loss'\nprobability=1\nsrc='x'", "'uav', 'coor"),
    "unknown resolver": ("resolver = 'nope'\n" + GOOD, "resolver 'nope'"),
    "resolver that is not there": ("resolver = 'no.such:Thing'\n" + GOOD, "ModuleNotFoundError"),
}
LINES = {
    "unknown command": (["bogus"], "No such command 'bogus'"),
    "no scenario": (["run"], "Missing argument"),
    "unknown scenario": (["run", "fourway"], "did you mean 'four_way'"),
    "no such file": (["run", "no.toml"], "no.toml: no such file"),
    "a folder": (["run", "."], "cannot be read"),
    "unknown option": (["run", "side", "--bogus"], "No such option: --bogus"),
    "bad clock": (["run", "side", "--clock", "slow"], "--clock"),
    "bad seed": (["run", "side", "--seed", "x"], "--seed"),
    "negative duration": (
        ["run", "side", "--duration", "-5"],
        "duration_s: expected a number >= 0.001",
    ),
    "less than a tick": (["run", "side", "--duration", "0.01"], "shorter than one tick"),
    "set without value": (["run", "side", "--set", "seed"], "write key=value"),
    "set of no key": (["run", "side", "--set", "zone.x=1"], "zone.x: unknown key"),
    "set of no UAV": (["run", "side", "--set", "uav.9.speed_mps=9"], "no UAV with ID '9'"),
    "memory in realtime": (["run", "side", "--bus", "memory", "--clock", "realtime"], "wall clock"),
    "no endpoint": (["run", "side", "--connect", "garbage"], "is no endpoint"),
    "no router": (
        ["run", "side", "--connect", "tcp/127.0.0.1:1", "--wait", "0.3"],
        "no zenoh router answers at tcp/127.0.0.1:1",
    ),
    "external without a place": (["run", "side", "--external"], "--external needs --connect"),
    "log in no folder": (["run", "side", "--out", "no/x.mcap"], "cannot write no/x.mcap"),
    "log exists": (["run", "side", "--out", "there.mcap"], "exists already, not overwriting"),
    "log is a folder": (["run", "side", "--out", "."], "is a directory"),
    "info of nothing": (["info", "no.mcap"], "cannot read no.mcap"),
    "info of something else": (["info", "there.mcap"], "not an MCAP file"),
    "router nowhere": (["router", "--listen", "tcp/127.0.0.1:99999"], "cannot listen on"),
    "UAV 0": (["uav", "0"], "ID"),
    "too dense": (["run", "crossing", "--set", "generate.density_per_km2=90"], "no room for 30"),
    "impossibly far apart": (
        ["run", "side", "--duration", "80000", "--set", "uav.1.speed_mps=400"],
        "could come further than",
    ),
    "a name too long": (["run", "side", "--out", "x" * 300], "cannot write"),
    "endless wait": (["run", "side", "--connect", "tcp/127.0.0.1:1", "--wait", "inf"], "--wait"),
    "a number too long": (["run", "side", "--set", "seed=" + "9" * 5000], "seed: expected"),
    "commands that lapse at once": (["run", "side", "--set", "commands.valid_s=0.05"], "valid_s"),
    "too silent": (["run", "side", "--set", "surveillance.broadcast_s=2"], "silence_limit_s"),
    "no time": (["run", "side", "--latency", "soon"], "--latency: 'soon' is no time"),
    "no probability": (["run", "side", "--loss", "150%"], "'150%' is no probability"),
    "burst of no loss": (["run", "side", "--burst", "5"], "--burst: needs --loss"),
    "one group": (["run", "side", "--partition", "1,2"], "(groups): expected two groups or more"),
    "too narrow": (["run", "converge", "--set", "generate.radius_m=300"], "start 300 m apart"),
}


def complain(arguments: list[str], capfd: pytest.CaptureFixture[str], folder: Path) -> str:
    """The one line that wrong arguments bring; nothing else must come of them.

    No signal that is blocked from then on either: whatever is started later would not hear it.
    """
    before, blocked = sorted(folder.iterdir()), signal.pthread_sigmask(signal.SIG_BLOCK, [])
    sys.argv = ["fleet", *arguments]
    with pytest.raises(SystemExit) as ended:
        main()
    out, err = capfd.readouterr()
    assert ended.value.code == 2
    assert out == ""
    assert err.startswith("fleet: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    assert sorted(folder.iterdir()) == before
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == blocked
    return err


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", sys.argv)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    (tmp_path / "there.mcap").write_text("something")
    return tmp_path


@pytest.mark.parametrize("case", FILES)
def test_a_broken_scenario(case: str, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text, words = FILES[case]
    (folder / "broken.toml").write_text(text)
    line = complain(["run", "broken.toml"], capfd, folder)
    assert words in line
    assert "broken.toml" in line


@pytest.mark.parametrize("case", LINES)
def test_a_wrong_command_line(case: str, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments, words = LINES[case]
    assert words in complain(arguments, capfd, folder)


NO_TEXT = {
    "binary": (b"\x89\xfe\x00\x80" * 20, "broken.toml: not a text file in UTF-8"),
    "UTF-16": (GOOD.encode("utf-16"), "broken.toml: text in UTF-16; save it as UTF-8"),
    "UTF-16, the other way": (
        codecs.BOM_UTF16_BE + GOOD.encode("utf-16-be"),
        "broken.toml: text in UTF-16",
    ),
    "UTF-32": (GOOD.encode("utf-32"), "broken.toml: text in UTF-32; save it as UTF-8"),
    "huge": (b"#" * (5 << 20), "broken.toml: too large for a scenario, over 4 MiB"),
    "empty": (b"", "broken.toml: name: missing"),
}


@pytest.mark.parametrize("case", NO_TEXT)
def test_a_scenario_that_is_no_text(
    case: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text, words = NO_TEXT[case]
    (folder / "broken.toml").write_bytes(text)
    assert words in complain(["run", "broken.toml"], capfd, folder)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "pipe"])
def test_a_scenario_that_is_no_file(
    device: str, folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(folder / "pipe")
    line = complain(["run", device], capfd, folder)
    assert f"{device}: a device or a pipe, no file; name a TOML file" in line


def test_a_byte_order_mark_is_no_part_of_a_scenario(folder: Path) -> None:
    text = GOOD.replace("\n", "\r\n")
    (folder / "windows.toml").write_bytes(codecs.BOM_UTF8 + text.encode())
    (folder / "plain.toml").write_text(GOOD)
    windows, plain = read_scenario("windows.toml"), read_scenario("plain.toml")
    assert (windows.scenario, windows.text) == (plain.scenario, plain.text)


def test_a_taken_port(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from fleet.transport.zenoh_session import open_router

    session, where = open_router("tcp/127.0.0.1:0")
    try:
        assert "address already in use" in complain(["router", "--listen", where], capfd, folder)
    finally:
        session.close()


@pytest.mark.parametrize("arguments", [["scenarios"], ["--help"], ["run", "--help"]])
def test_a_full_disk_behind_standard_output_is_one_line(arguments: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "fleet", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.stderr == "fleet: cannot write the output: No space left on device\n"
    assert done.returncode == 1
