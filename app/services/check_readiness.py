"""Whether the service can do its work."""

from __future__ import annotations

from dataclasses import dataclass

from app.errors import StorageUnavailable
from app.services.context import Context
from app.storage.machines import count_machines


@dataclass(frozen=True, slots=True)
class Readiness:
    """The database's state, and how many machines' models are in memory."""

    database: str
    machines: int
    machines_in_memory: int

    @property
    def is_ready(self) -> bool:
        """Whether the database is there and every model is in memory."""
        return self.database == "ok" and self.machines_in_memory >= self.machines


def check_readiness(context: Context) -> Readiness:
    """Ask the database; a failure is part of the answer."""
    in_memory = len(context.live)
    try:
        with context.database.reading() as session:
            machines = count_machines(session)
    except StorageUnavailable as error:
        return Readiness(error.detail, in_memory, in_memory)
    return Readiness("ok", machines, in_memory)
