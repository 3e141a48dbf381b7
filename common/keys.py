"""The keys and certificates of the machines: `[mesh] keys` holds a folder per role, which `deploy keys` makes.

They are checked by a TLS handshake of the certificate with itself, in memory.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from common.errors import StartError

AUTHORITY = "authority.pem"
CERTIFICATE = "certificate.pem"
PRIVATE_KEY = "private_key.pem"
COMMAND_KEY = "command_key"
COMMAND_KEY_BYTES = 32
COMMAND_ROLES = ("robot", "command_center")  # who signs and who checks

_MAKE = "make the keys of all machines with `indoor-mapping deploy keys` and copy the folder {role} here"
_NOT_YET_VALID, _EXPIRED = 9, 10  # OpenSSL's X509_V_ERR_*


def checked_folder(keys: Path, role: str) -> Path:
    """The folder of a role, whose certificate can serve; raises StartError with what to do where it cannot."""
    folder = _folder(keys, role)
    make = _MAKE.format(role=role)
    for name in (AUTHORITY, CERTIFICATE, PRIVATE_KEY):
        _read(folder / name, make)
    problem = _problem(folder, make)
    if problem:
        raise StartError(problem)
    return folder


def read_command_key(keys: Path, role: str) -> bytes:
    """The key that commands are signed with; raises StartError."""
    file = _folder(keys, role) / COMMAND_KEY
    make = _MAKE.format(role=role)
    key = _read(file, make)
    if len(key) != COMMAND_KEY_BYTES:
        raise StartError(f"{file} is no command key, it has {len(key)} bytes and not {COMMAND_KEY_BYTES}: {make}.")
    return key


def _folder(keys: Path, role: str) -> Path:
    return Path(os.path.expanduser(keys)) / role  # a ~ of an unknown user stays as it is, and is not found


def _read(file: Path, make: str) -> bytes:
    try:
        return file.read_bytes()
    except FileNotFoundError as error:
        raise StartError(f"{file} is missing: {make}.") from error
    except OSError as error:
        raise StartError(
            f"{file} cannot be read: {error.strerror}; it must belong to who runs this program."
        ) from error


def _problem(folder: Path, make: str) -> str:
    """Why a certificate cannot serve, as one sentence; empty when it can."""
    # 4 MB of memory, which a board without keys spares
    import ssl

    certificate = folder / CERTIFICATE
    server, client = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        # An empty password: OpenSSL must not prompt for the password of a locked key on the terminal
        server.load_cert_chain(certificate, folder / PRIVATE_KEY, password="")
        client.load_verify_locations(folder / AUTHORITY)
        caller = client.wrap_bio(to_client, to_server)
        called = server.wrap_bio(to_server, to_client, server_side=True)
        for end in (caller, called, caller):
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    except ssl.SSLCertVerificationError as error:
        if error.verify_code == _NOT_YET_VALID:
            return f"The certificate {certificate} is not valid yet: set this machine's clock."
        if error.verify_code == _EXPIRED:
            return f"The certificate {certificate} has expired: {make}."
        return f"The certificate {certificate} is not of the authority in {folder / AUTHORITY}: {make}."
    except ssl.SSLError:
        return f"{certificate}, {PRIVATE_KEY} and {AUTHORITY} beside it do not fit together: {make}."
    return ""
