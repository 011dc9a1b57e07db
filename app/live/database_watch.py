"""What is known of the database's troubles, without asking it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from time import monotonic
from typing import Final

SILENCE_S: Final = 3.0
"""A small question that has had no answer for so long is said not to be answered [s]."""


class TroubleKind(Enum):
    """What can be the matter with a database; the values follow on “the database”."""

    AWAY = "has been away"
    SILENT = "has not answered"
    LOCKED = "has been locked, and has taken nothing new,"


@dataclass(frozen=True, slots=True)
class Trouble:
    """What is the matter with the database, and since when."""

    matter: TroubleKind
    since: datetime


class DatabaseWatch:
    """Whether the database answers, as those see it who ask it regularly.

    Whoever asks says so before and after. An answer that does not come is then seen by
    everybody else, while who asked still waits for it.
    """

    def __init__(self) -> None:
        self._known: Trouble | None = None
        self._asked: tuple[float, datetime] | None = None

    @property
    def trouble(self) -> Trouble | None:
        """What is the matter now, None as long as all is well."""
        # Read a single time: the answer may come between two looks.
        pending = self._asked
        if self._known is None and pending is not None and monotonic() - pending[0] > SILENCE_S:
            return Trouble(TroubleKind.SILENT, pending[1])
        return self._known

    def note_question(self, now: datetime) -> None:
        """Note that the database is being asked."""
        self._asked = (monotonic(), now)

    def note_answer(self) -> None:
        """Note that the answer has come."""
        self._asked = None

    def note_recovery(self) -> None:
        """Note that nothing is the matter."""
        self._asked = self._known = None

    def note_trouble(self, matter: TroubleKind, since: datetime) -> bool:
        """Note that something is the matter; True if that is news.

        What has begun as another trouble goes on since then.
        """
        before = self.trouble
        self._asked = None
        self._known = Trouble(matter, before.since if before else since)
        return before is None
