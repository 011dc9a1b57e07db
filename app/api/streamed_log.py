"""What streams send of the event log, of watches and of analyses.

The log is read once for all who follow it, and its end is kept in memory, written as it is sent.
Each follower knows the number of the entry that it had last: it is sent next what comes after that
in memory, and of what is in memory no more the count. So a follower that reads slowly, or comes
back late, costs nothing that grows.
"""

from __future__ import annotations

import asyncio
import math
import time
from bisect import bisect_right
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final, Literal, NamedTuple, TypeAlias

from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool

from app.access.authorization import as_service
from app.events.event import Event, EventKind
from app.events.news import AnalysisNews, MissedEntries, WatchChange
from app.services.context import Context
from app.services.log_tail import LogNow, count_log, read_log_now

NewsKind: TypeAlias = Literal["event", "watch", "analysis"]
"""Names of events under which entries of the log are sent; each entry is sent under one of them."""

NEWS: Final[frozenset[str]] = frozenset(("event", "watch", "analysis"))

MOST_ENTRIES: Final = 1000
"""Entries in memory, of all machines: for those who come back, and for those who read slowly."""

AT_ONCE: Final = 100
"""Entries that a follower is sent before its tables have their turn again."""

ASK_EVERY_S: Final = 2.0
"""How often the log is read although nobody said that it has changed [s]."""

ASK_FILE_EVERY_S: Final = 0.4
"""The same of a SQLite file: of what another process wrote nobody says anything [s]."""

PROGRESS_EVERY_S: Final = 2.0
"""Progress of an analysis is sent no more often [s]."""

_EVENT: Final = TypeAdapter(Event)
_WATCH: Final = TypeAdapter(WatchChange)
_ANALYSIS: Final = TypeAdapter(AnalysisNews)
_MISSED: Final = TypeAdapter(MissedEntries)

Sees: TypeAlias = Callable[[str | None, int], bool]
"""Whether an entry may be sent, by its machine's id and its number."""


class Entry(NamedTuple):
    """An entry as it is sent: its number, whose it is, and the event's name and JSON."""

    number: int
    machine: str | None
    name: str
    content: bytes


class News(NamedTuple):
    """An event that a follower is sent: whose it is, its name and its JSON."""

    machine: str
    name: str
    content: bytes


@dataclass(frozen=True, slots=True)
class Running:
    """How far an analysis is, as it is sent, and when that was read."""

    news: AnalysisNews
    content: bytes
    read_s: float


class StreamedLog:
    """The end of the log in memory, and the analyses that run.

    `floor` is the number up to which entries are no longer in memory, `newest` that of the last
    entry; both are None before the log was read.
    """

    def __init__(self, context: Callable[[], Context]) -> None:
        self._context = context
        self._followers = 0
        self._asking = asyncio.Lock()
        self._asked_s = -math.inf
        self._mark: object = None
        self._entries: Sequence[Entry] = ()
        self._numbers: Sequence[int] = ()
        self.floor: int | None = None
        self.newest: int | None = None
        self.running: Mapping[str, Running] = {}

    @contextmanager
    def following(self) -> Iterator[None]:
        """Count a follower: the log is read as long as there is one."""
        self._followers += 1
        try:
            yield
        finally:
            self._followers -= 1
            if not self._followers:
                self._asked_s = -math.inf  # what comes now is not read

    def is_due(self, now_s: float) -> bool:
        """Whether somebody follows it, and it has changed or may have."""
        if not self._followers:
            return False
        database = self._context().database
        every_s = ASK_FILE_EVERY_S if database.is_sqlite else ASK_EVERY_S
        return database.log_mark is not self._mark or now_s - self._asked_s >= every_s

    async def ask(self, since_s: float) -> bool:
        """Read the log, unless somebody began to since a time; True where something is new."""
        async with self._asking:
            if self._asked_s >= since_s:
                return False
            context = self._context()
            # Before it is read: what is written meanwhile may not be in it, and makes it due again.
            # Who waited for the lock, and asks since a time before, finds it read.
            asked_s, mark = time.monotonic(), context.database.log_mark
            with as_service():  # it is read for all who follow
                log = await run_in_threadpool(read_log_now, context, self.newest, MOST_ENTRIES)
            self._asked_s = asked_s
            if log is None:
                return False
            self._mark = mark
            return self._take(log, asked_s)

    async def ask_first(self) -> None:
        """Read the log where that has not been done since somebody follows it."""
        if self._asked_s == -math.inf:
            await self.ask(0.0)

    def next_after(self, number: int) -> Entry | None:
        """Give the first entry after a number that is in memory."""
        place = bisect_right(self._numbers, number)
        return self._entries[place] if place < len(self._entries) else None

    async def count(
        self, after: int, until: int, wants: Callable[[str | None, int, str], bool]
    ) -> int | None:
        """Count what somebody wants of the entries after one up to another; None: not known."""
        with as_service():
            counted = await run_in_threadpool(count_log, self._context(), after, until)
        if counted is None:
            return None
        return sum(
            count
            for (machine, kind, is_present), count in counted.items()
            # Of an older machine of the id: what a key for this one sees comes later than that.
            if wants(machine, until if is_present else 0, _name_of(kind))
        )

    def _take(self, log: LogNow, read_s: float) -> bool:
        tail = log.tail
        fresh = [_entry(number, event) for number, event in tail.entries]
        if self.newest is None or tail.after > self.newest:
            entries = fresh
            self.floor = tail.after
        else:
            entries = [*self._entries, *fresh]
        if len(entries) > MOST_ENTRIES:
            self.floor = entries[-MOST_ENTRIES - 1].number
            entries = entries[-MOST_ENTRIES:]
        running = {job.machine: self._paced(job, read_s) for job in log.running}
        is_new = bool(fresh) or running != self.running
        self.newest = tail.newest
        if fresh or self.floor is None:
            self._entries, self._numbers = entries, [entry.number for entry in entries]
        self.running = running
        return is_new

    def _paced(self, job: AnalysisNews, read_s: float) -> Running:
        """Say how far an analysis is: not each per cent, and not ever so often."""
        job_before = self.running.get(job.machine)
        if job_before is not None and job_before.news.analysis == job.analysis:
            before = replace(job_before.news, time=job.time)
            # The very same object: followers tell by it that there is nothing new.
            if before == job or read_s - job_before.read_s < PROGRESS_EVERY_S:
                return job_before
        return Running(job, _ANALYSIS.dump_json(job), read_s)


class LogFollower:
    """What one follower was last sent of the log, and what it is to be sent next.

    Parameters
    ----------
    kinds
        Names of the events that it wants, of `NEWS`; without any of them nothing is sent.
    machine_id
        Whose events it wants; None for all.
    last
        Number of the entry that it had last; None: what comes from now on.
    """

    def __init__(
        self,
        log: StreamedLog,
        kinds: Collection[str],
        sees: Sees,
        machine_id: str | None,
        last: int | None,
    ) -> None:
        self._log = log
        self._kinds = NEWS.intersection(kinds)
        self._sees = sees
        self._machine_id = machine_id
        self._running: dict[str, Running] = {}
        self._is_unknown = False
        self.cursor = last

    async def begin(self) -> None:
        """Find out where it is to go on."""
        await self._log.ask_first()
        if self._is_ahead():
            # Another service has told more than is known here yet, or the log is another one.
            await self._log.ask(time.monotonic())
            if self._is_ahead():
                self.cursor, self._is_unknown = self._log.newest, True
        elif self.cursor is None:
            self.cursor = self._log.newest

    async def next(self) -> News | None:
        """Give what is due next, the log before the analyses that run; None: nothing."""
        if not self._kinds or self._log.newest is None or self._log.floor is None:
            return None
        if self._is_unknown:
            self._is_unknown = False
            return self._missed(None)
        #                    floor                newest
        #     ────────────────┼────────────────────┼──────▶ numbers of entries
        #      in the database│     in memory      │ to come
        #      counted, told  │     sent one by    │
        #      as `missed`    │     one            │
        #
        # A cursor beyond `newest` is of another log, or ahead of this service (`begin`).
        if self.cursor is None:
            self.cursor = self._log.newest
        if self.cursor < self._log.floor:
            began, self.cursor = self.cursor, self._log.floor
            count = await self._log.count(began, self.cursor, self._wants)
            if count != 0:
                return self._missed(count)
        while (entry := self._log.next_after(self.cursor)) is not None:
            self.cursor = entry.number
            if self._wants(entry.machine, entry.number, entry.name):
                return News(entry.machine or "", entry.name, entry.content)
        self.cursor = max(self.cursor, self._log.newest)
        return self._progress()

    def _is_ahead(self) -> bool:
        newest = self._log.newest
        return newest is not None and self.cursor is not None and self.cursor > newest

    def _wants(self, machine: str | None, number: int, name: str) -> bool:
        if name not in self._kinds or not self._sees(machine, number):
            return False
        return self._machine_id is None or machine == self._machine_id

    def _progress(self) -> News | None:
        """Tell of an analysis that runs, where it is further than this follower knows."""
        running = self._log.running
        if not running:
            self._running.clear()
            return None
        now = self._log.newest or 0
        for machine, job in running.items():
            if self._wants(machine, now, "analysis") and self._running.get(machine) is not job:
                self._running[machine] = job
                return News(machine, "analysis", job.content)
        return None

    def _missed(self, count: int | None) -> News:
        words = "entries of the event log cannot be sent any more; the log itself has them"
        how_many = "an unknown number of" if count is None else f"{count}"
        missed = MissedEntries(count, f"{how_many} {words}")
        return News(self._machine_id or "", "missed", _MISSED.dump_json(missed))


def _name_of(kind: EventKind) -> str:
    """Say under which name entries of a kind are sent."""
    return str(kind) if kind in (EventKind.WATCH, EventKind.ANALYSIS) else "event"


def _entry(number: int, event: Event) -> Entry:
    """Write an entry of the log as it is sent."""
    name, details = _name_of(event.kind), event.details
    if name == "watch" and event.machine is not None:
        since = details.get("since")
        watch = WatchChange(
            machine=event.machine,
            time=event.time,
            watch=details["to"],
            before=details["from"],
            model_version=details["version"],
            drifting_since=None if since is None else datetime.fromisoformat(since),
            who=event.who,
        )
        return Entry(number, event.machine, name, _WATCH.dump_json(watch))
    if name == "analysis" and event.machine is not None and "status" in details:
        analysis = AnalysisNews(
            machine=event.machine,
            analysis=details["analysis"],
            status=details["status"],
            progress=1.0 if details["status"] == "done" else 0.0,
            message=details["message"],
            time=event.time,
            who=event.who,
        )
        return Entry(number, event.machine, name, _ANALYSIS.dump_json(analysis))
    # What an older version wrote of analyses says no status.
    return Entry(number, event.machine, "event", _EVENT.dump_json(event))
