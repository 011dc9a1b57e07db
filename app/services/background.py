"""What a service does beside its answers: a thread that runs from its start to its end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from threading import Event, Thread
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.storage.postgresql import Duty


class Background(ABC):
    """Something that runs in a thread of its own.

    Parameters
    ----------
    duty
        What only one of several processes on one database does; None where each does it, and on
        SQLite.
    """

    def __init__(self, name: str, duty: Duty | None = None) -> None:
        self._duty = duty
        self._stop = Event()
        self._thread = Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self, patience_s: float = 10.0) -> None:
        """End, and wait for the end; not for ever, since the database may hang."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(patience_s)
        if self._duty is not None:
            self._duty.lay_down()

    def _is_ours(self) -> bool:
        """Whether this process is the one that has the duty."""
        return self._duty is None or self._duty.is_ours()

    @abstractmethod
    def _run(self) -> None:
        """Do it until `_stop` is set."""
