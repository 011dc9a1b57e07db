"""The service's settings, read once: from the command line, then THERMAP_… in the environment."""

from __future__ import annotations

from pathlib import Path

from platformdirs import user_data_path
from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


def sqlite_url(file_name: str) -> str:
    """Name a SQLite file in the user's own folder for data."""
    folder: Path = user_data_path("thermap")
    return f"sqlite:///{folder / file_name}"


class Settings(BaseSettings):
    """What an operator may choose."""

    model_config = SettingsConfigDict(env_prefix="THERMAP_", frozen=True, extra="forbid")

    database_url: str = Field(
        default_factory=lambda: sqlite_url("thermap.db"),
        description="sqlite:///FILE or postgresql://USER@HOST/DATABASE",
    )
    host: str = Field("127.0.0.1", description="Address to listen on")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on")
    max_body_bytes: int = Field(
        64 * 1024 * 1024, ge=4096, description="Largest body of a request [bytes]"
    )
    refresh_s: float = Field(
        1.0, gt=0, description="How often the database is looked at for others' changes [s]"
    )
    log_level: str = Field("warning", description="debug, info, warning, error or critical")
