"""Keep memory in step with the database: other processes write to it too.

On PostgreSQL whoever commits tells the others, and each looks at once at what it was told of.
News can be lost with a connection, and nobody tells what was written by hand: so everything is
looked at after each new connection, and every now and then. On SQLite nobody tells anything, and
everything is looked at each time.
"""

from __future__ import annotations

import logging
import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from datetime import datetime
from time import monotonic
from typing import TYPE_CHECKING, Final

from app.errors import StorageUnavailable, UnknownThing
from app.live.database_watch import TroubleKind
from app.live.registry import Arrived, LiveMachine
from app.live.unseen_numbers import UnseenNumbers
from app.services.background import Background
from app.services.context import Context
from app.services.load_machine import load_machine, restore_past
from app.storage.limits import QUESTION
from app.storage.machines import revisions, sum_of_machines
from app.storage.news import News, NewsKind
from app.storage.readings import NumberedReading, newest_id, numbered_readings
from app.thermal.reading import Reading

if TYPE_CHECKING:
    from app.storage.postgresql import Listener

log = logging.getLogger("thermap")

LOOK_BACK = 10_000
"""Readings before the newest at the start among which some may still be on their way."""

LOCKED_S = 5.0
"""A database that has taken nothing for so long is said to be locked [s]."""

EVERYTHING_S: Final = 5.0
"""How often everything is looked at where news are heard [s]: in case some were lost."""

STOPS_WITHIN_S: Final = 0.25
"""How long one may wait for news before it sees whether it is to end [s]."""

PAUSE_S: Final = 0.02
"""Least pause between two looks [s]: what is told meanwhile is looked at together."""

OWN_PAUSE_S: Final = 0.005
"""Least pause after it heard only its own news [s], of which there may be hundreds a second."""

Stamp = tuple[datetime, int, int]
"""Birth, revision and withdrawals of a machine."""


#   ┌──────────────────────┐   LISTEN answered   ┌───────────────────────────────────────────┐
#   │ look at everything   │ ──────────────────> │ look at everything; then                  │
#   │ every `every_s`      │                     │   told of something:   look at that       │
#   │ (SQLite: for ever)   │ <────────────────── │   every `every_s`:     ping               │
#   └──────────────────────┘   connection lost   │   every EVERYTHING_S:  look at everything │
#                                                └───────────────────────────────────────────┘
#
# No message can be lost between the two. A session is told of every transaction that commits after
# its LISTEN; what was committed before that is seen by the look that begins after it. What commits
# in between is both seen and told, and to look twice does no harm. (To look first and to listen
# then would lose it.) PostgreSQL tells after the commit, so what one is told of is there to be
# read. Where a connection breaks, or a look at what was told has no answer, everything is looked at
# again.
class DatabaseFollower(Background):
    """Looks whether the database is there and what is new in it: when it is told, or regularly.

    Loads all machines at the start, so that their tables go on when the database
    goes away. It runs in a thread of its own; a failure is logged and tried again.

    Parameters
    ----------
    every_s
        How often the database is asked whether it is there, and on SQLite what is new [s].
    refresh_keys
        Called when another process tells that keys have changed.
    """

    def __init__(
        self, context: Context, every_s: float, refresh_keys: Callable[[], None] = lambda: None
    ) -> None:
        super().__init__("database-follower")
        self._context = context
        self._every_s = every_s
        self._refresh_keys = refresh_keys
        self._sum: object = None
        self._unseen: UnseenNumbers | None = None
        self._broken: dict[str, Stamp] = {}
        self._written_s = monotonic()
        self._writable_at: datetime | None = None

    def look(self, news: Collection[News] | None = None) -> bool:
        """Look once: note whether the database is there, and load what has changed.

        Parameters
        ----------
        news
            What others told; None to look at everything.

        Returns
        -------
        bool
            Whether the database answered.
        """
        if news is None:
            return self._asking(self._follow)
        return self._asking(lambda: self._follow_news(news))

    def _asking(self, ask: Callable[[], None]) -> bool:
        """Ask the database, and note whether it is there."""
        watch = self._context.live.database
        began = self._context.now()
        watch.note_question(began)
        try:
            ask()
            if self._takes_writes():
                watch.note_recovery()
            elif watch.note_trouble(TroubleKind.LOCKED, self._writable_at or began):
                log.warning("the database is locked: nothing can be stored")
        except StorageUnavailable as error:
            if watch.note_trouble(TroubleKind.AWAY, began):
                log.warning("%s; live tables go on from memory", error.detail)
            return False
        return True

    def _takes_writes(self) -> bool:
        """Whether something could be written within the last seconds."""
        if self._context.database.takes_writes():
            self._written_s, self._writable_at = monotonic(), self._context.now()
            return True
        return monotonic() - self._written_s < LOCKED_S

    def _follow(self) -> None:
        live = self._context.live
        with self._context.database.reading(QUESTION) as session:
            # Before the machines themselves: what changes after this is in the next sum, and looked
            # at then.
            total = sum_of_machines(session)
        # What is in memory first: a machine that comes while the database is read was not lost.
        have = live.stamps() if total != self._sum else None
        self._pass_over_own()
        with self._context.database.reading(QUESTION) as session:
            wanted = None if have is None else revisions(session)
            unseen = self._unseen or UnseenNumbers(newest_id(session) - LOOK_BACK)
            fresh = numbered_readings(session, unseen.highest, unseen.gaps)
        live.database.note_answer()
        # First what came, then what changed: among what came may be what was withdrawn since.
        self._add(fresh)
        if have is not None and wanted is not None:
            self._load(have, wanted)
        self._sum = total
        self._restore(live.behind())
        # Last of all: had anything failed before, the same numbers would be asked for once more,
        # and memory passes over what it has.
        unseen.mark_seen((reading.number for reading in fresh), self._context.now())
        self._unseen = unseen

    def _follow_news(self, news: Collection[News]) -> None:
        """Look at what others told of alone."""
        live = self._context.live
        if any(item.kind is NewsKind.KEYS for item in news):
            # First: keys of a machine that was deleted are none for another one of its id.
            self._refresh_keys()
        if any(item.kind is NewsKind.LOG for item in news):
            self._context.database.note_log_change()
        machines = {item.machine_id for item in news if item.kind is NewsKind.MACHINE}
        touched = machines | {item.machine_id for item in news if item.kind is NewsKind.READINGS}
        # Before the first look at everything nobody knows from which number on to read.
        if self._unseen is None or not touched:
            live.database.note_answer()
        else:
            have = {
                machine: stamp for machine in machines if (stamp := live.stamp(machine)) is not None
            }
            self._pass_over_own()
            with self._context.database.reading(QUESTION) as session:
                wanted = revisions(session, machines) if machines else {}
                fresh = numbered_readings(session, self._unseen.highest, self._unseen.gaps)
            live.database.note_answer()
            self._add(fresh)
            self._load(have, wanted)
            self._restore(
                live_machine for id_ in touched if (live_machine := live.get(id_)) is not None
            )
            self._unseen.mark_seen((arrival.number for arrival in fresh), self._context.now())

    def _pass_over_own(self) -> None:
        """Ask for nothing that this process stored itself: it is in memory already."""
        numbers = self._context.live.stored_here.take()
        if self._unseen is not None:
            self._unseen.mark_known(numbers, self._context.now())

    def _restore(self, machines: Iterable[LiveMachine]) -> None:
        for machine in machines:
            with suppress(UnknownThing):
                restore_past(self._context, machine)

    def _load(self, have: dict[str, Stamp], wanted: dict[str, Stamp]) -> None:
        for machine_id, (born, *_) in have.items():
            if machine_id not in wanted or wanted[machine_id][0] != born:
                self._context.live.forget(machine_id)
        for machine_id, stamp in wanted.items():
            if self._stop.is_set():
                return
            if have.get(machine_id) != stamp and self._broken.get(machine_id) != stamp:
                self._load_one(machine_id, have.get(machine_id), stamp)

    def _load_one(self, machine_id: str, before: Stamp | None, stamp: Stamp) -> None:
        """Load a machine; one that cannot be loaded keeps none of the others from it."""
        live = self._context.live.get(machine_id)
        if live is not None and before is not None and before[:2] == stamp[:2]:
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
        listener = self._context.database.listener()
        while not self._stop.is_set():
            try:
                if listener is not None and _connects(listener):
                    self._follow_told(listener)
                    continue
                self.look()
            except Exception:
                log.exception("could not follow the database")
            self._stop.wait(self._every_s)
        if listener is not None:
            listener.close()

    def _follow_told(self, listener: Listener) -> None:
        """Look at everything, then at what is told, until the connection is lost or the end."""
        whole_s = asked_s = -math.inf
        while not self._stop.is_set():
            now_s = monotonic()
            if now_s - whole_s >= EVERYTHING_S:
                whole_s = asked_s = now_s
                answered = self.look()
            elif now_s - asked_s >= self._every_s:
                asked_s = now_s
                answered = self._asking(listener.ping)
            else:
                try:
                    # Not for as long as nothing comes: between two times it sees whether it is to
                    # stop.
                    news = listener.hear(min(STOPS_WITHIN_S, self._every_s))
                except StorageUnavailable as error:
                    log.info("%s; listens again", error.detail)
                    return
                if not news:
                    self._stop.wait(OWN_PAUSE_S)
                    continue
                answered = self.look(news)
                # What is told during the pause is looked at together with what comes next.
                self._stop.wait(PAUSE_S)
            if not listener.is_connected:
                return
            if not answered:
                whole_s = -math.inf  # what was told may not have been looked at
                self._stop.wait(self._every_s)


def _connects(listener: Listener) -> bool:
    try:
        listener.connect()
    except StorageUnavailable:
        return False  # the look that comes now says so
    return True
