"""What changes, told as it changes: tables, verdicts and news as server-sent events.

One task looks at every machine that somebody follows, five times a second, and writes a table
once, however many follow it. Each follower compares that with what it was told last, so that a
slow one skips what lies between and nothing piles up. The same task reads the event log, for all
who are told of it (`app.api.streamed_log`).
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections import OrderedDict
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Iterator, Sequence
from contextlib import aclosing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
import orjson
from fastapi.sse import format_sse_event
from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool

from app.api.streamed_log import AT_ONCE, NEWS, LogFollower, Sees, StreamedLog
from app.api.table_json import OPTIONS, current_table_json
from app.arrays import FloatArray
from app.connections.connection import TableEvent
from app.errors import ThermapError
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import CurrentState, current_state, current_table
from app.services.status import Stored, status_of, stored_of_machines
from app.status.machine_status import MachineStatus

log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 0.2
"""How often machines are looked at [s]: a reading is in a follower's hand that soon."""

JUDGE_EVERY_S: Final = 1.0
"""How often a verdict is judged anew where nothing came [s]: temperatures grow old."""

ASK_EVERY_S: Final = 2.0
"""How often the database is asked for watches and analyses [s]."""

HEARTBEAT_S: Final = 15.0
"""After so long without an event a comment says that the stream lives [s]."""

STEP_S: Final = 1.0
"""Between the steps of a change that is larger than a follower takes at once [s]."""

REMEMBERED: Final = 64
"""Tables of each machine that are remembered, for followers that come back."""

REMEMBERED_BYTES: Final = 4 * 2**20
"""Room for the numbers of those of one machine [bytes]: 64 of 8,000 numbers, fewer of more."""

TABLES: Final[frozenset[str]] = frozenset(("table", "status"))
"""What is told to those who do not say what they want; with `table` comes `state`."""

MARKS: Final = 1_000_000
"""Numbers of tables end in digits that are one service's own: to another they say nothing."""

_ROUNDING: Final = 1e-9
"""Of a limit on a change: differences of rounded numbers."""

_STATUS: Final = TypeAdapter(MachineStatus)


@dataclass(frozen=True, slots=True)
class Table:
    """A table as it is told, or why there is none.

    Parameters
    ----------
    number
        Later tables of this service have larger ones.
    content
        The JSON of `GET …/compensation`; empty in those that are remembered.
    layout
        Which numbers `values` are: tables of other positions or components cannot be compared.
    values
        All errors and compensations, in their order; empty without a table.
    facts
        Completeness, model version and the sensors' health.
    """

    number: int
    content: bytes
    layout: bytes
    values: FloatArray
    facts: tuple[Any, ...]

    @property
    def has_values(self) -> bool:
        """Whether there is a table."""
        return bool(self.layout)


@dataclass(slots=True)
class Feed:
    """What is known of one machine, for all who follow it."""

    machine_id: str
    table: Table | None = None
    status: bytes = b""
    status_key: tuple[Any, ...] = ()
    tag: str = ""
    judged_at_s: float = 0.0
    tables: OrderedDict[int, Table] = field(default_factory=OrderedDict)
    steps: OrderedDict[int, Table] = field(default_factory=OrderedDict)

    def known(self, number: int | None) -> Table | None:
        """Find the table that held when an event of this number was told; None if unknown.

        The event may have been another machine's: then it is the last one before it. Before the
        first that is remembered there may have been others.
        """
        if number is None:
            return None
        if number in self.steps:
            return self.steps[number]
        until = [one for one in self.tables if one <= number]
        return self.tables[until[-1]] if until else None


def _remember(tables: OrderedDict[int, Table], table: Table) -> None:
    """Keep what a later table is compared with, for those who come back."""
    layout = table.layout
    if tables and (last := tables[next(reversed(tables))]).layout == layout:
        layout = last.layout  # most often the same: all share one
    tables[table.number] = replace(table, content=b"", layout=layout)
    taken = sum(one.values.nbytes for one in tables.values())
    while len(tables) > REMEMBERED or taken > REMEMBERED_BYTES:
        _, oldest = tables.popitem(last=False)
        taken -= oldest.values.nbytes


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a follower wants to be told.

    Parameters
    ----------
    min_change
        A table comes when one of its values has changed by more than this [the value's unit].
    max_step
        No value changes by more than this from one table to the next [the value's unit]; None
        for no limit.
    last_number
        Number of the last table that the follower has had.
    heartbeat_s
        After so long without an event a `heartbeat` comes [s]; None: a comment after 15 s, which
        programs in a browser do not see.
    kinds
        Of `TABLES` and `app.api.streamed_log.NEWS`.
    last_entry
        Number of the last entry of the log that the follower has had.
    """

    min_change: float = 0.1
    max_step: float | None = None
    last_number: int | None = None
    heartbeat_s: float | None = None
    kinds: frozenset[str] = TABLES
    last_entry: int | None = None


class Told(NamedTuple):
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
        """End all streams, after what they have to tell now; to be called by the loop."""
        self._ends = True
        self._tell_all()

    async def follow(
        self,
        machine_id: str | None,
        wanted: Wanted,
        sees: Callable[[str], bool] = lambda _machine_id: True,
    ) -> AsyncIterator[bytes]:
        """Tell of one machine, or of all that it sees, until the follower goes, or what it follows.

        Yields
        ------
        bytes
            Events: `status`, `table`, `state`, `event`, `watch`, `analysis`, `missed`; comments as
            heartbeats.
        """
        heartbeat = format_sse_event(comment="heartbeat")
        if wanted.heartbeat_s is not None:
            heartbeat = format_sse_event(event="heartbeat", data_str="{}")
        async with aclosing(self._told(machine_id, wanted, sees)) as told:
            async for one in told:
                yield heartbeat if one is None else _event(one)

    async def all_tables(
        self, min_change: float, max_step: float | None
    ) -> AsyncGenerator[TableEvent, None]:
        """Tell of all machines, as `follow` does, those who do not ask over HTTP."""
        wanted = Wanted(min_change, max_step)
        async with aclosing(self._told(None, wanted, lambda _machine_id: True)) as told:
            async for one in told:
                if one is not None:
                    yield TableEvent(one.machine, one.name, one.content)

    async def _told(
        self, machine_id: str | None, wanted: Wanted, sees: Sees
    ) -> AsyncGenerator[Told | None, None]:
        """Give each event; None for a heartbeat."""
        if self._looking is None or self._looking.done():
            await self._ask()
        log_wanted = bool(wanted.kinds & NEWS)
        with self._following(machine_id), self._log.following() if log_wanted else nullcontext():
            self._look_at(self._machines(machine_id))
            entries = LogFollower(self._log, wanted.kinds, sees, machine_id, wanted.last_entry)
            at = Place(wanted.last_number or 0, entries if log_wanted else None)
            if log_wanted:
                await entries.begin()
                yield Told("", at.id)  # who breaks off before the first event has missed none
            wanted = replace(wanted, last_number=self._own(wanted.last_number))
            heartbeat_s = wanted.heartbeat_s or HEARTBEAT_S
            followers: dict[str, Follower] = {}
            told_s = time.monotonic()
            while True:
                news = self._news
                now_s = time.monotonic()
                feeds = [f for f in self._followed_feeds(machine_id) if sees(f.machine_id)]
                for feed in feeds:
                    follower = followers.setdefault(feed.machine_id, Follower(wanted, feed))
                    for name, at.table, content in follower.due(feed, now_s, self._next_number):
                        told_s = now_s
                        yield Told(feed.machine_id, at.id, name, content)
                is_gone = machine_id is not None and not feeds
                if is_gone and log_wanted:
                    await self._log.ask(now_s)  # it was deleted, and the log says so
                left = AT_ONCE
                while (is_gone or left) and (one := await entries.next()) is not None:
                    left, told_s = left - 1, now_s
                    yield Told(one.machine, at.id, one.name, one.content)
                if self._ends or is_gone:
                    return
                if log_wanted and not left:
                    continue
                if now_s - told_s >= heartbeat_s:
                    told_s = now_s
                    yield None
                steps = any(follower.is_stepping for follower in followers.values())
                wait_s = STEP_S / 4 if steps else told_s + heartbeat_s - now_s
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
                is_new = await self._read_log(now_s)
                is_changed = self._context().database.log_mark is not self._log_mark
                if is_changed or now_s - self._asked_s >= ASK_EVERY_S:
                    await self._ask()
                if self._look_at(self._machines(None)) or is_new:
                    self._tell_all()
            except Exception:
                log.exception("could not look at the machines that are followed")

    async def _ask(self) -> None:
        """Ask the database for watches and analyses."""
        self._asked_s = time.monotonic()
        self._log_mark = self._context().database.log_mark
        self._stored = await run_in_threadpool(stored_of_machines, self._context())

    async def _read_log(self, now_s: float) -> bool:
        """Read the log where that is due; True where something is new."""
        return self._log.is_due(now_s) and await self._log.ask(now_s)

    def _tell_all(self) -> None:
        self._news, news = asyncio.Event(), self._news
        news.set()

    def _machines(self, machine_id: str | None) -> list[LiveMachine]:
        """List the machines that are followed, or the one."""
        live = self._context().live
        if machine_id is None and self._all:
            return live.machines()
        ids = self._followed if machine_id is None else [machine_id]
        return [machine for one in ids if (machine := live.get(one)) is not None]

    def _followed_feeds(self, machine_id: str | None) -> list[Feed]:
        """List the feeds of the machines that there are, or of the one.

        Tables that are older come first: who breaks off is not taken to have had those.
        """
        ids = self._feeds if machine_id is None else [machine_id]
        feeds = [self._feeds[one] for one in ids if one in self._feeds]
        return sorted(feeds, key=lambda feed: 0 if feed.table is None else feed.table.number)

    def _look_at(self, machines: Sequence[LiveMachine]) -> bool:
        """Bring feeds up to date; True where something is new."""
        context = self._context()
        now_s = time.monotonic()
        gone = [one for one in self._feeds if context.live.get(one) is None]
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
                feed.table = _table(context, machine_id, state, self._next_number())
                _remember(feed.tables, feed.table)
                feed.judged_at_s = 0.0
                is_new = True
            if now_s - feed.judged_at_s >= JUDGE_EVERY_S:
                feed.judged_at_s = now_s
                is_new |= _judge(context, live, feed, self._stored)
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
    """How far one follower is: the last table that it was told, and the last entry of the log."""

    def __init__(self, table: int, entries: LogFollower | None) -> None:
        self.table = table
        self._entries = entries

    @property
    def id(self) -> str:
        """Write it as the id of an event; who is not told of the log has the table's number."""
        if self._entries is None:
            return str(self.table)
        entry = self._entries.cursor
        return f"{self.table}-" if entry is None else f"{self.table}-{entry}"


class Follower:
    """What one follower was told of one machine last, and what it is to be told next."""

    def __init__(self, wanted: Wanted, feed: Feed) -> None:
        self._wanted = wanted
        self._told = feed.known(wanted.last_number)
        self._facts = None if self._told is None else self._told.facts
        self._status_key: tuple[Any, ...] | None = None
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
            yield "status", 0 if self._told is None else self._told.number, feed.status
        if "table" not in self._wanted.kinds:
            return
        if table.has_values and (self._has_changed(table) or self.is_stepping):
            if self.is_stepping and now_s < self._next_step_s:
                return
            yield self._step(feed, table, now_s, next_number)
        elif table.facts != self._facts:
            self._facts = table.facts
            if not table.has_values:
                self._told = None  # who has no table begins anew with the next one
                self.is_stepping = False
            yield "state", table.number, table.content

    def _has_changed(self, table: Table) -> bool:
        """Whether a value has changed by more than the follower leaves aside."""
        told = self._told
        if told is None or told.layout != table.layout:
            return True
        return _largest(table.values - told.values) > self._wanted.min_change + _ROUNDING

    def _step(
        self, feed: Feed, table: Table, now_s: float, next_number: Callable[[], int]
    ) -> tuple[str, int, bytes]:
        """Tell the table, or as much of the way to it as the follower takes at once."""
        told, limit = self._told, self._wanted.max_step
        share = 1.0
        if limit is not None and told is not None and told.layout == table.layout:
            largest = _largest(table.values - told.values)
            if largest > limit + _ROUNDING:
                share = limit / largest
        self._facts = table.facts
        self.is_stepping = share < 1.0
        if limit is None:
            self._told = table
            return "table", table.number, table.content
        self._next_step_s = now_s + STEP_S
        if not self.is_stepping or told is None:
            self._told = table
            content = _with_values(table.content, table.values, is_stepping=False)
            return "table", table.number, content
        values = np.round(told.values + share * (table.values - told.values), 4) + 0.0
        content = _with_values(table.content, values, is_stepping=True)
        self._told = Table(next_number(), content, table.layout, values, table.facts)
        _remember(feed.steps, self._told)
        return "table", self._told.number, content


def _table(
    context: Context, machine_id: str, state: CurrentState | ThermapError, number: int
) -> Table:
    """Write the table of a state, or why there is none."""
    if isinstance(state, CurrentState):
        try:
            current = current_table(context, state)
        except ThermapError as why:
            state = why
        else:
            content = current_table_json(current)
            values, layout = _values_of(orjson.loads(content))
            facts = (
                current.table.complete,
                current.table.model_version,
                *((s.sensor, s.health) for s in current.state.sensors),
            )
            return Table(number, content, layout, values, facts)
    content = orjson.dumps(
        {
            "machine": machine_id,
            "computed_at": context.now(),
            "complete": False,
            "detail": state.detail,
            "components": [],
        },
        option=OPTIONS,
    )
    return Table(number, content, b"", np.empty(0), (False, state.detail))


def _judge(context: Context, live: LiveMachine, feed: Feed, stored: Stored) -> bool:
    """Judge a machine; True where the verdict or its words are other ones."""
    status = status_of(context, live, stored)
    key = (
        *(status.verdict, status.state, status.since, status.sentences, status.watch),
        *(status.model_version, status.analysis),
    )
    if key == feed.status_key:
        return False
    feed.status_key = key
    feed.status = _STATUS.dump_json(status)
    return True


def _event(told: Told) -> bytes:
    if not told.name:
        return format_sse_event(id=told.id)
    return format_sse_event(event=told.name, id=told.id, data_str=told.content.decode())


def _largest(differences: FloatArray) -> float:
    return float(np.abs(differences).max(initial=0.0))


def _is_value(name: str) -> bool:
    """Whether a field of a component changes with the errors, in proportion."""
    return "standard" not in name and any(
        part in name for part in ("error", "slope", "compensation")
    )


def _values_of(document: dict[str, Any]) -> tuple[FloatArray, bytes]:
    """Set all errors and compensations of a table in a row, and say which they are."""
    values: list[float] = []
    layout = []
    for component in document["components"]:
        names = [name for name in component if _is_value(name)]
        layout.append([component["component"], component.get("positions_mm"), names])
        for name in names:
            own = component[name]
            values += own if isinstance(own, list) else [own]
    return np.array(values), orjson.dumps(layout)


def _with_values(content: bytes, values: FloatArray, *, is_stepping: bool) -> bytes:
    """Write other values into a table, and whether more of them are on the way."""
    document = orjson.loads(content)
    document["stepping"] = is_stepping
    at = 0
    for component in document["components"]:
        for name in component:
            if not _is_value(name):
                continue
            if isinstance(component[name], list):
                n = len(component[name])
                component[name] = values[at : at + n].tolist()
            else:
                n = 1
                component[name] = float(values[at])
            at += n
    return orjson.dumps(document, option=OPTIONS)
