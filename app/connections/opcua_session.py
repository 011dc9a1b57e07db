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
from typing import Final

from asyncua import Client, ua
from asyncua.crypto import security_policies
from asyncua.crypto.uacrypto import CertProperties

from app.connections.opcua_bounds import LARGEST_ANSWER, MOST_PARTS, bound_client
from app.connections.opcua_certificates import (
    Certificate,
    key_pem,
    now,
    read_certificate,
    sent_certificate,
)
from app.connections.opcua_security import SecurityTable
from app.errors import list_names

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

MOST_NODES: Final = 100
"""Nodes that are asked for at once: small controllers refuse more."""

MOST_NAMED: Final = 20
"""Of what a server offers, in words."""

# What it says of lost contact, with a traceback for every attempt, is said here in a sentence.
logging.getLogger("asyncua.client").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Access:
    """Where a server is, and who asks it; without a user anonymously."""

    endpoint: str
    security: SecurityTable | None = None
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
    client.max_messagesize, client.max_chunkcount = LARGEST_ANSWER, MOST_PARTS
    bound_client(client.uaclient)
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
    client_certificate, theirs = _usable_certificates(security)
    client.application_uri = client_certificate.application_uri or client.application_uri
    await client.set_security(
        getattr(security_policies, f"SecurityPolicy{security.policy}"),
        CertProperties(client_certificate.der, "der"),
        CertProperties(key_pem(security.private_key), "pem"),
        server_certificate=CertProperties(theirs.der, "der"),
        mode=ua.MessageSecurityMode[security.mode],
    )


def _usable_certificates(security: SecurityTable) -> tuple[Certificate, Certificate]:
    """Read our certificate and the server's anew; UaError where one is not valid now."""
    certificates = []
    for path in (security.certificate, security.server_certificate):
        try:
            certificate = read_certificate(path)
        except ValueError as why:
            raise ua.UaError(str(why)) from None
        if trouble := certificate.trouble(now()):
            raise ua.UaError(f"{path}: {trouble}")
        certificates.append(certificate)
    return certificates[0], certificates[1]


async def why_refused(access: Access, why: BaseException) -> str:
    """Say why a secured session could not be opened, as far as the server tells anybody.

    Who cannot read what is encrypted for another one just ends the connection. So the server is
    asked without security what it offers; nothing of that is believed but for the words.
    """
    security, words = access.security, words_of_failure(why)
    if security is None:
        return words
    client = Client(access.endpoint, timeout=ANSWER_S)
    bound_client(client.uaclient)
    try:
        async with asyncio.timeout(OPEN_S):
            offered = await client.connect_and_get_server_endpoints()
    except Exception:
        return words
    finally:
        await _leave(client)
    mode = ua.MessageSecurityMode[security.mode]
    uri = getattr(security_policies, f"SecurityPolicy{security.policy}").URI
    fitting = [
        endpoint
        for endpoint in offered
        if (endpoint.SecurityMode, endpoint.SecurityPolicyUri) == (mode, uri)
    ]
    if not fitting:
        return (
            f"expected a server that offers {security.policy} with {security.mode}, got one that "
            f"offers {_offers(offered)}"
        )
    pinned = read_certificate(security.server_certificate)
    sent = [
        sent_certificate(certificate.ServerCertificate)
        for certificate in fitting
        if certificate.ServerCertificate
    ]
    if sent and all(endpoint.der != pinned.der for endpoint in sent):
        return (
            f"expected the server with the certificate {pinned.words} in "
            f"{security.server_certificate}, got one with {sent[0].words}"
        )
    return f"{words}{_REMEDIES.get(getattr(why, 'code', 0), '')}"


_REMEDIES: Final = dict.fromkeys(
    (
        ua.StatusCodes.BadCertificateUntrusted,
        ua.StatusCodes.BadSecurityChecksFailed,
        ua.StatusCodes.BadCertificateUseNotAllowed,
    ),
    "; the server has to trust our certificate",
) | dict.fromkeys(
    (ua.StatusCodes.BadUserAccessDenied, ua.StatusCodes.BadIdentityTokenRejected),
    "; the server does not take this user and password",
)


def _offers(offered: Sequence[ua.EndpointDescription]) -> str:
    offers = {
        f"{(endpoint.SecurityPolicyUri or '').rpartition('#')[2][:40]} with "
        f"{endpoint.SecurityMode.name.rstrip('_')}"
        for endpoint in offered[:MOST_NAMED]
    }
    return list_names(sorted(offers)) if offers else "nothing"


def words_of_failure(why: BaseException) -> str:
    """Put in words what went wrong with a session."""
    if isinstance(why, TimeoutError) and not str(why):
        return "no answer in time"
    return str(why) or type(why).__name__


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
    values: list[ua.DataValue] = []
    for begin in range(0, len(nodes), MOST_NODES):
        some = list(nodes[begin : begin + MOST_NODES])
        values += await client.uaclient.session.read_attributes(some, ua.AttributeIds.Value)
    if len(values) != len(nodes):
        raise ua.UaError(f"expected {len(nodes)} values, got {len(values)}")
    return values


async def find_units(client: Client, nodes: Sequence[ua.NodeId]) -> list[object]:
    """Read what nodes state as their EngineeringUnits; None where they state none."""
    try:
        properties = [await _units_of(client, nodes[i : i + MOST_NODES]) for i in _parts(nodes)]
    except ua.UaError:  # not every controller can be asked so
        return [None] * len(nodes)
    unit_nodes = [node for part in properties for node in part]
    values = await read_nodes(client, [node for node in unit_nodes if node is not None])
    read = iter(values)
    return [None if node is None else _content(next(read)) for node in unit_nodes]


async def _units_of(client: Client, nodes: Sequence[ua.NodeId]) -> list[ua.NodeId | None]:
    step = ua.RelativePathElement(
        ReferenceTypeId=ua.NodeId(ua.Int32(ua.ObjectIds.HasProperty)),
        IsInverse=False,  # type: ignore[arg-type]
        IncludeSubtypes=True,  # type: ignore[arg-type]
        TargetName=ua.QualifiedName("EngineeringUnits"),
    )
    paths = [ua.BrowsePath(node, ua.RelativePath([step])) for node in nodes]
    results = await client.uaclient.session.translate_browsepaths_to_nodeids(paths)
    return [result.Targets[0].TargetId if result.Targets else None for result in results]


def _parts(nodes: Sequence[ua.NodeId]) -> range:
    return range(0, len(nodes), MOST_NODES)


def _content(data_value: ua.DataValue) -> object:
    return None if data_value.Value is None else data_value.Value.Value
