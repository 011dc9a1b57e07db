"""The service's settings, read once: from the command line, then THERMAP_… in the environment."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Final

from platformdirs import user_data_path
from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

LARGEST_BODY: Final = 64 * 1024 * 1024
"""Of any route, unless the operator sets it otherwise [bytes]: a million points fit."""


def own_folder() -> Path:
    """Name the user's own folder for thermap's data."""
    folder: Path = user_data_path("thermap")
    return folder


def sqlite_url(file_name: str) -> str:
    """Name a SQLite file in the user's own folder for data."""
    return f"sqlite:///{own_folder() / file_name}"


def make_own_folder(database_url: str) -> None:
    """Make the user's own folder for data, if this is the URL of a database there."""
    folder = own_folder()
    if database_url.startswith(f"sqlite:///{folder}{os.sep}"):
        with suppress(OSError):  # whoever opens the file says why there is none
            folder.mkdir(parents=True, exist_ok=True)


class Settings(BaseSettings):
    """What an operator may choose."""

    model_config = SettingsConfigDict(env_prefix="THERMAP_", frozen=True, extra="forbid")

    database_url: str = Field(
        default_factory=lambda: sqlite_url("thermap.db"),
        description="sqlite:///FILE or postgresql://USER@HOST/DATABASE",
    )
    host: str = Field("127.0.0.1", description="Address to listen on")
    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        (),
        description="Names under which the service is reached, beside this computer's own and "
        "numeric addresses; *.example.org for all below it, * for every name",
    )
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on")
    max_body_bytes: int = Field(
        LARGEST_BODY, ge=4096, description="Largest body of any request [bytes]"
    )
    patience_s: float = Field(
        10.0, gt=0, description="How long a request may stop half-way before it is ended [s]"
    )
    refresh_s: float = Field(
        1.0, gt=0, description="How often the database is looked at for others' changes [s]"
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
    log_level: str = Field("warning", description="debug, info, warning, error or critical")

    @field_validator("allowed_hosts", mode="before")
    @classmethod
    def _names_apart(cls, stated: Any) -> Any:
        """Take names apart that stand in one text, as in the environment."""
        texts = [stated] if isinstance(stated, str) else stated
        return tuple(name for text in texts for name in text.replace(",", " ").split())
