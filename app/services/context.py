"""What every use case is handed: the database, the machines in memory, and the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Final

from app.live.registry import LiveRegistry
from app.storage.database import Database

FUTURE_TOLERANCE: Final = timedelta(minutes=1)
"""Clocks differ: nothing was measured later than this after the service's now."""


def utc_now() -> datetime:
    """Read the clock."""
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True)
class Context:
    """The database, the registry of live machines, and the clock."""

    database: Database
    live: LiveRegistry = field(default_factory=LiveRegistry)
    now: Callable[[], datetime] = utc_now
