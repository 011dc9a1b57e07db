"""Whether the service is well, over HTTP."""

from __future__ import annotations

from pydantic import Field

from app.api.schemas.base import Schema


class HealthAnswer(Schema):
    """The process lives."""

    status: str = Field(description="`ok`", examples=["ok"])
    version: str = Field(description="Version of thermap")


class ReadyAnswer(Schema):
    """Whether the database is there and the models are in memory."""

    status: str = Field(description="`ready` or `not-ready`", examples=["ready"])
    database: str = Field(description="`ok`, or what is the matter")
    machines: int = Field(description="Machines in the database")
    machines_in_memory: int = Field(description="Machines whose model is in memory")
    disk_free_bytes: int | None = Field(
        None,
        description="Free on the disk of the database's file [bytes]; null where that is not "
        "known, as on PostgreSQL",
    )
