"""`fleet replay` over real zenoh, heard by a subscriber that knows nothing of this code."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from fleet.config.loading import packaged
from fleet.log.reader import read, summarise
from fleet.log.recorder import LogRecorder
from fleet.transport.zenoh_session import open_router
from tests.conftest import Cli
from tests.support.replay_tools import Ear, Terminal, expected, logged, told, until

SHORT = {"crossing": "1", "converge": "2"}


@pytest.fixture
def router() -> Iterator[str]:
    session, endpoint = open_router("tcp/127.0.0.1:0")
    yield endpoint
    session.close()


@pytest.mark.parametrize("name", packaged())
def test_a_replay_is_the_log_message_for_message(
    cli: Cli, tmp_path: Path, router: str, name: str
) -> None:
    log = tmp_path / "run.mcap"
    run = logged(log, name, SHORT.get(name, "5"))
    with Ear(router, f"fleet/{run}/**") as listener:
        report = told(cli.run("replay", str(log), "-r", "50", "--connect", router, "--json"))
        sent = expected(log, run)
        until(lambda: len(listener.heard) >= len(sent))
        assert listener.heard == sent
    assert report["messages"] == len(sent) == summarise(log).messages.total()
    assert report["payload_bytes"] == sum(len(payload) for _, payload in sent)
    assert report["timing_error_s"].keys() == {"p50", "p99", "max"}


def test_at_rate_1_a_replay_takes_as_long_as_the_run(cli: Cli, tmp_path: Path, router: str) -> None:
    log = tmp_path / "run.mcap"
    run = logged(log, "head_on", "2")
    with Ear(router, f"fleet/{run}/**") as listener:
        report = told(cli.run("replay", str(log), "--connect", router, "--json"))
        sent = expected(log, run)
        until(lambda: len(listener.heard) >= len(sent))
        assert listener.heard == sent
    assert report["duration_s"] >= 2.0 - report["timing_error_s"]["max"]


def test_a_part_under_other_names_with_a_clock(cli: Cli, tmp_path: Path, router: str) -> None:
    log = tmp_path / "run.mcap"
    logged(log, "head_on", "3")
    with Ear(router, "fleet/other/**") as listener:
        part = ("--start-offset", "1", "--playback-duration", "1", "-r", "5")
        names = ("--topics", "*/adsb/**,*/truth", "--exclude-topics", "2/*", "-m", "1/**:=9/**")
        clock = ("--clock", str(log), "--run", "other", "--connect", router, "--json")
        report = told(cli.run("replay", *part, *names, *clock))
        wanted = [
            (f"fleet/other/9{r.topic[1:]}", r.payload)
            for r in read(log)
            if r.topic in ("1/adsb/0", "2/adsb/0", "1/truth")
            and 1_000_000_000 <= r.log_ns <= 2_000_000_000
        ]
        wanted = [
            (k.replace("9/adsb/0", "2/adsb/0"), p) if _issuer(p) == 2 else (k, p) for k, p in wanted
        ]
        until(lambda: len(listener.heard) >= len(wanted) + 2)
        ticking = [p for k, p in listener.heard if k == "fleet/other/replay/clock"]
        assert [h for h in listener.heard if h[0] != "fleet/other/replay/clock"] == wanted
    assert report["messages"] == len(wanted) == 11 + 2 * 6
    times = [msgspec.msgpack.decode(payload) for payload in ticking]
    assert times[0].keys() == {"t_ns", "rate", "paused", "round"}
    assert [t["t_ns"] for t in times] == sorted(t["t_ns"] for t in times)
    assert all(t["t_ns"] >= 1_000_000_000 for t in times)


def _issuer(payload: bytes) -> int:
    return int(msgspec.msgpack.decode(payload)["id"])


def test_a_slow_subscriber_gets_everything_in_the_end(cli: Cli, tmp_path: Path) -> None:
    """It is neither cut off nor left without what is queued for it when the replay is over."""
    log = tmp_path / "big.mcap"
    with LogRecorder(log, overwrite=False) as recorder:
        recorder.metadata("run", {"run": "big"})
        for n in range(120):
            recorder.write("1/truth", bytes([n]) * 100_000, n, n, n)
    with Terminal(cli, str(log), "-p", "--json") as replay:
        endpoint = replay.endpoint()
        with Ear(endpoint, "fleet/big/**", slow_s=0.045) as listener:
            replay.press(b" ")
            until(lambda: len(listener.heard) >= 120 or replay.ended())
            assert replay.process.wait(timeout=60) == 0
            until(lambda: len(listener.heard) >= 120)
            assert [payload[0] for _, payload in listener.heard] == list(range(120))


@pytest.fixture
def small(tmp_path: Path) -> tuple[Path, str]:
    """A log of a moment, and the name of its run."""
    log = tmp_path / "run.mcap"
    return log, logged(log, "head_on", "0.4")


def test_keys_step_and_resume_and_the_terminal_is_given_back(
    cli: Cli, small: tuple[Path, str]
) -> None:
    log, run = small
    sent = expected(log, run)
    with (
        Terminal(cli, str(log), "-p") as replay,
        Ear(replay.endpoint(), f"fleet/{run}/**") as listener,
    ):
        assert replay.settings() != replay.before
        for n in (1, 2, 3):
            replay.press(b"\x1b[C")
            assert sent[n - 1][0].removeprefix(f"fleet/{run}/") in replay.line()
            until(lambda n=n: len(listener.heard) == n)  # type: ignore[misc]
        replay.press(b"\x1b[A")
        assert "rate 1.1" in replay.line()
        replay.press(b"\x1b[B ")
        assert "rate 0.99" in replay.line()
        assert "going on" in replay.line()
        assert replay.process.wait(timeout=60) == 0
        until(lambda: len(listener.heard) >= len(sent))
        assert listener.heard == sent
        assert replay.settings() == replay.before


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_replay_says_so_and_gives_the_terminal_back(
    cli: Cli, small: tuple[Path, str], sent: signal.Signals
) -> None:
    log, _ = small
    with Terminal(cli, str(log), "-p") as replay:
        replay.endpoint()
        replay.process.send_signal(sent)
        out, err = replay.process.communicate(timeout=60)
        assert replay.process.returncode == 130
        assert (out, err.count("\n")) == ("", 1)
        assert err.startswith("fleet: interrupted")
        assert replay.settings() == replay.before


def test_a_loop_goes_round_until_it_is_interrupted(
    cli: Cli, small: tuple[Path, str], router: str
) -> None:
    log, run = small
    sent = expected(log, run)
    with Ear(router, f"fleet/{run}/**") as listener:
        replay = cli.start("replay", str(log), "--loop", "-r", "10", "--connect", router, "--json")
        until(lambda: len(listener.heard) > 3 * len(sent))
        os.kill(replay.pid, signal.SIGINT)
        out, err = replay.communicate(timeout=60)
        assert replay.returncode == 130
        assert err.splitlines()[1].startswith("fleet: interrupted after")
        assert json.loads(out)["status"] == "interrupted"
        assert json.loads(out)["rounds"] >= 4
        assert listener.heard[: 3 * len(sent)] == 3 * sent


def test_a_router_that_goes_ends_the_replay_with_one_line(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    logged(log, "head_on", "60")
    router = cli.start("router", "--listen", "tcp/127.0.0.1:0")
    assert router.stderr is not None
    endpoint = router.stderr.readline().split()[-1]
    replay = cli.start("replay", str(log), "--connect", endpoint)
    assert replay.stderr is not None
    assert "replaying as run" in replay.stderr.readline()
    os.kill(router.pid, signal.SIGKILL)
    _, err = replay.communicate(timeout=60)
    assert replay.returncode == 2
    assert err.splitlines() == [
        f"fleet: the zenoh router at {endpoint} has gone; what was replayed since is lost"
    ]


def test_a_log_that_is_cut_is_replayed_up_to_there(cli: Cli, tmp_path: Path) -> None:
    log, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    logged(log, "head_on", "5")
    cut.write_bytes(log.read_bytes()[: log.stat().st_size - 400])
    done = cli.run("replay", str(cut), "-r", "100", "--topics", "1/*,7/*")
    assert done.returncode == 0
    assert done.stderr.splitlines()[1:] == [
        f"fleet: {cut} is cut short or damaged: that was all up to there",
        "fleet: no message was concerned by '7/*'",
    ]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-p"], "--start-paused needs a terminal"),
        (["--topics", "a//b"], "is no key expression"),
        (["-m", "a=b"], "is no remapping"),
        (["--run", "a/b"], "cannot be part of a key"),
        (["--rate", "0"], "greater than or equal to 0.001"),
        (["--rate", "nan"], "should be"),
        (["--delay", "inf"], "should be"),
        (["--start-offset", "99"], "the log lasts 0.4 s"),
        (["--topics", "x/**"], "no message in this part of the log is of the topics chosen"),
        (["--connect", "tcp/127.0.0.1:1", "--wait", "0.2"], "no zenoh router answers"),
        (["--listen", "nonsense"], "is no endpoint"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    cli: Cli, small: tuple[Path, str], arguments: list[str], says: str
) -> None:
    done = cli.run("replay", str(small[0]), *arguments)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
    assert done.stdout == ""
    assert "Traceback" not in done.stderr


def test_a_log_that_names_no_run_needs_a_name(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "x.mcap"
    with LogRecorder(log, overwrite=False) as recorder:
        recorder.write("1/truth", b"x", 0, 0, 0)
    done = cli.run("replay", str(log))
    assert done.returncode == 2
    assert "names no run" in done.stderr
    assert told(cli.run("replay", str(log), "--run", "x", "--json"))["messages"] == 1
