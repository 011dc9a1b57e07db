"""What every use case is handed: the database, the machines in memory, and the time.

A use case whose transaction another overtook begins anew.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import wraps
from random import uniform
from time import sleep
from typing import Any, Final, ParamSpec, TypeVar

from app.errors import StorageOvertaken
from app.identification.analysis.tried_effect import TriedEffect
from app.live.registry import LiveRegistry
from app.services.together import Together
from app.storage.database import Database

FUTURE_TOLERANCE: Final = timedelta(minutes=1)
"""Clocks differ: no map and no observation is stated later than this after the service's now."""

CLOCKS_DIFFER: Final = timedelta(seconds=2)
"""A reading that is ahead of the service's clock by no more is used at once: a table that
stays on it for so long is as good. One that is further ahead waits for its time."""

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")

TIMES: Final = 5
"""How often a use case is tried in all."""

LONGEST_PAUSE_S: Final = 0.1
"""Before the second time, at most [s]; twice as long before each one after."""


def utc_now() -> datetime:
    """Read the clock."""
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True)
class QueueLimits:
    """How many analyses may wait, of one machine and in all."""

    machine: int = 20
    all: int = 20_000


@dataclass(frozen=True, slots=True)
class Context:
    """The database, the registry of live machines, the clock, and how much may wait.

    `tried` remembers what came of effects that were tried on sisters of a machine, by all that it
    follows from: it is long work, and asked for again as long as somebody looks at it.
    `reading_batches` are the readings that are being stored together.
    """

    database: Database
    live: LiveRegistry = field(default_factory=LiveRegistry)
    now: Callable[[], datetime] = utc_now
    queue_limits: QueueLimits = QueueLimits()
    tried: dict[Hashable, TriedEffect | None] = field(default_factory=dict)
    reading_batches: Together[Any] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "reading_batches", Together(self.database.appends_at_once))

    def usable_until(self) -> datetime:
        """Give the latest time at which a reading can have been measured now."""
        return self.now() + CLOCKS_DIFFER


def repeated(use_case: Callable[Asked, Answer]) -> Callable[Asked, Answer]:
    """Let a use case of one transaction begin anew where the database undid that.

    Of transactions that wait for each other, or that saw what another changed, the database
    undoes one, whole. Memory follows only what was committed. So the use case may be repeated
    from its beginning, after a pause by chance, or the same two would meet again.

    Parameters
    ----------
    use_case
        Changes nothing but by one `Database.writing`, and memory only after it.

    Returns
    -------
    callable
        The same; StorageOvertaken, and so "busy", when it was overtaken `TIMES` times.
    """

    @wraps(use_case)
    def until_it_succeeds(*arguments: Asked.args, **named: Asked.kwargs) -> Answer:
        for i in range(TIMES - 1):
            try:
                return use_case(*arguments, **named)
            except StorageOvertaken:
                sleep(uniform(0.0, LONGEST_PAUSE_S * 2**i))
        return use_case(*arguments, **named)

    return until_it_succeeds
