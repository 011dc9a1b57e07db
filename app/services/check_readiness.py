"""Whether the service can do its work."""

from __future__ import annotations

from dataclasses import dataclass

from app.errors import StorageUnavailable
from app.live.database_watch import Matter
from app.services.context import Context
from app.storage.limits import QUESTION
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
        with context.database.reading(QUESTION) as session:
            machines = count_machines(session)
    except StorageUnavailable as error:
        return Readiness(error.detail, in_memory, in_memory)
    trouble = context.live.database.trouble
    if trouble is not None and trouble.matter is Matter.LOCKED:
        return Readiness("the database is locked: nothing can be stored", machines, in_memory)
    return Readiness("ok", machines, in_memory)


def without_answer(context: Context) -> Readiness:
    """Say that the database does not answer."""
    in_memory = len(context.live)
    return Readiness("the database does not answer", in_memory, in_memory)
