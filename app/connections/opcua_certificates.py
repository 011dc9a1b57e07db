"""Certificates of OPC UA applications: read, judged, and made where nobody else makes them.

An application is known by its own certificate, which carries its URI; most plants trust it by
copying the file, without an authority.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from asyncua.crypto.cert_gen import (
    dump_private_key_as_pem,
    generate_private_key,
    generate_self_signed_app_certificate,
)
from asyncua.crypto.uacrypto import x509_from_der
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey
from cryptography.x509.oid import ExtendedKeyUsageOID

from app.errors import counted

LEAST_BITS: Final = 2048
"""Of a key: what all the policies here ask for."""

MADE_FOR_DAYS: Final = 5 * 365
"""How long a certificate made here is valid [days]."""

SOON: Final = timedelta(days=30)
"""Before a certificate ends that is said."""

SUFFIXES: Final = frozenset({".der", ".pem", ".crt", ".cer"})
"""Of files that may be certificates."""

_PEM: Final = b"-----BEGIN"


@dataclass(frozen=True, slots=True)
class Certificate:
    """A certificate, and what is asked of it here."""

    content: x509.Certificate

    @property
    def der(self) -> bytes:
        """As it is sent; two are the same where this is."""
        return self.content.public_bytes(serialization.Encoding.DER)

    @property
    def application_uri(self) -> str | None:
        """The URI that it is for: a peer compares it with what an application says of itself."""
        try:
            names = self.content.extensions.get_extension_for_class(x509.SubjectAlternativeName)
        except (x509.ExtensionNotFound, ValueError):
            return None
        uris = names.value.get_values_for_type(x509.UniformResourceIdentifier)
        return uris[0] if uris else None

    @property
    def words(self) -> str:
        """Its subject, and the thumbprint by which people compare certificates (SHA-1)."""
        thumbprint = self.content.fingerprint(hashes.SHA1()).hex()
        return f"{self.content.subject.rfc4514_string()[:200]!r} (thumbprint {thumbprint})"

    def trouble(self, now: datetime) -> str:
        """Say why it is not valid now; empty where it is."""
        begin, end = self.content.not_valid_before_utc, self.content.not_valid_after_utc
        if now < begin:
            return f"expected a certificate that is valid now, got one from {begin:%Y-%m-%d} on"
        if now > end:
            return f"expected a certificate that is valid now, got one that ended {end:%Y-%m-%d}"
        return ""


def certificate_of(content: bytes) -> Certificate:
    """Read DER or PEM.

    Raises
    ------
    ValueError
        If it is neither.
    """
    is_pem = content.lstrip().startswith(_PEM)
    read = x509.load_pem_x509_certificate if is_pem else x509.load_der_x509_certificate
    try:
        return Certificate(read(content))
    except ValueError as why:
        raise ValueError(f"expected a certificate in DER or PEM: {why}") from None


def sent_certificate(content: bytes) -> Certificate:
    """Read what a peer sends: DER, and perhaps the certificates of who signed it behind."""
    return Certificate(x509_from_der(content))  # type: ignore[no-untyped-call]


def read_certificate(path: Path) -> Certificate:
    """Read a file; ValueError that names it."""
    try:
        return certificate_of(path.read_bytes())
    except (OSError, ValueError) as why:
        raise ValueError(f"{path}: {why}") from None


def read_key(path: Path) -> RSAPrivateKey:
    """Read a private key; ValueError that names the file and says what is wrong."""
    expected = f"{path}: expected an RSA private key in DER or PEM, without a password"
    try:
        content = path.read_bytes()
        is_pem = content.lstrip().startswith(_PEM)
        load = serialization.load_pem_private_key if is_pem else serialization.load_der_private_key
        key = load(content, password=None)
    except OSError as why:
        raise ValueError(f"{path}: {why}") from None
    except (ValueError, TypeError) as why:
        raise ValueError(f"{expected}: {why}") from None
    if not isinstance(key, RSAPrivateKey):
        raise ValueError(f"{expected}, got {type(key).__name__.lstrip('_')}")
    if key.key_size < LEAST_BITS:
        raise ValueError(f"{path}: expected a key of {LEAST_BITS} bits, got {key.key_size}")
    return key


def key_pem(path: Path) -> bytes:
    """Read a private key, as PEM."""
    return dump_private_key_as_pem(read_key(path))


def expect_pair(certificate: Path, private_key: Path) -> None:
    """Refuse a certificate that is not of this key, or names no application; ValueError."""
    pair_certificate, key = read_certificate(certificate), read_key(private_key)
    if pair_certificate.content.public_key() != key.public_key():
        raise ValueError(f"{certificate}: expected the certificate of the key {private_key}")
    if pair_certificate.application_uri is None:
        raise ValueError(
            f"{certificate}: expected a certificate with the application's URI as an alternative "
            "name of its subject, got none: servers and clients refuse it"
        )


def certificates_in(folder: Path) -> Iterator[Certificate]:
    """Read all certificates of a folder; what is none is passed over."""
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in SUFFIXES:
            try:
                yield read_certificate(path)
            except ValueError:
                continue


def write_pair(certificate: Path, private_key: Path, uri: str, hosts: list[str]) -> Certificate:
    """Make a key and a certificate that it signs itself, for reading and for being read.

    Parameters
    ----------
    uri
        Of the application, `urn:HOST:thermap`.
    hosts
        Names or addresses under which it is reached.

    Raises
    ------
    FileExistsError
        If there is one of the files: who trusts a certificate trusts no other.
    """
    key = generate_private_key()
    names: list[x509.GeneralName] = [x509.UniformResourceIdentifier(uri)]
    names += [_host_name(host) for host in hosts]
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    signed = Certificate(
        generate_self_signed_app_certificate(
            key, "thermap", {"organizationName": "thermap"}, names, usages, MADE_FOR_DAYS
        )
    )
    for path, content, mode in (
        (private_key, dump_private_key_as_pem(key), 0o600),
        (certificate, signed.der, 0o644),
    ):
        path.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
            file.write(content)
    return signed


def _host_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def now() -> datetime:
    """Say what time it is for certificates: the computer's, whatever clock the service has."""
    return datetime.now(UTC)


def ends_soon(certificate: Certificate) -> str:
    """Warn of one that ends within a month; empty otherwise."""
    remaining = certificate.content.not_valid_after_utc - now()
    if timedelta(0) < remaining < SOON:
        return f"the certificate {certificate.words} ends in {counted(remaining.days, 'day')}"
    return ""
