"""Keep memory in step with the database: other processes write to it too."""

from __future__ import annotations

import logging
from collections import defaultdict
from contextlib import suppress
from datetime import datetime
from threading import Event, Thread
from time import monotonic

from app.errors import StorageUnavailable, UnknownThing
from app.live.database_watch import TroubleKind
from app.live.registry import Arrived
from app.live.unseen_numbers import UnseenNumbers
from app.services.context import Context
from app.services.load_machine import load_machine, restore_past
from app.storage.limits import QUESTION
from app.storage.machines import revisions, sum_of_machines
from app.storage.readings import NumberedReading, newest_id, numbered_readings
from app.thermal.reading import Reading

log = logging.getLogger("thermap")

LOOK_BACK = 10_000
"""Readings before the newest at the start among which some may still be on their way."""

LOCKED_S = 5.0
"""A database that has taken nothing for so long is said to be locked [s]."""

Stamp = tuple[datetime, int, int]
"""Birth, revision and withdrawals of a machine."""


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
        self._written_s = monotonic()
        self._writable_at: datetime | None = None

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self, patience_s: float = 10.0) -> None:
        """End, and wait for the end; not for ever, since the database may hang."""
        self._stop.set()
        self._thread.join(patience_s)

    def look(self) -> None:
        """Look once: note whether the database is there, and load what has changed."""
        watch = self._context.live.database
        began = self._context.now()
        watch.note_question(began)
        try:
            self._follow()
            if self._takes_writes():
                watch.note_recovery()
            elif watch.note_trouble(TroubleKind.LOCKED, self._writable_at or began):
                log.warning("the database is locked: nothing can be stored")
        except StorageUnavailable as error:
            if watch.note_trouble(TroubleKind.AWAY, began):
                log.warning("%s; live tables go on from memory", error.detail)

    def _takes_writes(self) -> bool:
        """Whether something could be written within the last seconds."""
        if self._context.database.takes_writes():
            self._written_s, self._writable_at = monotonic(), self._context.now()
            return True
        return monotonic() - self._written_s < LOCKED_S

    def _follow(self) -> None:
        live = self._context.live
        have = live.stamps()
        with self._context.database.reading(QUESTION) as session:
            total = sum_of_machines(session)
            wanted = revisions(session) if total != self._sum else None
            unseen = self._unseen or UnseenNumbers(newest_id(session) - LOOK_BACK)
            fresh = numbered_readings(session, unseen.highest, unseen.gaps)
        live.database.note_answer()
        # First what came, then what changed: among what came may be what was withdrawn since.
        self._add(fresh)
        if wanted is not None:
            self._load(have, wanted)
        self._sum = total
        for machine in self._context.live.behind():
            with suppress(UnknownThing):
                restore_past(self._context, machine)
        unseen.mark_seen((reading.number for reading in fresh), self._context.now())
        self._unseen = unseen

    def _load(self, have: dict[str, Stamp], wanted: dict[str, Stamp]) -> None:
        for machine_id, (born, *_) in have.items():
            if machine_id not in wanted or wanted[machine_id][0] != born:
                self._context.live.forget(machine_id)
        for machine_id, stamp in wanted.items():
            if self._stop.is_set():
                return
            if have.get(machine_id) != stamp and self._broken.get(machine_id) != stamp:
                self._load_one(machine_id, have.get(machine_id), stamp)

    def _load_one(self, machine_id: str, known: Stamp | None, stamp: Stamp) -> None:
        """Load a machine; one that cannot be loaded keeps none of the others from it."""
        live = self._context.live.get(machine_id)
        if live is not None and known is not None and known[:2] == stamp[:2]:
            live.expect(stamp[2])  # the model is the same: only readings were withdrawn
            return
        try:
            load_machine(self._context, machine_id)
        except UnknownThing:
            self._context.live.forget(machine_id)
        except StorageUnavailable:
            raise
        except Exception:
            self._broken[machine_id] = stamp
            log.exception("machine %r cannot be loaded", machine_id)

    def _add(self, fresh: list[NumberedReading]) -> None:
        arrived: dict[tuple[str, int], list[Reading]] = defaultdict(list)
        for got in fresh:
            arrived[got.machine_id, got.withdrawals].append(got.reading)
        until = self._context.usable_until()
        for (machine_id, withdrawals), readings in arrived.items():
            live = self._context.live.get(machine_id)
            if live is not None:  # others load theirs later
                live.add(Arrived(readings, withdrawals), until)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except Exception:
                log.exception("could not follow the database")
            self._stop.wait(self._every_s)
