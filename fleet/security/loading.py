"""Who this process is, once its certificate has been looked at: `--secure DIR`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from fleet.extras import import_extra
from fleet.security.identity import Identity, certificate_name


def checked_identity(folder: str, now_unix_s: float, *issuers: str) -> Identity | None:
    """The identity of the first of these names in keys, or roles; None without a folder.

    The certificates of all are looked at: of those too who are started from here.

    Raises:
        SecurityError: a certificate is missing or no good.
        MissingExtraError: the library for that is not installed.

    """
    if not folder:
        return None
    place = Path(folder).absolute()
    identities = [Identity(place, certificate_name(issuer)) for issuer in issuers]
    import_extra("cryptography", "secure", "--secure")
    import_module("fleet.security.checking").check_identities(identities, now_unix_s)
    return identities[0]
