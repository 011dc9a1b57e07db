"""Keep memory in step with the database: other processes write to it too."""

from __future__ import annotations

import logging
from datetime import datetime
from threading import Event, Thread

from app.errors import StorageUnavailable, ThermapError, UnknownThing
from app.services.context import Context
from app.services.load_machine import load_machine
from app.storage.machines import count_and_revisions, revisions
from app.storage.readings import newest_id, stored_since

log = logging.getLogger("thermap")


class DatabaseFollower:
    """Looks every now and then whether the database is there and what is new in it.

    Loads all machines at the start, so that their tables go on when the database
    goes away. It runs in a thread of its own; a failure is logged and tried again.
    """

    def __init__(self, context: Context, every_s: float) -> None:
        self._context = context
        self._every_s = every_s
        self._stop = Event()
        self._thread = Thread(target=self._run, name="database-follower", daemon=True)
        self._seen_revisions: tuple[int, int] | None = None
        self._seen_reading: int | None = None

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, and wait for the end."""
        self._stop.set()
        self._thread.join(timeout=10.0)

    def look(self) -> None:
        """Look once: note whether the database is there, and load what has changed."""
        live = self._context.live
        try:
            with self._context.database.reading() as session:
                seen = count_and_revisions(session)
                wanted = revisions(session) if seen != self._seen_revisions else None
                newest = newest_id(session)
                fresh = (
                    stored_since(session, self._seen_reading)
                    if self._seen_reading is not None and newest > self._seen_reading
                    else []
                )
            live.database_away_since = None
        except StorageUnavailable:
            if live.database_away_since is None:
                live.database_away_since = self._context.now()
                log.warning("the database is away; live tables go on from memory")
            return
        if wanted is not None:
            self._load(wanted)
        for machine_id, reading in fresh:
            live.add_readings(machine_id, [reading])
        self._seen_revisions = seen
        self._seen_reading = newest

    def _load(self, wanted: dict[str, tuple[datetime, int]]) -> None:
        live = self._context.live
        have = live.stamps()
        for machine_id in have.keys() - wanted.keys():
            live.forget(machine_id)
        for machine_id, stamp in wanted.items():
            if self._stop.is_set():
                return
            if have.get(machine_id) != stamp:
                try:
                    load_machine(self._context, machine_id)
                except UnknownThing:
                    live.forget(machine_id)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except ThermapError as error:
                log.warning("could not follow the database: %s", error.detail)
            except Exception:
                log.exception("could not follow the database")
            self._stop.wait(self._every_s)
