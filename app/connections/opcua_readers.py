"""Who may read from the service's own OPC UA server: what asyncua leaves open is closed here.

asyncua looks at a client's certificate only where it states one when it asks for a session, takes
channels without security although none are offered, and hands a session over to whoever names it.
So who is let in is decided when a session is activated, by the certificate that the channel was
opened with: its owner has the key.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from typing import Any, Final

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.internal_server import InternalServer

from app.connections.opcua_certificates import certificates_in, now, sent_certificate
from app.connections.opcua_security import OpcuaServerTable
from app.connections.sparing_log import SparingLog

_OAEP: Final = frozenset(
    {
        "http://www.w3.org/2001/04/xmlenc#rsa-oaep",
        "http://opcfoundation.org/UA/security/rsa-oaep-sha2-256",
    }
)
"""How a password may be encrypted: not as PKCS #1 v1.5 has it, which tells who asks often."""


class Readers:
    """Lets in who may read; nobody may write.

    Parameters
    ----------
    table
        Without it everybody may, without security.
    """

    def __init__(self, table: OpcuaServerTable | None) -> None:
        self._stated = table
        self._log = SparingLog()

    def get_user(
        self,
        _server: Any,
        username: str | None = None,
        password: str | None = None,
        certificate: bytes | None = None,
    ) -> User:
        """Give a user who may write what is writable, which is nothing.

        Parameters
        ----------
        certificate
            With which the channel was opened, in DER; nothing without security.

        Raises
        ------
        ServiceError
            With the status code that says why somebody is not let in.
        """
        if self._stated is not None:
            self._expect_trusted(self._stated, certificate)
            if self._stated.users:
                self._expect_known(self._stated, username, password)
        # Whoever says `admin` is one to asyncua; not here.
        return User(role=UserRole.User)

    def _expect_trusted(self, table: OpcuaServerTable, sent: bytes | None) -> None:
        if not sent:
            if not table.without_security:
                self._refuse("security", "without security", "BadSecurityModeInsufficient")
            return
        certificate = sent_certificate(sent)
        if all(
            trusted.der != certificate.der for trusted in certificates_in(table.trusted_clients)
        ):
            words = (
                f"with the certificate {certificate.words}, which is not in {table.trusted_clients}"
            )
            self._refuse("certificate", words, "BadCertificateUntrusted")
        if trouble := certificate.trouble(now()):
            self._refuse(
                "time", f"with {certificate.words}: {trouble}", "BadCertificateTimeInvalid"
            )

    def _expect_known(
        self, table: OpcuaServerTable, username: str | None, password: str | None
    ) -> None:
        passwords: Mapping[str, str] = {user.name: user.password for user in table.users}
        expected, got = passwords.get(username or ""), (password or "").encode()
        # Compared also where nobody has the name: how long it takes says nothing.
        is_right = hmac.compare_digest((expected or "").encode(), got)
        if expected is None or not is_right:
            words = f"as {(username or '')[:100]!r} with a wrong name or password"
            self._refuse("user", words, "BadUserAccessDenied")

    def _refuse(self, about: str, words: str, code: str) -> None:
        self._log.warn(about, f"OPC UA server: a client was refused that came {words}")
        raise ServiceError(getattr(ua.StatusCodes, code))


class OwnServer(InternalServer):
    """Does less for whom nobody knows yet than asyncua's."""

    def lookup_external_session(self, _token: ua.NodeId) -> None:
        """Hand no session over: who names one may have guessed it."""

    def register_server(self, *_ignored: Any, **_named: Any) -> None:
        """Refuse: it is no discovery server, and anybody may ask."""
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    def decrypt_user_token(self, isession: Any, token: ua.UserNameIdentityToken) -> tuple[str, str]:
        """Read a password that was encrypted in a way that tells nothing, or not at all."""
        if token.EncryptionAlgorithm and token.EncryptionAlgorithm not in _OAEP:
            raise ServiceError(ua.StatusCodes.BadIdentityTokenRejected)
        return super().decrypt_user_token(isession, token)


def policies_of(table: OpcuaServerTable | None) -> list[ua.SecurityPolicyType]:
    """List what is offered."""
    if table is None:
        return [ua.SecurityPolicyType.NoSecurity]
    policies = [
        ua.SecurityPolicyType[f"{policy}_{mode}"]
        for policy in table.policies
        for mode in table.modes
    ]
    return policies + [ua.SecurityPolicyType.NoSecurity] * table.without_security
