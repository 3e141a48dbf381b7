"""A small certificate authority: one certificate per role, and the key that commands are signed with.

The authority's own key is not kept, so no certificate can be added later: for another one all are made anew.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from common.access import ROLES
from common.errors import StartError
from common.keys import AUTHORITY, CERTIFICATE, COMMAND_KEY, COMMAND_KEY_BYTES, COMMAND_ROLES, PRIVATE_KEY

VALID_FROM = datetime(2000, 1, 1, tzinfo=UTC)  # a board without a clock battery starts years ago
VALID_FOR = timedelta(days=3650)
_AUTHORITY_NAME = "indoor-mapping"
_HOST_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(\.[A-Za-z0-9-]{1,63})*")


def make_keys(folder: Path, hosts: Mapping[str, Sequence[str]], *, replace: bool, until: datetime) -> None:
    """A folder per role below `folder`; `hosts`: role -> names and addresses under which others connect to it.

    Raises StartError when there are keys already and `replace` is false, and for a host that is none; OSError.
    """
    names = {role: [_host(host) for host in hosts.get(role, ())] for role in ROLES}
    found = [role for role in ROLES if (folder / role / AUTHORITY).exists()]
    if found and not replace:
        raise StartError(
            f"{folder} holds keys already ({', '.join(found)}): with --replace all machines need their new ones."
        )
    key = ec.generate_private_key(ec.SECP256R1())
    authority = _authority(key, until)
    command_key = secrets.token_bytes(COMMAND_KEY_BYTES)
    folder.mkdir(parents=True, exist_ok=True)
    for role, alternatives in names.items():
        own = ec.generate_private_key(ec.SECP256R1())
        certificate = _certificate(role, alternatives, own, key, until)
        home = folder / role
        home.mkdir(mode=0o700, exist_ok=True)
        _write(home / AUTHORITY, authority.public_bytes(serialization.Encoding.PEM))
        _write(home / CERTIFICATE, certificate.public_bytes(serialization.Encoding.PEM))
        _write(home / PRIVATE_KEY, _pem(own))
        if role in COMMAND_ROLES:
            _write(home / COMMAND_KEY, command_key)


def _host(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(text))
    except ValueError:
        if _HOST_NAME.fullmatch(text) is None:
            raise StartError(f"{text!r} is neither the name nor the address of a machine.") from None
        return x509.DNSName(text)


def _builder(role: str, own: ec.EllipticCurvePrivateKey, until: datetime) -> x509.CertificateBuilder:
    return x509.CertificateBuilder(
        issuer_name=x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, _AUTHORITY_NAME)]),
        subject_name=x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, role)]),
        public_key=own.public_key(),
        serial_number=x509.random_serial_number(),
        not_valid_before=VALID_FROM,
        not_valid_after=until,
    )


def _authority(key: ec.EllipticCurvePrivateKey, until: datetime) -> x509.Certificate:
    use = dict.fromkeys(
        ("digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement"), False
    )
    use |= {"key_cert_sign": True, "crl_sign": True, "encipher_only": False, "decipher_only": False}
    builder = _builder(_AUTHORITY_NAME, key, until)
    builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
    builder = builder.add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    return builder.add_extension(x509.KeyUsage(**use), critical=True).sign(key, hashes.SHA256())


def _certificate(
    role: str,
    alternatives: Sequence[x509.GeneralName],
    own: ec.EllipticCurvePrivateKey,
    key: ec.EllipticCurvePrivateKey,
    until: datetime,
) -> x509.Certificate:
    both_sides = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    builder = _builder(role, own, until)
    builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
    builder = builder.add_extension(both_sides, critical=False)
    by = x509.AuthorityKeyIdentifier.from_issuer_public_key(key.public_key())
    builder = builder.add_extension(by, critical=False)
    if alternatives:
        builder = builder.add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
    return builder.sign(key, hashes.SHA256())


def _pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _write(file: Path, data: bytes) -> None:
    file.unlink(missing_ok=True)
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as stream:
        stream.write(data)
