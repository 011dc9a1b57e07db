"""Keep memory in step with the database: other processes write to it too."""

from __future__ import annotations

import logging
from collections import defaultdict
from datetime import datetime
from threading import Event, Thread

from app.errors import StorageBusy, StorageUnavailable, UnknownThing
from app.live.unseen_numbers import UnseenNumbers
from app.services.context import Context
from app.services.load_machine import load_machine
from app.services.restore_past import restore_past
from app.storage.machines import revisions, sum_of_machines
from app.storage.readings import newest_id, numbered_readings
from app.thermal.reading import Reading

log = logging.getLogger("thermap")

LOOK_BACK = 10_000
"""Readings before the newest at the start among which some may still be on their way."""

Stamp = tuple[datetime, int]


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
        self._sum: object = None
        self._unseen: UnseenNumbers | None = None
        self._broken: dict[str, Stamp] = {}

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
            self._follow()
            live.database_away_since = None
        except StorageBusy as error:
            log.warning("%s", error.detail)
        except StorageUnavailable as error:
            if live.database_away_since is None:
                live.database_away_since = self._context.now()
                log.warning("%s; live tables go on from memory", error.detail)

    def _follow(self) -> None:
        have = self._context.live.stamps()
        with self._context.database.reading() as session:
            total = sum_of_machines(session)
            wanted = revisions(session) if total != self._sum else None
            unseen = self._unseen or UnseenNumbers(newest_id(session) - LOOK_BACK)
            fresh = numbered_readings(session, unseen.highest, unseen.gaps)
        if wanted is not None:
            self._load(have, wanted)
        self._sum = total
        self._add(fresh)
        unseen.saw((number for number, _, _ in fresh), self._context.now())
        self._unseen = unseen

    def _load(self, have: dict[str, Stamp], wanted: dict[str, Stamp]) -> None:
        for machine_id, (born, _) in have.items():
            if machine_id not in wanted or wanted[machine_id][0] != born:
                self._context.live.forget(machine_id)
        for machine_id, stamp in wanted.items():
            if self._stop.is_set():
                return
            if have.get(machine_id) != stamp and self._broken.get(machine_id) != stamp:
                self._load_one(machine_id, stamp)

    def _load_one(self, machine_id: str, stamp: Stamp) -> None:
        """Load a machine; one that cannot be loaded keeps none of the others from it."""
        try:
            load_machine(self._context, machine_id)
        except UnknownThing:
            self._context.live.forget(machine_id)
        except StorageUnavailable:
            raise
        except Exception:
            self._broken[machine_id] = stamp
            log.exception("machine %r cannot be loaded", machine_id)

    def _add(self, fresh: list[tuple[int, str, Reading]]) -> None:
        by_machine: dict[str, list[Reading]] = defaultdict(list)
        for _, machine_id, reading in fresh:
            by_machine[machine_id].append(reading)
        for machine_id, readings in by_machine.items():
            self._context.live.add_readings(machine_id, readings)
        for machine in self._context.live.behind():
            restore_past(self._context, machine)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except Exception:
                log.exception("could not follow the database")
            self._stop.wait(self._every_s)
