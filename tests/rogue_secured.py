"""The attacks of `tests.rogue` under `--secure`: what passes the router with which certificate.

The last tables of `python -m tests.rogue`. One run for each clock takes all attacks, each with the
certificates of a participant, of a UAV that does not take part, of an operator and of an observer;
an honest observer beside them tells what the router let through.
"""

from __future__ import annotations

import json
import queue
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import zenoh

from fleet.errors import BusError
from fleet.protocol.codec import encode
from fleet.protocol.topics import FAULT, PLAN, alive, issuer_of, key
from fleet.security.certificates import make_certificates
from fleet.security.identity import OBSERVER, OPERATOR, Identity, certificate_name
from fleet.transport.zenoh_session import SessionOptions, open_client
from tests.conftest import Cli
from tests.rogue import AHEAD, ATTACKS, CLOCKS, DEEP, Attack, listed_run, until
from tests.support.samples import adsb

Session = Any
MEMBER, ABSENT = "uav-2", "uav-7"
ATTACKERS = (MEMBER, ABSENT, OPERATOR, OBSERVER)
OPENING_S = 10.0
REFUSED_S = 0.5
"""It is looked into after this time why a router does not answer."""
DURATION_S = 8
ASKING_S = 1.0
DAY_S = 86_400.0
BROADCAST = encode(adsb(1, seq=AHEAD))


@dataclass(frozen=True)
class SecuredRun:
    """A run of `head_on` with certificates, where it is, and what an honest observer hears."""

    folder: Path
    process: subprocess.Popen[str]
    name: str
    endpoint: str
    heard: queue.SimpleQueue[tuple[str, bytes]]
    seen: list[tuple[str, bytes]] = field(default_factory=list)

    def opened(self, certificate: str) -> Session:
        """A session with a certificate of the fleet."""
        identity = Identity(self.folder / "certs", certificate)
        return open_client(self.endpoint, OPENING_S, SessionOptions(identity))

    def came(self) -> list[tuple[str, bytes]]:
        """What the observer has heard since the last call."""
        found = [*self.seen]
        self.seen.clear()
        with suppress(queue.Empty):
            while True:
                found.append(self.heard.get_nowait())
        return found

    def next_truth(self) -> None:
        """Wait until UAV 2 has said something that the observer hears: all before has come too."""
        while (message := self.heard.get(timeout=30.0))[0] != "2/truth":
            self.seen.append(message)

    def ended(self) -> dict[str, Any]:
        """The result of the run."""
        out, error = self.process.communicate(timeout=60)
        result: dict[str, Any] = json.loads(out)
        assert self.process.returncode == 0, error
        return result


@contextmanager
def secured_run(cli: Cli, clock: str) -> Iterator[SecuredRun]:
    """Start it, and an observer beside it; both end with the context."""
    make_certificates(cli.folder / "certs", [1, 2, 7], [], 1.0, time.time())
    paced = ("--speed", "1") if clock == "lockstep" else ()
    words = ("run", "head_on", "--clock", clock, "--duration", str(DURATION_S), *paced, "--json")
    where = {"XDG_RUNTIME_DIR": str(cli.folder)}
    process = cli.start(*words, "--force", "--out", "run.mcap", "--secure", "certs", **where)
    name, endpoint = until(lambda: listed_run(cli.folder), process)
    heard: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    run = SecuredRun(cli.folder, process, name, endpoint, heard)

    def note(sample: Any) -> None:
        topic = str(sample.key_expr).split("/", 2)[2]
        heard.put((topic, sample.payload.to_bytes()))

    with closing(run.opened(OBSERVER)) as observer:
        watch = observer.declare_subscriber(f"fleet/{name}/**", note)
        try:
            yield run
        finally:
            watch.undeclare()


def put(session: Session, run: str, attack: Attack) -> None:
    """Put an attack on the bus."""
    where, wait = f"fleet/{run}/{attack.topic}", zenoh.CongestionControl.BLOCK
    if attack.payload is None:
        session.delete(where, congestion_control=wait)
    else:
        session.put(where, attack.payload, attachment=attack.mark, congestion_control=wait)


def passed(run: SecuredRun) -> dict[str, list[str]]:
    """Which attacks, by name, the router let through with which certificates."""
    through: dict[str, list[str]] = {name: [] for name in ATTACKS}
    for attacker in ATTACKERS:
        run.next_truth()
        run.came()
        with closing(run.opened(attacker)) as session:
            tried = [n for n, a in ATTACKS.items() if attacker != _certificate(a)]
            for name in tried:
                put(session, run.name, ATTACKS[name])
        run.next_truth()
        run.next_truth()
        came = run.came()
        for name in tried:
            attack = ATTACKS[name]
            if (attack.topic, attack.payload or b"") in came:
                through[name].append(attacker)
    return through


def _certificate(attack: Attack) -> str:
    """Whose certificate allows it: who attacks in his own name is no rogue at the router."""
    return certificate_name(issuer_of(attack.topic))


# What is not a message


def _steals_a_token(session: Session, run: SecuredRun) -> str:
    for name in ("1", "sim"):  # if a token of the simulation vanished, all would end
        session.liveliness().declare_token(key(run.name, alive(name))).undeclare()
    return ""


def _changes_faults(session: Session, run: SecuredRun) -> str:
    replies = session.get(key(run.name, FAULT), payload=b'{"clear": true}', timeout=ASKING_S)
    return "answered" if any(reply.ok is not None for reply in replies) else ""


def _tells_a_plan(session: Session, run: SecuredRun) -> str:
    own = key(run.name, PLAN)
    telling = session.declare_queryable(own, lambda query: query.reply(own, b"{}"))
    with closing_declared(telling), closing(run.opened(ABSENT)) as asking:
        replies = asking.get(own, timeout=ASKING_S)
        return "believed" if any(reply.ok is not None for reply in replies) else ""


def _listens_to_truth(session: Session, run: SecuredRun) -> str:
    heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
    with closing_declared(session.declare_subscriber(key(run.name, "*/truth"), heard.put)):
        run.next_truth()
        run.next_truth()
    return "" if heard.empty() else "heard"


@contextmanager
def closing_declared(declared: Any) -> Iterator[None]:
    """Undeclare at the end."""
    try:
        yield
    finally:
        declared.undeclare()


ACTS: dict[str, tuple[str, Callable[[Session, SecuredRun], str]]] = {
    "a token in another's name, withdrawn": (MEMBER, _steals_a_token),
    "a change of faults by an observer": (OBSERVER, _changes_faults),
    "a plan by a UAV": (MEMBER, _tells_a_plan),
    "true states heard by a UAV": (MEMBER, _listens_to_truth),
}
"""By which certificate, and what comes of it: empty if nothing does."""


def nested_request(run: SecuredRun) -> str:
    """What an operator, who may ask, gets for a request nested 2,000 deep."""
    with closing(run.opened(OPERATOR)) as session:
        replies = session.get(key(run.name, FAULT), payload=DEEP, timeout=10.0)
        (answer,) = [json.loads(r.ok.payload.to_bytes()) for r in replies if r.ok is not None]
    return str(answer["problem"])


# Links


def _no_tls(run: SecuredRun) -> str:
    endpoint = run.endpoint.replace("tls/", "tcp/")
    return _refused(endpoint, None)


def _no_certificate(run: SecuredRun) -> str:
    """TLS is offered, and no certificate shown."""
    context = ssl.create_default_context(cafile=run.folder / "certs" / "ca.pem")
    host, port = run.endpoint.removeprefix("tls/").rsplit(":", 1)
    try:
        with (
            socket.create_connection((host, int(port)), timeout=5.0) as link,
            context.wrap_socket(link, server_hostname=host) as secured,
        ):
            return "taken" if secured.recv(1) else "closed"
    except ssl.SSLError as error:
        return str(error.reason).lower().replace("_", " ")


def _self_signed(run: SecuredRun) -> str:
    """Its own authority has signed it; it trusts the router's."""
    other = run.folder / "other"
    make_certificates(other, [1, 2], [], 1.0, time.time())
    (other / "ca.pem").write_bytes((run.folder / "certs" / "ca.pem").read_bytes())
    return _refused(run.endpoint, Identity(other, "uav-1"))


def _expired(run: SecuredRun) -> str:
    """It has run out, and its authority has not."""
    old, certs = run.folder / "old", run.folder / "certs"
    old.mkdir()
    for name in ("ca.pem", "ca.key"):
        (old / name).write_bytes((certs / name).read_bytes())
    make_certificates(old, [1], [], 1.0, time.time() - 2 * DAY_S)
    return _refused(run.endpoint, Identity(old, "uav-1"))


def _listener_without_right(run: SecuredRun) -> str:
    """A router with a UAV's certificate: whoever connects does not take it for one."""
    certs = run.folder / "certs"
    script = (
        "import socket, ssl, sys; c = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER);"
        "c.load_cert_chain(sys.argv[1], sys.argv[2]); s = socket.create_server(('127.0.0.1', 0));"
        "print(s.getsockname()[1], flush=True)\n"
        "while True:\n"
        "    try: c.wrap_socket(s.accept()[0], server_side=True)\n"
        "    except OSError: pass\n"
    )
    words = (sys.executable, "-c", script, certs / "uav-2.pem", certs / "uav-2.key")
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            endpoint = f"tls/127.0.0.1:{server.stdout.readline().strip()}"
            return _refused(endpoint, Identity(certs, "uav-1"))
        finally:
            server.kill()


def _refused(endpoint: str, identity: Identity | None) -> str:
    """What is told to somebody who connects there with this certificate."""
    try:
        open_client(endpoint, REFUSED_S, SessionOptions(identity)).close()
    except BusError as error:
        return str(error)
    return "taken"


LINKS: dict[str, tuple[Callable[[SecuredRun], str], str]] = {
    "without TLS": (_no_tls, "takes TLS alone"),
    "without a certificate": (_no_certificate, "certificate required"),
    "self-signed certificate": (_self_signed, "its authority is another one"),
    "expired certificate": (_expired, "it has expired"),
    "router with a UAV's certificate": (_listener_without_right, "not one of a router"),
}
"""What is tried, and what is told of it."""


def print_secured() -> int:
    """Print both tables; how many attacks went through."""
    bad, cells = 0, dict[str, list[str]]()
    for clock in CLOCKS:
        with TemporaryDirectory() as folder:
            cli = Cli(Path(folder))
            try:
                for name, told in secured_outcomes(cli, clock).items():
                    cells.setdefault(name, []).append(told)
                    bad += not told.startswith("refused")
            finally:
                cli.end()
    print(f"\n| with `--secure` | {' | '.join(CLOCKS)} |\n|---|---|---|")
    for name, row in cells.items():
        print(f"| {name} | {' | '.join(row)} |")
    return bad


def secured_outcomes(cli: Cli, clock: str) -> dict[str, str]:
    """What became of every attack in one run, which ends as if there had been none."""
    out: dict[str, str] = {}
    with secured_run(cli, clock) as run:
        for name, through in passed(run).items():
            out[name] = f"SILENT: let through by {', '.join(through)}" if through else "refused"
        for name, (certificate, act) in ACTS.items():
            with closing(run.opened(certificate)) as session:
                told = act(session, run)
            out[name] = f"SILENT: {told}" if told else "refused"
        for name, (link, words) in LINKS.items():
            told = link(run)
            out[name] = "refused: " + words if words in told else f"SILENT: {told}"
        out["a nested request of an operator"] = f"refused: {nested_request(run)}"
        result = run.ended()
    assert result["status"] == "complete", result
    assert result["rejected"] == [], result["rejected"]
    checked = cli.run("check", "run.mcap", "--json")
    assert json.loads(checked.stdout)["verdict"] != "invalid", checked.stdout
    if clock == "lockstep":
        quiet = cli.run(
            "run", "head_on", "--duration", str(DURATION_S), "--bus", "memory", "--json"
        )
        assert json.loads(quiet.stdout)["digest"] == result["digest"]
    return out
