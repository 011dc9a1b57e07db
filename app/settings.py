"""The service's settings, read once: from the command line, then THERMAP_… in the environment."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from ipaddress import ip_address, ip_network
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from urllib.parse import urlsplit

from platformdirs import user_data_path
from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from app.errors import StorageUnavailable

LARGEST_BODY: Final = 64 * 1024 * 1024
"""Of any route, unless the operator sets it otherwise [bytes]: a million points fit."""


_ORIGIN: Final = re.compile(r"https?://[A-Za-z0-9.\-\[\]:]+")


def own_folder() -> Path:
    """Name the user's own folder for thermap's data.

    Raises
    ------
    StorageUnavailable
        If the user has none, as in a container.
    """
    try:
        folder: Path = user_data_path("thermap")
    except RuntimeError as error:
        raise StorageUnavailable(
            "this user has no folder for a database: state where it is with --database-url or "
            "THERMAP_DATABASE_URL"
        ) from error
    return folder


def sqlite_url(file_name: str) -> str:
    """Name a SQLite file in the user's own folder for data."""
    return f"sqlite:///{own_folder() / file_name}"


def is_postgresql(database_url: str) -> bool:
    """Whether this is the URL of a PostgreSQL database."""
    return database_url.partition(":")[0].partition("+")[0] in ("postgresql", "postgres")


def make_own_folder(database_url: str) -> None:
    """Make the user's own folder for data, if this is the URL of a database there."""
    try:
        folder = own_folder()
    except StorageUnavailable:  # then it is elsewhere
        return
    if database_url.startswith(f"sqlite:///{folder}{os.sep}"):
        with suppress(OSError):  # whoever opens the file says why there is none
            folder.mkdir(parents=True, exist_ok=True)


def is_this_computer(host: str) -> bool:
    """Whether only this computer reaches what listens on an address."""
    with suppress(ValueError):
        return ip_address(host).is_loopback
    return host == "localhost"


class Settings(BaseSettings):
    """What an operator may choose."""

    # A compose file hands on what is not set as an empty text.
    model_config = SettingsConfigDict(
        env_prefix="THERMAP_", env_ignore_empty=True, frozen=True, extra="forbid"
    )

    database_url: str = Field(
        default_factory=lambda: sqlite_url("thermap.db"),
        description="sqlite:///FILE or postgresql://USER@HOST/DATABASE; without it thermap.db in "
        "the user's folder for data",
    )
    host: str = Field("127.0.0.1", description="Address to listen on")
    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        (),
        description="Names under which the service is reached, beside this computer's own and "
        "numeric addresses; *.example.org for all below it, * for every name",
    )
    cors_origins: Annotated[tuple[str, ...], NoDecode] = Field(
        (),
        description="Other sites whose pages may read and, with a key where keys are asked for, "
        "write; such as https://mes.example.org",
    )
    require_keys: bool = Field(
        default=False, description="Ask for a key on this computer's own address too"
    )
    insecure: bool = Field(
        default=False, description="Ask for no key although other computers reach the service"
    )
    forwarded_allow_ips: Annotated[tuple[str, ...], NoDecode] = Field(
        (),
        description="Addresses and networks of the proxies whose X-Forwarded-For and "
        "X-Forwarded-Proto are believed",
    )
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 takes any free one")
    max_body_bytes: int = Field(
        LARGEST_BODY, ge=4096, description="Largest body of any request [bytes]"
    )
    patience_s: float = Field(
        10.0, gt=0, description="How long a request may stop half-way before it is ended [s]"
    )
    refresh_s: float = Field(
        1.0,
        gt=0,
        description="How often the database is asked whether it is there and, on SQLite, for "
        "others' changes, of which PostgreSQL tells at once [s]",
    )
    statement_limit_s: float = Field(
        15.0, ge=0.1, description="Longest that one statement of a request may take [s]"
    )
    lock_limit_s: float = Field(
        10.0, ge=0.01, description="Longest that a request waits for what others have locked [s]"
    )
    waiting_requests: int = Field(
        100, ge=0, description="Requests that may wait for their turn at the database"
    )
    waiting_limit_s: float = Field(
        10.0, gt=0, description="Longest that a request waits for its turn at the database [s]"
    )
    analyses: bool = Field(
        default=True, description="Run analyses; without, `thermap worker` processes do"
    )
    waiting_analyses: int = Field(
        20_000, ge=1, description="Analyses that may wait, of all machines"
    )
    waiting_analyses_of_machine: int = Field(
        20, ge=1, description="Analyses of one machine that may wait"
    )
    opcua_endpoint: str = Field(
        "",
        description="Where OPC UA clients read tables: opc.tcp://ADDRESS:PORT/NAME; empty for no "
        "OPC UA server",
    )
    config: Path | None = Field(
        None, description="File of connections (TOML); without it there are none"
    )
    keep_readings: int | None = Field(
        None,
        ge=31,
        description="Age from which readings are deleted, but for those that verifications need "
        "[days]; without it they are kept for ever",
    )
    thin_readings_after: int | None = Field(
        None,
        ge=31,
        description="Age from which readings are thinned, but for those that maps, verifications "
        "and adopted lags need [days]; without it they are left as they are",
    )
    thin_readings_to_s: float = Field(
        60.0,
        gt=0,
        le=86_400,
        description="Of each sensor one value in so long is left of what is thinned [s]",
    )
    workers: int = Field(1, ge=1, description="Processes of one host that answer side by side")
    worker: int = Field(
        0, ge=0, description="Number among the workers of one host, which `thermap serve` gives"
    )
    log_level: Literal["debug", "info", "warning", "error", "critical"] = Field(
        "warning", description="debug, info, warning, error or critical"
    )

    @field_validator("cors_origins")
    @classmethod
    def _origins_exactly(cls, origins: tuple[str, ...]) -> tuple[str, ...]:
        for origin in origins:
            if not _ORIGIN.fullmatch(origin):
                raise ValueError(
                    "https://NAME or http://NAME, with :PORT where it is not the usual one "
                    "(* would let every page in)"
                )
        return tuple(origin.lower() for origin in origins)

    @property
    def asks_for_keys(self) -> bool:
        """Whether who asks has to have a key: wherever other computers reach the service."""
        return self.require_keys or not (self.insecure or is_this_computer(self.host))

    @field_validator("opcua_endpoint")
    @classmethod
    def _is_endpoint(cls, endpoint: str) -> str:
        """Refuse what is not an endpoint."""
        if not endpoint:
            return endpoint
        host = port = None
        with suppress(ValueError):
            url = urlsplit(endpoint)
            host, port = url.hostname, url.port
        if not (host and port and endpoint.startswith("opc.tcp://")):
            raise ValueError("opc.tcp://ADDRESS:PORT/NAME, as opc.tcp://127.0.0.1:4840/thermap")
        return endpoint

    @field_validator("forwarded_allow_ips")
    @classmethod
    def _addresses_of_proxies(cls, addresses: tuple[str, ...]) -> tuple[str, ...]:
        for address in addresses:
            try:
                ip_network(address)
            except ValueError:
                raise ValueError(
                    "an address or a network, such as 127.0.0.1 or 10.0.0.0/8 (* would believe "
                    "everybody)"
                ) from None
        return addresses

    @field_validator("allowed_hosts", "cors_origins", "forwarded_allow_ips", mode="before")
    @classmethod
    def _names_apart(cls, value: Any) -> Any:
        """Take names apart that stand in one text, as in the environment."""
        texts = [value] if isinstance(value, str) else value
        return tuple(name for text in texts for name in text.replace(",", " ").split())
