"""A session with an OPC UA server: opened within a time, and left whatever has become of it.

Every session has a client of its own. asyncua can also go on with an old one, but then it is
not known what still holds: a client that has lost its server is not to be relied on.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeAlias

from asyncua import Client, ua
from asyncua.crypto import security_policies
from cryptography import x509

log = logging.getLogger("thermap")

ANSWER_S: Final = 5.0
"""How long an answer may take [s]."""

OPEN_S: Final = 20.0
"""How long opening a session may take with all that belongs to it [s]."""

GOODBYE_S: Final = 2.0
"""How long a server that is left may take to answer that [s]."""

SESSION_S: Final = 60.0
"""After so long without a sign of life a server may close a session [s]: small controllers have
room for few, and each that was broken off stays open until then."""

LARGEST_MESSAGE: Final = 16 * 1024 * 1024
"""Of any answer [bytes]."""

MOST_PARTS: Final = 1024

MOST_NODES: Final = 100
"""Nodes that are asked for at once: small controllers refuse more."""

SecurityMode: TypeAlias = Literal["Sign", "SignAndEncrypt"]

SecurityPolicy: TypeAlias = Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]

# What it says of lost contact, with a traceback for every attempt, is said here in a sentence.
logging.getLogger("asyncua.client").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Security:
    """How messages are signed or encrypted: files in DER or PEM, and whom to believe."""

    mode: SecurityMode
    policy: SecurityPolicy
    certificate: Path
    private_key: Path
    server_certificate: Path


@dataclass(frozen=True, slots=True)
class Access:
    """Where a server is, and who asks it; without a user anonymously."""

    endpoint: str
    security: Security | None = None
    user: str = ""
    password: str = ""


@asynccontextmanager
async def session_with(
    access: Access, when_lost: Callable[[Exception], Awaitable[None]]
) -> AsyncIterator[Client]:
    """Open a session and leave it; TimeoutError, OSError, UaError or whatever asyncua raises."""
    # Its own watchdog takes one answer that is late by a second for the end.
    client = Client(access.endpoint, timeout=ANSWER_S, watchdog_intervall=SESSION_S)
    client.name = client.description = "thermap"
    client.application_uri = "urn:thermap:client"
    client.session_timeout = round(SESSION_S * 1000)
    client.max_messagesize, client.max_chunkcount = LARGEST_MESSAGE, MOST_PARTS
    client.connection_lost_callback = when_lost  # type: ignore[assignment]
    try:
        async with asyncio.timeout(OPEN_S):
            await _identify(client, access)
            await client.connect()
        yield client
    finally:
        await _leave(client)


async def _identify(client: Client, access: Access) -> None:
    if access.user:
        client.set_user(access.user)
        client.set_password(access.password)
    security = access.security
    if security is None:
        return
    client.application_uri = _application_of(security.certificate) or client.application_uri
    await client.set_security(
        getattr(security_policies, f"SecurityPolicy{security.policy}"),
        security.certificate,
        security.private_key,
        server_certificate=str(security.server_certificate),
        mode=ua.MessageSecurityMode[security.mode],
    )


def _application_of(certificate: Path) -> str | None:
    """Read the URI that a certificate is for: a server compares it with what a client says."""
    content = certificate.read_bytes()
    is_pem = content.lstrip().startswith(b"-----BEGIN")
    found = (x509.load_pem_x509_certificate if is_pem else x509.load_der_x509_certificate)(content)
    try:
        names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return None
    uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    return uris[0] if uris else None


async def _leave(client: Client) -> None:
    """Close the session, and the socket in any case: a server that hangs answers nothing."""
    protocol = client.uaclient.protocol
    try:
        with suppress(Exception):
            async with asyncio.timeout(GOODBYE_S):
                await client.disconnect()
    finally:
        if protocol is not None and protocol.transport is not None:
            protocol.transport.abort()


async def read_nodes(client: Client, nodes: Sequence[ua.NodeId]) -> list[ua.DataValue]:
    """Read nodes' values, in parts that any server takes."""
    found: list[ua.DataValue] = []
    for begin in range(0, len(nodes), MOST_NODES):
        some = list(nodes[begin : begin + MOST_NODES])
        found += await client.uaclient.session.read_attributes(some, ua.AttributeIds.Value)
    if len(found) != len(nodes):
        raise ua.UaError(f"expected {len(nodes)} values, got {len(found)}")
    return found


async def find_units(client: Client, nodes: Sequence[ua.NodeId]) -> list[object]:
    """Read what nodes state as their EngineeringUnits; None where they state none."""
    try:
        properties = [await _units_of(client, nodes[i : i + MOST_NODES]) for i in _parts(nodes)]
    except ua.UaError:  # not every controller can be asked so
        return [None] * len(nodes)
    found = [one for part in properties for one in part]
    values = await read_nodes(client, [one for one in found if one is not None])
    read = iter(values)
    return [None if one is None else _content(next(read)) for one in found]


async def _units_of(client: Client, nodes: Sequence[ua.NodeId]) -> list[ua.NodeId | None]:
    step = ua.RelativePathElement(
        ReferenceTypeId=ua.NodeId(ua.Int32(ua.ObjectIds.HasProperty)),
        IsInverse=False,  # type: ignore[arg-type]
        IncludeSubtypes=True,  # type: ignore[arg-type]
        TargetName=ua.QualifiedName("EngineeringUnits"),
    )
    paths = [ua.BrowsePath(node, ua.RelativePath([step])) for node in nodes]
    results = await client.uaclient.session.translate_browsepaths_to_nodeids(paths)
    return [one.Targets[0].TargetId if one.Targets else None for one in results]


def _parts(nodes: Sequence[ua.NodeId]) -> range:
    return range(0, len(nodes), MOST_NODES)


def _content(said: ua.DataValue) -> object:
    return None if said.Value is None else said.Value.Value
