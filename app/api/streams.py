"""What changes, sent as it changes: tables, verdicts and news as server-sent events.

One task looks at every machine that somebody follows, five times a second, and writes a table
once, however many follow it. Each follower compares that with what it was sent last, so that a
slow one skips what lies between and nothing piles up. The same task reads the event log, for all
who follow it (`app.api.streamed_log`).
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterator, Sequence
from contextlib import aclosing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

from fastapi.sse import format_sse_event
from starlette.concurrency import run_in_threadpool

from app.access.authorization import as_service
from app.api.access import Viewer
from app.api.streamed_log import AT_ONCE, NEWS, LogFollower, StreamedLog
from app.api.streamed_table import Feed, Table, judge_anew, remember, write_step, write_table
from app.api.table_json import current_table_json
from app.compensation.table_steps import Curves, have_same_layout, largest_change, step_towards
from app.connections.connection import TableEvent
from app.errors import ThermapError
from app.live.registry import LiveMachine
from app.rounding import DECIMALS
from app.services.context import Context
from app.services.live_table import CurrentState, current_state
from app.services.status import Stored, stored_of_machines

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 0.2
"""How often machines are looked at [s]: a reading is in a follower's hand that soon."""

JUDGE_EVERY_S: Final = 1.0
"""How often a verdict is judged anew where nothing came [s]: temperatures grow old."""

ASK_EVERY_S: Final = 2.0
"""How often the database is asked for watches and analyses [s]."""

HEARTBEAT_S: Final = 15.0
"""After so long without an event a comment says that the stream lives [s]."""

CONFIRM_EVERY_S: Final = 1.0
"""How often a stream looks whether its key is still one, where nothing is sent [s]."""

STEP_S: Final = 1.0
"""Between the steps of a change that is larger than a follower takes at once [s]."""

TABLES: Final[frozenset[str]] = frozenset(("table", "status"))
"""What is sent to those who do not say what they want; with `table` comes `state`."""

MARKS: Final = 1_000_000
"""Numbers of tables end in digits that are one service's own: to another they say nothing."""

EVERYTHING: Final = Viewer()
"""Who may be sent all there is."""

_ROUNDING: Final = 1e-9
"""Of a limit on a change: differences of rounded numbers."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a follower wants to be sent.

    Parameters
    ----------
    min_change
        A table comes when one of its values has changed by more than this [the value's unit].
    max_step
        No value changes by more than this from one table to the next [the value's unit]; None
        for no limit.
    heartbeat_s
        After so long without an event a `heartbeat` comes [s]; None: a comment after 15 s, which
        programs in a browser do not see.
    kinds
        Of `TABLES` and `app.api.streamed_log.NEWS`.
    """

    min_change: float = 0.1
    max_step: float | None = None
    last_number: int | None = None
    heartbeat_s: float | None = None
    kinds: frozenset[str] = TABLES
    last_entry: int | None = None


class StreamEvent(NamedTuple):
    """An event: whose it is, its id, its name and its JSON; without a name the id alone."""

    machine: str
    id: str
    name: str = ""
    content: bytes = b""


class TableStreams:
    """The machines that are followed, and who follows them."""

    def __init__(self, context: Callable[[], Context]) -> None:
        self._context = context
        self._feeds: dict[str, Feed] = {}
        self._followed: dict[str, int] = {}
        self._all = 0
        self._looking: asyncio.Task[None] | None = None
        self._stored = Stored()
        self._asked_s = 0.0
        self._news = asyncio.Event()
        self._number = int(time.time()) * MARKS + secrets.randbelow(MARKS)
        self._log = StreamedLog(context)
        self._log_mark: object = None
        self._ends = False

    def end(self) -> None:
        """End all streams, after what they have to send now; to be called by the loop."""
        self._ends = True
        self._wake_all()

    async def follow(
        self, machine_id: str | None, wanted: Wanted, viewer: Viewer = EVERYTHING
    ) -> AsyncIterator[bytes]:
        """Send what changes of one machine, or of all, until follower, key or machine goes.

        Yields
        ------
        bytes
            Events: `status`, `table`, `state`, `event`, `watch`, `analysis`, `missed`; comments as
            heartbeats.
        """
        heartbeat = format_sse_event(comment="heartbeat")
        if wanted.heartbeat_s is not None:
            heartbeat = format_sse_event(event="heartbeat", data_str="{}")
        async with aclosing(self._events(machine_id, wanted, viewer)) as events:
            async for stream_event in events:
                yield heartbeat if stream_event is None else _written(stream_event)

    async def all_tables(
        self, min_change: float, max_step: float | None
    ) -> AsyncGenerator[TableEvent, None]:
        """Give what changes of all machines to those who do not ask over HTTP."""
        wanted = Wanted(min_change, max_step)
        async with aclosing(self._events(None, wanted, EVERYTHING)) as events:
            async for stream_event in events:
                if stream_event is not None:
                    yield TableEvent(stream_event.machine, stream_event.name, stream_event.content)

    async def _events(
        self, machine_id: str | None, wanted: Wanted, viewer: Viewer
    ) -> AsyncGenerator[StreamEvent | None, None]:
        """Give each event; None for a heartbeat."""
        if self._looking is None or self._looking.done():
            await self._ask()
        log_wanted = bool(wanted.kinds & NEWS)
        with self._following(machine_id), self._log.following() if log_wanted else nullcontext():
            self._look_at(self._machines(machine_id))
            entries = LogFollower(
                self._log, wanted.kinds, viewer.sees_entry, machine_id, wanted.last_entry
            )
            at = Place(wanted.last_number or 0, entries if log_wanted else None)
            if log_wanted:
                await entries.begin()
                yield StreamEvent(
                    "", at.id
                )  # who breaks off before the first event has missed none
            wanted = replace(wanted, last_number=self._own(wanted.last_number))
            heartbeat_s = wanted.heartbeat_s or HEARTBEAT_S
            followers: dict[str, Follower] = {}
            sent_s = time.monotonic()
            while viewer.is_welcome():
                # Taken before anything is looked at: what becomes new from here on sets this very
                # event, so that the wait at the end returns at once.
                news = self._news
                now_s = time.monotonic()
                feeds = [f for f in self._followed_feeds(machine_id) if viewer.sees(f.machine_id)]
                for feed in feeds:
                    follower = followers.setdefault(feed.machine_id, Follower(wanted, feed))
                    for name, at.table, content in follower.due(feed, now_s, self._next_number):
                        sent_s = now_s
                        yield StreamEvent(feed.machine_id, at.id, name, content)
                is_gone = machine_id is not None and not feeds
                if is_gone and log_wanted:
                    await self._log.ask(now_s)  # it was deleted, and the log says so
                budget = AT_ONCE
                while (is_gone or budget) and (entry := await entries.next()) is not None:
                    budget, sent_s = budget - 1, now_s
                    yield StreamEvent(entry.machine, at.id, entry.name, entry.content)
                if self._ends or is_gone:
                    return
                if log_wanted and not budget:
                    continue
                if now_s - sent_s >= heartbeat_s:
                    sent_s = now_s
                    yield None
                # The next step is due by the clock: no news tells of it.
                steps = any(follower.is_stepping for follower in followers.values())
                wait_s = STEP_S / 4 if steps else sent_s + heartbeat_s - now_s
                wait_s = min(wait_s, CONFIRM_EVERY_S)
                try:
                    await asyncio.wait_for(news.wait(), wait_s)
                except TimeoutError:
                    continue

    @contextmanager
    def _following(self, machine_id: str | None) -> Iterator[None]:
        """Count a follower, and look for as long as there is any."""
        if machine_id is None:
            self._all += 1
        else:
            self._followed[machine_id] = self._followed.get(machine_id, 0) + 1
        if self._looking is None or self._looking.done():
            with as_service():  # it looks for all who follow
                self._looking = asyncio.create_task(self._look())
        try:
            yield
        finally:
            if machine_id is None:
                self._all -= 1
            else:
                self._followed[machine_id] -= 1
                if not self._followed[machine_id]:
                    del self._followed[machine_id]

    async def _look(self) -> None:
        """Look at every machine that is followed, and at the log, as long as one is."""
        while (self._followed or self._all) and not self._ends:
            await asyncio.sleep(LOOK_EVERY_S)
            try:
                now_s = time.monotonic()
                is_new = self._log.is_due(now_s) and await self._log.ask(now_s)
                is_changed = self._context().database.log_mark is not self._log_mark
                if is_changed or now_s - self._asked_s >= ASK_EVERY_S:
                    await self._ask()
                if self._look_at(self._machines(None)) or is_new:
                    self._wake_all()
            except Exception:
                log.exception("could not look at the machines that are followed")

    async def _ask(self) -> None:
        """Ask the database for watches and analyses, for all who follow."""
        self._asked_s = time.monotonic()
        # Before the database is asked: what is told meanwhile is asked for once more.
        self._log_mark = self._context().database.log_mark
        with as_service():
            self._stored = await run_in_threadpool(stored_of_machines, self._context())

    def _wake_all(self) -> None:
        # Set once and never cleared: who is still writing, and waits for it only later, does not
        # wait.
        self._news, news = asyncio.Event(), self._news
        news.set()

    def _machines(self, machine_id: str | None) -> list[LiveMachine]:
        """List the machines that are followed, or the one."""
        live = self._context().live
        if machine_id is None and self._all:
            return live.machines()
        ids = self._followed if machine_id is None else [machine_id]
        return [machine for id_ in ids if (machine := live.get(id_)) is not None]

    def _followed_feeds(self, machine_id: str | None) -> list[Feed]:
        """List the feeds of the machines that there are, or of the one.

        Tables that are older come first: who breaks off is not taken to have had those.
        """
        ids = self._feeds if machine_id is None else [machine_id]
        feeds = [self._feeds[machine_key] for machine_key in ids if machine_key in self._feeds]
        return sorted(feeds, key=lambda feed: 0 if feed.table is None else feed.table.number)

    def _look_at(self, machines: Sequence[LiveMachine]) -> bool:
        """Bring feeds up to date; True where something is new."""
        context = self._context()
        now_s = time.monotonic()
        gone = [id_ for id_ in self._feeds if context.live.get(id_) is None]
        for machine_id in gone:
            del self._feeds[machine_id]
        is_new = bool(gone)
        for live in machines:
            machine_id = live.current.model.machine.id
            feed = self._feeds.setdefault(machine_id, Feed(machine_id))
            try:
                state: CurrentState | ThermapError = current_state(context, machine_id, live)
            except ThermapError as why:
                state = why
            tag = state.tag if isinstance(state, CurrentState) else state.detail
            if tag != feed.tag or feed.table is None:
                feed.tag = tag
                feed.table = write_table(context, machine_id, state, self._next_number())
                remember(feed.tables, feed.table)
                feed.judged_at_s = 0.0
                is_new = True
            if now_s - feed.judged_at_s >= JUDGE_EVERY_S:
                feed.judged_at_s = now_s
                is_new |= judge_anew(context, live, feed, self._stored)
        return is_new

    def _next_number(self) -> int:
        self._number += MARKS
        return self._number

    def _own(self, number: int | None) -> int | None:
        """Pass on the number of a table of this service; of another one's nothing is known."""
        if number is None or number > self._number or (self._number - number) % MARKS:
            return None
        return number


class Place:
    """How far one follower is: the last table that it was sent, and the last entry of the log."""

    def __init__(self, table: int, entries: LogFollower | None) -> None:
        self.table = table
        self._entries = entries

    @property
    def id(self) -> str:
        """Write it as the id of an event; without the log it is the table's number."""
        if self._entries is None:
            return str(self.table)
        entry = self._entries.cursor
        return f"{self.table}-" if entry is None else f"{self.table}-{entry}"


class Follower:
    """What one follower was last sent of one machine, and what it is to be sent next."""

    def __init__(self, wanted: Wanted, feed: Feed) -> None:
        self._wanted = wanted
        self._sent = feed.known(wanted.last_number)
        self._facts = None if self._sent is None else self._sent.facts
        self._status_key: tuple[Any, ...] | None = None
        self._compared: int | None = None
        self._next_step_s = 0.0
        self.is_stepping = False

    def due(
        self, feed: Feed, now_s: float, next_number: Callable[[], int]
    ) -> Iterator[tuple[str, int, bytes]]:
        """Give name, number and content of the events that are due."""
        table = feed.table
        if table is None:
            return
        if feed.status_key != self._status_key and "status" in self._wanted.kinds:
            self._status_key = feed.status_key
            # It stands before the table: who breaks off between the two has not had that one.
            yield "status", 0 if self._sent is None else self._sent.number, feed.status
        if "table" not in self._wanted.kinds:
            return
        # What a follower with a `max_step` is sent of tables:
        #
        #       a value has changed by more than min_change
        #     ┌───────────┐ ──────────────────────────▶ ┌──────────┐ every STEP_S one more,
        #     │ it has it │                             │ stepping │ towards the table that
        #     └───────────┘ ◀────────────────────────── └──────────┘ holds by then
        #       the rest is within max_step: the table itself
        #
        # The first table comes whole, as there is nothing to step from. On the way min_change does
        # not count: a table that is begun is reached. Where the machine has no table any more a
        # `state` says so, and the next one is a first one again.
        if self.is_stepping and table.curves is not None:
            if now_s >= self._next_step_s:
                yield ("table", *self._step(feed, table, now_s, next_number))
            return
        if table.number == self._compared:
            return
        self._compared = table.number
        if table.curves is None:
            if table.facts != self._facts:
                self._facts = table.facts
                self._sent = None  # who has no table begins anew with the next one
                self.is_stepping = False
                yield "state", table.number, table.content
        elif self._has_changed(table.curves):
            yield ("table", *self._step(feed, table, now_s, next_number))
        elif table.facts != self._facts:
            yield ("state", *self._step(feed, table, now_s, next_number))

    def _has_changed(self, curves: Curves) -> bool:
        """Whether a value has changed by more than the follower leaves aside."""
        sent = None if self._sent is None else self._sent.curves
        if sent is None or not have_same_layout(sent, curves):
            return True
        return largest_change(sent, curves) > self._wanted.min_change + _ROUNDING

    def _step(
        self, feed: Feed, table: Table, now_s: float, next_number: Callable[[], int]
    ) -> tuple[int, bytes]:
        """Send the table, or as much of the way to it as the follower takes at once."""
        limit, sent = self._wanted.max_step, None if self._sent is None else self._sent.curves
        self._facts = table.facts
        if limit is None or table.curves is None or table.current is None:
            self._sent = table
            return table.number, table.content
        self._next_step_s = now_s + STEP_S
        change = 0.0 if sent is None else largest_change(sent, table.curves)
        self.is_stepping = change > limit + _ROUNDING
        if not self.is_stepping or sent is None:
            self._sent = table
            return table.number, current_table_json(table.current, stepping=False)
        curves = step_towards(sent, table.curves, limit / change, DECIMALS)
        self._sent = Table(next_number(), curves, table.facts)
        remember(feed.steps, self._sent)
        return self._sent.number, write_step(table.current, curves)


def _written(event: StreamEvent) -> bytes:
    if not event.name:
        return format_sse_event(id=event.id)
    return format_sse_event(event=event.name, id=event.id, data_str=event.content.decode())
