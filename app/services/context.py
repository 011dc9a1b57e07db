"""What every use case is handed: the database, the machines in memory, and the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Final

from app.live.registry import LiveRegistry
from app.storage.database import Database

FUTURE_TOLERANCE: Final = timedelta(minutes=1)
"""Clocks differ: no map and no observation is stated later than this after the service's now."""

CLOCKS_DIFFER: Final = timedelta(seconds=2)
"""A reading that is ahead of the service's clock by no more is used at once: a table that
stays on it for so long is as good. One that is further ahead waits for its time."""


def utc_now() -> datetime:
    """Read the clock."""
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True)
class Context:
    """The database, the registry of live machines, and the clock."""

    database: Database
    live: LiveRegistry = field(default_factory=LiveRegistry)
    now: Callable[[], datetime] = utc_now

    def usable_until(self) -> datetime:
        """Give the latest time at which a reading can have been measured now."""
        return self.now() + CLOCKS_DIFFER
