"""`fleet certs`: what it makes and leaves alone, and what is said of bad certificates."""

from __future__ import annotations

import stat
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.errors import SecurityError
from fleet.security.certificates import make_certificates
from fleet.security.checking import check_identities
from fleet.security.identity import Identity, certified_uavs
from tests.conftest import Cli

NOW_S = time.time()
DAY_S = 86_400.0


@pytest.fixture
def certs(tmp_path: Path) -> Path:
    """Certificates of two UAVs."""
    make_certificates(tmp_path / "certs", [1, 2], ["fleet.example"], 30.0, NOW_S)
    return tmp_path / "certs"


def problem(folder: Path, name: str = "uav-1", now_s: float = NOW_S) -> str:
    """What is wrong with a certificate; empty if nothing is."""
    try:
        check_identities([Identity(folder, name)], now_s)
    except SecurityError as error:
        return str(error)
    return ""


def test_everybody_has_a_good_certificate_and_a_key_of_the_own(certs: Path) -> None:
    names = {path.stem for path in certs.glob("*.pem")}
    assert names == {
        *("ca", "sim", "coordinator", "router", "operator", "observer"),
        *("uav-1", "uav-2"),
    }
    assert certified_uavs(certs) == [1, 2]
    for name in names - {"ca"}:
        assert problem(certs, name) == ""
    for name in names:
        assert stat.S_IMODE((certs / f"{name}.key").stat().st_mode) == 0o600
    assert len({(certs / f"{name}.key").read_bytes() for name in names}) == len(names)


def test_what_is_there_stays_and_what_is_new_has_the_same_authority(certs: Path) -> None:
    before = {path.name: path.read_bytes() for path in certs.iterdir()}
    files = make_certificates(certs, [1, 2, 3], [], 1000.0, NOW_S + DAY_S)
    assert [file.path.name for file in files if file.made] == ["uav-3.pem"]
    assert {name: (certs / name).read_bytes() for name in before} == before
    assert problem(certs, "uav-3", NOW_S + DAY_S) == ""
    # and nothing outlives its authority
    assert all(file.until <= files[0].until for file in files)


Spoil = Callable[[Path], object]


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda c: (c / "ca.pem").unlink(), "has no ca.pem, the certificate of the authority"),
        (lambda c: (c / "uav-1.pem").unlink(), "has no uav-1.pem, the certificate of uav-1"),
        (lambda c: (c / "uav-1.key").unlink(), "has no uav-1.key, the private key"),
        (lambda c: (c / "uav-2.key").replace(c / "uav-1.key"), "is not the key of"),
        (lambda c: (c / "uav-2.pem").replace(c / "uav-1.pem"), "the certificate of 'uav-2', not"),
        (lambda c: (c / "uav-1.pem").write_text("?"), "uav-1.pem is no certificate in PEM"),
        (lambda c: (c / "uav-1.key").write_text("?"), "uav-1.key is no private key in PEM"),
    ],
)
def test_a_bad_certificate_is_named_in_one_line(certs: Path, spoil: Spoil, told: str) -> None:
    spoil(certs)
    found = problem(certs)
    assert told in found
    assert "\n" not in found


def test_certificates_of_another_fleet_and_of_another_time_are_named(
    certs: Path, tmp_path: Path
) -> None:
    make_certificates(tmp_path / "other", [1], [], 30.0, NOW_S)
    (certs / "uav-1.pem").write_bytes((tmp_path / "other" / "uav-1.pem").read_bytes())
    assert "is not signed by" in problem(certs)
    assert "has expired at" in problem(certs, "uav-2", NOW_S + 31 * DAY_S)
    assert "is a clock wrong?" in problem(certs, "uav-2", NOW_S - DAY_S)
    assert "make it with 'fleet certs'" in problem(tmp_path / "none")


def test_half_a_pair_is_not_filled_up(certs: Path) -> None:
    (certs / "uav-2.key").unlink()
    with pytest.raises(SecurityError, match=r"uav-2\.key is missing beside .*uav-2\.pem"):
        make_certificates(certs, [1, 2, 3], [], 30.0, NOW_S)
    assert not (certs / "uav-2.key").exists()


def test_the_command_tells_what_it_made_and_until_when(cli: Cli) -> None:
    made = cli.run("certs", "certs", "--uavs", "1-2,7", "--days", "2")
    assert made.returncode == 0, made.stderr
    assert "9 certificates with their keys made" in made.stdout
    assert "the first to expire is ca.pem, on 20" in made.stdout
    again = cli.run("certs", "certs", "--uavs", "7")
    assert "nothing was changed" in again.stdout
    for bad in ("0", "3-1", "1-99999999", "x"):
        refused = cli.run("certs", "certs", "--uavs", bad)
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1), refused.stderr
