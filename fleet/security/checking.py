"""What is wrong with a certificate, found before anybody connects with it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import NameOID

from fleet.errors import SecurityError
from fleet.security.identity import Identity


def check_identities(identities: Iterable[Identity], now_unix_s: float) -> None:
    """Whether certificates, of one folder, can be shown at a time.

    Raises:
        SecurityError: one is missing, expired, of another authority, of somebody else, or not
            that of its key.

    """
    now = datetime.fromtimestamp(now_unix_s, UTC)
    ca: x509.Certificate | None = None
    for identity in identities:
        if not identity.folder.is_dir():
            raise SecurityError(f"no folder {identity.folder}; make it with 'fleet certs'")
        if ca is None:
            ca = _loaded(identity.ca, "the certificate of the authority")
            _check_time(identity.ca, ca, now)
        _check(identity, ca, now)


def _check(identity: Identity, ca: x509.Certificate, now: datetime) -> None:
    path = identity.certificate
    own = _loaded(path, f"the certificate of {identity.name}")
    names = own.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    told = str(names[0].value) if names else ""
    if told != identity.name:
        raise SecurityError(f"{path} is the certificate of '{told}', not of '{identity.name}'")
    try:
        own.verify_directly_issued_by(ca)
    except (ValueError, TypeError, InvalidSignature) as error:
        raise SecurityError(f"{path} is not signed by {identity.ca}, but by another") from error
    _check_time(path, own, now)
    try:
        key = serialization.load_pem_private_key(_content(identity.key, "the private key"), None)
    except (ValueError, TypeError) as error:
        raise SecurityError(
            f"{identity.key} is no private key in PEM without a password"
        ) from error
    if _public(key.public_key()) != _public(own.public_key()):
        raise SecurityError(f"{identity.key} is not the key of {path}, but of another")


def _public(key: object) -> bytes:
    encoding, form = serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    return bytes(key.public_bytes(encoding, form))  # type: ignore[attr-defined]


def _check_time(path: Path, certificate: x509.Certificate, now: datetime) -> None:
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > end:
        raise SecurityError(
            f"{path} has expired at {end:%Y-%m-%d %H:%M} UTC; remove it with its key and make "
            "another with 'fleet certs'"
        )
    if now < begin:
        raise SecurityError(f"{path} is valid from {begin:%Y-%m-%d %H:%M} UTC: is a clock wrong?")


def _loaded(path: Path, what: str) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(_content(path, what))
    except ValueError as error:
        raise SecurityError(f"{path} is no certificate in PEM") from error


def _content(path: Path, what: str) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise SecurityError(
            f"{path.parent} has no {path.name}, {what}; make it with 'fleet certs {path.parent}', "
            "or copy it from there"
        ) from error
    except OSError as error:
        raise SecurityError(f"cannot read {path}, {what}: {error.strerror}") from error
