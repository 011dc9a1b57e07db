"""Who may talk to whom over OPC UA, as the file of connections states it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator, model_validator

from app.connections.connection import Table, Variable

SecurityMode: TypeAlias = Literal["Sign", "SignAndEncrypt"]

SecurityPolicy: TypeAlias = Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]


def _at(path_in_file: Path, info: ValidationInfo) -> Path:
    path: Path = (info.context or {}).get("folder", Path()) / path_in_file
    return path


def _file_at(path_in_file: Path, info: ValidationInfo) -> Path:
    path = _at(path_in_file, info)
    try:
        path.open("rb").close()
    except OSError as why:
        raise ValueError(f"expected a file, got {str(path)!r}: {why.strerror}") from why
    return path


class SecurityTable(Table):
    """`[opcua.security]`: files in DER or PEM, as from the folder of the file of connections."""

    mode: SecurityMode
    policy: SecurityPolicy = "Basic256Sha256"
    certificate: Path = Field(strict=False)
    private_key: Path = Field(strict=False)
    server_certificate: Path = Field(strict=False)

    _files = field_validator("certificate", "private_key", "server_certificate")(_file_at)

    def expect_usable(self) -> None:
        """Refuse files that are no certificates, or not of one key; ValueError."""
        from app.connections.opcua_certificates import expect_pair, read_certificate

        expect_pair(self.certificate, self.private_key)
        read_certificate(self.server_certificate)


class UserTable(Table):
    """A user; the password stands in a variable of the environment."""

    name: Annotated[str, Field(min_length=1, max_length=200)]
    password_env: Variable

    @property
    def password(self) -> str:
        """The password as it is now."""
        return os.environ.get(self.password_env, "")


class OpcuaServerTable(Table):
    """`[opcua_server]`: how the service's own server is read; without it, by anybody."""

    certificate: Path = Field(strict=False)
    private_key: Path = Field(strict=False)
    trusted_clients: Path = Field(strict=False)
    modes: Annotated[tuple[SecurityMode, ...], Field(min_length=1, strict=False)] = (
        "Sign",
        "SignAndEncrypt",
    )
    policies: Annotated[tuple[SecurityPolicy, ...], Field(min_length=1, strict=False)] = (
        "Basic256Sha256",
        "Aes128Sha256RsaOaep",
        "Aes256Sha256RsaPss",
    )
    without_security: bool = False
    users: Annotated[tuple[UserTable, ...], Field(max_length=100, strict=False)] = ()

    _files = field_validator("certificate", "private_key")(_file_at)

    @field_validator("trusted_clients")
    @classmethod
    def _is_folder(cls, path_in_file: Path, info: ValidationInfo) -> Path:
        path = _at(path_in_file, info)
        if not path.is_dir():
            raise ValueError(f"expected a folder of certificates, got {str(path)!r}")
        return path

    @model_validator(mode="after")
    def _no_open_passwords(self) -> OpcuaServerTable:
        names = [user.name for user in self.users]
        if len(set(names)) < len(names):
            raise ValueError(f"expected each user once, got {', '.join(sorted(names))}")
        if self.users and self.without_security:
            raise ValueError(
                "expected without_security = false where there are users, got true: their "
                "passwords could be read on their way"
            )
        return self

    def expect_usable(self) -> None:
        """Refuse files that are no certificate and its key; ValueError."""
        from app.connections.opcua_certificates import expect_pair

        expect_pair(self.certificate, self.private_key)
