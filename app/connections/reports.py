"""How all connections fare, whichever process has them: each tells the others, by the database.

Of several workers the first alone has connections, of several hosts perhaps one alone; and any of
them may be asked. On SQLite there is one process, and nobody else to be told.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from datetime import timedelta
from time import monotonic
from typing import Final

from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool

from app.connections.running import Connections, ConnectionsNow
from app.errors import StorageUnavailable
from app.services.context import Context
from app.storage.connection_reports import delete_report, reports, write_report
from app.storage.limits import QUESTION
from app.supervision import keep_running

log = logging.getLogger("thermap")

TELL_EVERY_S: Final = 1.0
"""How often a process tells what has changed of its connections [s]."""

REPEAT_S: Final = 5.0
"""How often it tells what has not [s]."""

SILENT_AFTER: Final = timedelta(seconds=15)
"""Of whom nothing came for longer, nobody knows how its connections fare."""

FORGET_AFTER: Final = timedelta(hours=1)
"""After so long a process that said nothing is forgotten."""

_SHAPE: Final = TypeAdapter(ConnectionsNow)


class ConnectionReports:
    """The connections of this process and of all others.

    Parameters
    ----------
    owner
        By which others know this process, the same after a restart; None where no others are.
    """

    def __init__(
        self, connections: Connections, context: Callable[[], Context], owner: str | None
    ) -> None:
        self._own = connections
        self._context = context
        self._owner = owner

    def now(self) -> ConnectionsNow:
        """Say how all fare.

        Raises
        ------
        StorageUnavailable
            If this process has none itself, and the database does not say what others have.
        """
        if self._owner is None:
            return self._own.now()
        try:
            found = dict(self._told())
        except StorageUnavailable:
            if not self._own:
                raise
            found = {}
        if self._own:
            found[self._owner] = self._own.now()
        return _together([now for _, now in sorted(found.items())])

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Tell others for as long as the block lasts, and take it back at its end."""
        owner = self._owner
        if owner is None or not self._own:
            yield
            return
        telling = asyncio.create_task(
            keep_running("reports of connections", lambda: self._tell_others(owner))
        )
        try:
            yield
        finally:
            telling.cancel()
            with suppress(asyncio.CancelledError):
                await telling
            with suppress(StorageUnavailable):
                await run_in_threadpool(self._take_back, owner)

    async def _tell_others(self, owner: str) -> None:
        last, told_s = b"", 0.0
        while True:
            try:
                content = _SHAPE.dump_json(self._own.now())
                if content != last or monotonic() - told_s >= REPEAT_S:
                    await run_in_threadpool(self._tell, owner, content.decode())
                    last, told_s = content, monotonic()
            except StorageUnavailable:
                pass  # that it is away is said elsewhere
            await asyncio.sleep(TELL_EVERY_S)

    def _tell(self, owner: str, content: str) -> None:
        with self._context().database.writing(QUESTION) as session:
            write_report(session, owner, content, FORGET_AFTER)

    def _take_back(self, owner: str) -> None:
        with self._context().database.writing(QUESTION) as session:
            delete_report(session, owner)

    def _told(self) -> Mapping[str, ConnectionsNow]:
        with self._context().database.reading(QUESTION) as session:
            stored = reports(session)
        found = {}
        for owner, report in stored.items():
            try:
                now = _SHAPE.validate_json(report.content)
            except ValueError:  # of another version, until that is replaced
                continue
            found[owner] = now if report.age <= SILENT_AFTER else _unknown(now, report.age)
        return found


def _unknown(now: ConnectionsNow, age: timedelta) -> ConnectionsNow:
    """Say that who has these connections says nothing any more."""
    words = f"the process that has it has said nothing for {age.total_seconds():.0f} s"
    gone = tuple(
        replace(connection, connected=False, known=0, trouble=words)
        for connection in now.connections
    )
    return replace(now, connections=gone, machines_with_wrong_clocks=())


def _together(found: list[ConnectionsNow]) -> ConnectionsNow:
    clocks = {machine for now in found for machine in now.machines_with_wrong_clocks}
    refusals = [now.last_refusal for now in found if now.last_refusal]
    return ConnectionsNow(
        tuple(connection for now in found for connection in now.connections),
        sum(now.stored for now in found),
        sum(now.dropped for now in found),
        sum(now.refused for now in found),
        refusals[-1] if refusals else "",
        sum(now.wrong_clocks for now in found),
        tuple(sorted(clocks)),
    )
