"""What a service does beside its answers: a thread that runs from its start to its end."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from threading import Event, Thread
from typing import TYPE_CHECKING

from app.errors import StorageUnavailable

if TYPE_CHECKING:
    from app.storage.postgresql import Duty

log = logging.getLogger("thermap")


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

    def _repeat(
        self, look: Callable[[], object], every_s: float, trouble: str, *, at_once: bool = False
    ) -> None:
        """Look regularly until `_stop` is set, where this process has the duty.

        What the database cannot say is asked again at the next look; other trouble is logged.
        """
        if not at_once:
            self._stop.wait(every_s)
        while not self._stop.is_set():
            try:
                if self._is_ours():
                    look()
            except StorageUnavailable:
                pass
            except Exception:
                log.exception(trouble)
            self._stop.wait(every_s)

    @abstractmethod
    def _run(self) -> None:
        """Do it until `_stop` is set."""
