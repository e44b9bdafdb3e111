"""Making the certificates of a fleet: an authority, and one for each role and UAV.

Only here and in `checking` is the library `cryptography` needed (the extra `secure`).
"""

from __future__ import annotations

import ipaddress
import os
import secrets
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fleet.errors import SecurityError
from fleet.security.identity import CA, LISTENING, ROLES, certificate_name

LOCAL_HOSTS = ("127.0.0.1", "::1", "localhost")
CLOCK_TOLERANCE = timedelta(hours=1)
"""A certificate is valid from so long before it is made: clocks of hosts differ."""


@dataclass(frozen=True)
class MadeFile:
    """A certificate with its key in a folder; `made` is false if it was there before."""

    path: Path
    until: datetime
    made: bool


def make_certificates(
    folder: Path, uavs: Sequence[int], hosts: Sequence[str], days: float, now_unix_s: float
) -> list[MadeFile]:
    """Make what is not there yet, valid for so many days.

    Routers' certificates are for `hosts` (names or IP addresses) and for this machine.

    Raises:
        SecurityError: the folder cannot be written to, or half of a pair is missing.

    """
    now = datetime.fromtimestamp(now_unix_s, UTC)
    valid = now - CLOCK_TOLERANCE, now + timedelta(days=days)
    names = [*ROLES, *(certificate_name(str(number)) for number in uavs)]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        return list(_made(folder, names, hosts, valid))
    except OSError as error:
        raise SecurityError(f"cannot write to {folder}: {error.strerror}") from error


def _made(
    folder: Path, names: Sequence[str], hosts: Sequence[str], valid: tuple[datetime, datetime]
) -> Iterator[MadeFile]:
    pair = _there(folder, CA)
    new = pair is None
    ca, ca_key = pair or _authority(folder, valid)
    yield MadeFile(folder / f"{CA}.pem", ca.not_valid_after_utc, new)
    until = min(valid[1], ca.not_valid_after_utc)
    for name in names:
        before = _there(folder, name)
        if before is not None:
            yield MadeFile(folder / f"{name}.pem", before[0].not_valid_after_utc, made=False)
            continue
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(name, ca.subject, key.public_key(), (valid[0], until))
        purposes = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if name in LISTENING:
            purposes.append(ExtendedKeyUsageOID.SERVER_AUTH)
            names_of_host = dict.fromkeys((*LOCAL_HOSTS, *hosts))
            alternative = x509.SubjectAlternativeName([_host(host) for host in names_of_host])
            builder = builder.add_extension(alternative, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        basic = x509.BasicConstraints(ca=False, path_length=None)
        signed = builder.add_extension(basic, critical=True).sign(ca_key, hashes.SHA256())
        _write(folder, name, signed, key)
        yield MadeFile(folder / f"{name}.pem", until, made=True)


def _authority(
    folder: Path, valid: tuple[datetime, datetime]
) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    key = ec.generate_private_key(ec.SECP256R1())
    # a name of its own: or two authorities are told apart by their signatures alone
    own = f"fleet authority {secrets.token_hex(8)}"
    issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, own)])
    builder = _builder(own, issuer, key.public_key(), valid)
    basic = x509.BasicConstraints(ca=True, path_length=0)
    usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    builder = builder.add_extension(basic, critical=True).add_extension(usage, critical=True)
    signed = builder.sign(key, hashes.SHA256())
    _write(folder, CA, signed, key)
    return signed, key


def _builder(
    name: str, issuer: x509.Name, key: ec.EllipticCurvePublicKey, valid: tuple[datetime, datetime]
) -> x509.CertificateBuilder:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    identifier = x509.SubjectKeyIdentifier.from_public_key(key)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(issuer)
    builder = builder.public_key(key).serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(valid[0]).not_valid_after(valid[1])
    return builder.add_extension(identifier, critical=False)


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _there(folder: Path, name: str) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey] | None:
    """A pair that was made before; the key of an authority is needed, others only have to be."""
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    if not certificate.exists() and not key.exists():
        return None
    if not certificate.exists() or not key.exists():
        missing, other = (key, certificate) if certificate.exists() else (certificate, key)
        raise SecurityError(
            f"{missing} is missing beside {other}; nothing is overwritten: remove that too, "
            "or bring the other back"
        )
    try:
        private = serialization.load_pem_private_key(key.read_bytes(), None)
        loaded = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (ValueError, TypeError) as error:
        raise SecurityError(f"{certificate} or {key} is no PEM file of its kind") from error
    if not isinstance(private, ec.EllipticCurvePrivateKey):
        raise SecurityError(f"{key} is no key of an elliptic curve, as 'fleet certs' makes them")
    return loaded, private


def _write(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> None:
    """The key first, and for its owner alone from the beginning; nothing is overwritten."""
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public = certificate.public_bytes(serialization.Encoding.PEM)
    for end, content, mode in ((".key", private, 0o600), (".pem", public, 0o644)):
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        with os.fdopen(os.open(folder / f"{name}{end}", flags, mode), "wb") as file:
            file.write(content)
