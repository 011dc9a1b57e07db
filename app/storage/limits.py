"""How long the database may take: whoever waits for it is told, and does not wait for ever."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Limits:
    """How long to wait for the database before giving up.

    Parameters
    ----------
    lock_s
        For what others hold [s]; None waits as long as it takes.
    statement_s
        For one statement [s]; None waits as long as it takes. SQLite, which works in this
        process and asks nobody, has no such limit.
    """

    lock_s: float | None = 10.0
    statement_s: float | None = 15.0


QUESTION: Final = Limits(lock_s=2.0, statement_s=3.0)
"""To see whether the database is there."""

LONG: Final = Limits(statement_s=600.0)
"""Where the amount of what is stored decides: deleting a machine, reading a campaign."""

UNLIMITED: Final = Limits(lock_s=None, statement_s=None)
"""Migrations, backups and restoring: somebody looks on, or waits for the service to start."""
