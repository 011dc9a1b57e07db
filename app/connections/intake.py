"""Where connections hand over what sensors say: collected into readings, kept, and stored.

Senders state one sensor a message, or all; what arrives within a short window becomes one
reading. Readings are stored as those over HTTP are, with the same checks. While the database
is away they are kept, the oldest dropped first where there are too many: each is counted, and
who handed a value over is told what became of it.
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from enum import StrEnum
from time import monotonic
from typing import Final, Protocol

from starlette.concurrency import run_in_threadpool

from app.connections.waiting import Waiting
from app.errors import (
    Conflict,
    InvalidContent,
    StorageUnavailable,
    ThermapError,
    UnknownThing,
)
from app.foreign_text import shown
from app.services.context import Context
from app.services.readings import reading_of_time, store_readings
from app.supervision import words_of
from app.thermal.reading import Reading

log = logging.getLogger("thermap")

MOST_AT_ONCE: Final = 500
"""Readings of one machine in one transaction."""

SMALLEST_STEP: Final = timedelta(microseconds=1)
"""Between two readings of one machine: a time has one reading."""

LOGGED_EVERY_S: Final = 10.0
"""One refusal in so long is logged [s]: a sender that errs does so with every message."""

MOST_STEPS: Final = 1000
"""That a reading with the service's time goes behind another service's, at random: next time they
do not meet."""

MOST_ASKED: Final = 1000
"""Values that one reading collects: the next begins another, however alike they are."""

RIGHT_AGAIN_S: Final = 60.0
"""After so long without a wrong time of a machine's senders their clocks are said to be right [s]:
of two senders one may be wrong all the time."""

MOST_MACHINES: Final = 10_000
"""Whose latest times are remembered; those that are over are of no use."""

MOST_REFUSALS: Final = 10_000
"""Sensors of which it is remembered why they were refused: topics may name any number."""

NAMED: Final = 5
"""Refused sensors that are named where there are many."""

SENSOR_FIELD: Final = "temperatures_c."


class Fate(StrEnum):
    """What became of a value that was handed over."""

    STORED = "stored"
    REFUSED = "refused"
    DROPPED = "dropped"


@dataclass(frozen=True, slots=True)
class Limits:
    """How long values are collected, how many are kept, and how far clocks may differ.

    Parameters
    ----------
    collect_s
        From the first value of a reading until it is closed [s].
    most_kept
        Readings that wait for the database.
    clock_tolerance_s
        A sender's clock that differs by more is warned of [s].
    first_pause_s, longest_pause_s
        Before the database is tried again [s]; twice as long each time.
    """

    collect_s: float = 0.2
    most_kept: int = 10_000
    clock_tolerance_s: float = 5.0
    first_pause_s: float = 1.0
    longest_pause_s: float = 30.0


@dataclass(slots=True)
class Counts:
    """What became of all that was handed over: readings stored and dropped, values refused."""

    stored: int = 0
    dropped: int = 0
    refused: int = 0
    wrong_clocks: int = 0
    last_refusal: str = ""


@dataclass(eq=False, slots=True)
class _Collected:
    """A reading that is being collected, or waits; who waits for which of its values."""

    machine: str
    time: datetime
    is_own_time: bool = False
    has_waited: bool = False
    temperatures_c: dict[str, float] = field(default_factory=dict)
    state: dict[str, float] = field(default_factory=dict)
    asked: list[tuple[frozenset[str], asyncio.Future[Fate]]] = field(default_factory=list)
    refused: set[str] = field(default_factory=set)
    closing: asyncio.TimerHandle | None = None

    def contradicts(self, temperatures_c: Mapping[str, float], state: Mapping[str, float]) -> bool:
        """Whether a sensor or a state has another value here already."""
        return any(self.temperatures_c.get(k, v) != v for k, v in temperatures_c.items()) or any(
            self.state.get(k, v) != v for k, v in state.items()
        )

    def leave_out(self, stored: Reading) -> None:
        """Leave out what a reading has already."""
        for name in stored.temperatures_c.keys() & self.temperatures_c.keys():
            del self.temperatures_c[name]
        for name in stored.state.keys() & self.state.keys():
            del self.state[name]

    @property
    def names(self) -> set[str]:
        """The sensors and states that it has."""
        return {*self.temperatures_c, *self.state}

    def reading(self) -> Reading:
        return Reading(self.time, dict(self.temperatures_c), dict(self.state))

    def tell(self, fate: Fate) -> None:
        """Report what became of it; a sender of a sensor that was refused gets that instead."""
        for sensors, waiting in self.asked:
            if not waiting.done():
                waiting.set_result(Fate.REFUSED if sensors & self.refused else fate)


class TakesValues(Protocol):
    """Where a connection hands over what it reads, as `Intake` has it."""

    def offer(
        self,
        machine: str,
        temperatures_c: Mapping[str, float],
        time: datetime | None = None,
        state: Mapping[str, float] | None = None,
    ) -> asyncio.Future[Fate]:
        """Take values of one machine."""

    def tell_values(self, machine: str, present: Collection[str], absent: Collection[str]) -> None:
        """Take note of which sensors have a value, and which have none by what a sender says."""

    def refuse(self, where: str, reason: str) -> None:
        """Count what cannot be used."""


class Sender:
    """One connection's way to the intake: what became of its own messages is counted."""

    def __init__(self, intake: Intake) -> None:
        self._intake = intake
        self.fates = dict.fromkeys(Fate, 0)
        self._refused: set[tuple[str, str]] = set()

    @property
    def troubles(self) -> list[str]:
        """Name its sensors whose latest values were refused, and why."""
        reasons = {who: self._intake.refusal_of(*who) for who in sorted(self._refused)}
        troubles = [f"{sensor} of {m!r}: {why}" for (m, sensor), why in reasons.items() if why]
        return troubles[:NAMED]

    def offer(
        self,
        machine: str,
        temperatures_c: Mapping[str, float],
        time: datetime | None = None,
        state: Mapping[str, float] | None = None,
    ) -> asyncio.Future[Fate]:
        """Take values of one machine."""
        fate = self._intake.offer(machine, temperatures_c, time, state)
        fate.add_done_callback(lambda done: self._count(done, machine, temperatures_c))
        return fate

    def tell_values(self, machine: str, present: Collection[str], absent: Collection[str]) -> None:
        """Take note of which sensors have a value, and which have none by what a sender says."""
        self._intake.tell_values(machine, present, absent)

    def refuse(self, where: str, reason: str) -> None:
        """Count what cannot be used."""
        self.fates[Fate.REFUSED] += 1
        self._intake.refuse(where, reason)

    def _count(self, done: asyncio.Future[Fate], machine: str, sensors: Iterable[str]) -> None:
        if done.cancelled():
            return
        self.fates[done.result()] += 1
        who = {(machine, sensor) for sensor in sensors}
        if done.result() is Fate.REFUSED and len(self._refused) < MOST_REFUSALS:
            self._refused |= who
        elif done.result() is Fate.STORED:
            self._refused -= who


#    offer ─────> _open, by machine and time ─────> _kept ─────────────> STORED
#      │           until the window is over,         │ the oldest first, a machine's together
#      │           all usual sensors are there,      │
#      │           or one is contradicted            ├─ database away: they stay
#      │                                             ├─ refused: without the sensors to blame
#      └─ no number, no zone: REFUSED                │    the rest is stored, they are REFUSED
#                                                    └─ too many: one of whom has most is
#                                                         DROPPED
#
# Each future ends with one of the three fates, whatever happens: who acknowledges waits for it.
class Intake:
    """Takes values of all connections; `run` stores them until it is cancelled, `end` is last.

    All but the storing happens in the event loop that `run` runs in.

    Parameters
    ----------
    context
        Gives the database and the clock as they are then.
    """

    def __init__(self, context: Callable[[], Context], limits: Limits | None = None) -> None:
        self._context = context
        self._limits = limits or Limits()
        self._open: OrderedDict[tuple[str, datetime | None], _Collected] = OrderedDict()
        self._kept: Waiting[_Collected] = Waiting()
        self._is_over = False
        self._something = asyncio.Event()
        self._latest: dict[str, datetime] = {}
        # What a machine's readings had when their time was over: a reading that has all of it
        # need not wait.
        self._usual: dict[str, set[str]] = {}
        self._refusals: dict[tuple[str, str], str] = {}
        self._wrong_clocks: dict[str, float] = {}
        self._logged_s = -math.inf
        self._not_logged = 0
        self.counts = Counts()

    def offer(
        self,
        machine: str,
        temperatures_c: Mapping[str, float],
        time: datetime | None = None,
        state: Mapping[str, float] | None = None,
    ) -> asyncio.Future[Fate]:
        """Take values of one machine.

        Parameters
        ----------
        time
            When they were measured, with its zone; without one, now, by the service's clock.
            A value of a time for which the sensor has another one already is refused. What
            comes for such a time later than the window is stored a microsecond behind it.

        Returns
        -------
        Future of Fate
            Done when it is known what became of the values.
        """
        fate: asyncio.Future[Fate] = asyncio.get_running_loop().create_future()
        state = state or {}
        wrong = _not_usable(temperatures_c, state, time)
        if wrong:
            self.refuse(f"machine {machine!r}", wrong)
            fate.set_result(Fate.REFUSED)
            return fate
        if self._is_over:
            self.counts.dropped += 1
            fate.set_result(Fate.DROPPED)
            return fate
        now = self._context().now()
        if time is not None:
            self._judge_clock(machine, time, now)
        key = (machine, time)
        collected = self._open.get(key)
        # With the sender's time a second value contradicts the first: two readings of one
        # time, of which the store refuses the second. Without one it is just the next.
        if collected is not None and collected.contradicts(temperatures_c, state):
            self._close(key)
            collected = None
        if collected is None:
            collected = self._open[key] = _Collected(machine, time or now, time is None)
            loop = asyncio.get_running_loop()
            collected.closing = loop.call_later(
                self._limits.collect_s, self._close_this, key, collected
            )
            # Those that are open are in memory, too, and topics may name any number of machines.
            if len(self._open) > self._limits.most_kept:
                self._close(next(iter(self._open)))
        if time is None:
            # The latest arrival: no value is claimed for a time before it came.
            collected.time = self._own_time(machine, now)
        # −0 is none.
        collected.temperatures_c.update({k: v + 0.0 for k, v in temperatures_c.items()})
        collected.state.update({k: v + 0.0 for k, v in state.items()})
        collected.asked.append((frozenset(temperatures_c), fate))
        if len(collected.asked) >= MOST_ASKED:
            self._close(key)
            return fate
        if machine in self._usual and collected.names >= self._usual[machine]:
            self._close(key)
        return fate

    def refusal_of(self, machine: str, sensor: str) -> str:
        """Say why a sensor's latest value was refused; empty where it was stored."""
        return self._refusals.get((machine, sensor), "")

    def tell_values(self, machine: str, present: Collection[str], absent: Collection[str]) -> None:
        """Take note of which sensors have a value, and which have none by what a sender says."""
        context = self._context()
        live = context.live.get(machine)
        if live is not None:
            live.note_values(present, dict.fromkeys(absent, context.now()))

    @property
    def machines_with_wrong_clocks(self) -> tuple[str, ...]:
        """Machines of whose senders one stated a wrong time within the last minute."""
        since_s = monotonic() - RIGHT_AGAIN_S
        return tuple(
            sorted(machine for machine, at_s in self._wrong_clocks.items() if at_s >= since_s)
        )

    async def run(self) -> None:
        """Store what is closed, for as long as it is not cancelled."""
        pause_s = self._limits.first_pause_s
        while True:
            await self._something.wait()
            try:
                await self._store_next()
                pause_s = self._limits.first_pause_s
            except StorageUnavailable as away:
                log.warning("%d readings of connections wait: %s", len(self._kept), away.detail)
                await asyncio.sleep(pause_s)
                pause_s = min(2.0 * pause_s, self._limits.longest_pause_s)

    def end(self) -> None:
        """Drop what is left, and all that comes from now on.

        What was being stored may be stored and yet told to be dropped: a sender that repeats it
        with its own time finds it there already.
        """
        self._is_over = True
        self._drop_all()

    async def _store_next(self) -> None:
        """Store the oldest readings of one machine; they stay in front until that is done."""
        batch = self._kept.next_batch(MOST_AT_ONCE)
        try:
            await self._store(batch)
        except StorageUnavailable:
            raise
        except UnknownThing as gone:
            # Asked for each reading alone, a machine that was deleted would hold up the others.
            for collected in batch:
                self._refuse_whole(collected, gone.detail)
            self._forget(batch[0].machine)
        except Exception as why:
            if not isinstance(why, ThermapError):
                log.exception("readings of machine %r could not be stored", batch[0].machine)
            for collected in batch:
                await self._store_what_can_be(collected)

    async def _store(self, batch: Sequence[_Collected]) -> None:
        readings = [reading_group.reading() for reading_group in batch]
        # In a thread, as it may take seconds. Others come meanwhile, and some of these may be
        # dropped; nothing is added to them, since they are closed.
        await run_in_threadpool(store_readings, self._context(), batch[0].machine, readings)
        for collected in batch:
            self._settle(collected, Fate.STORED)

    async def _store_what_can_be(self, collected: _Collected) -> None:
        """Store a reading without the sensors that are refused: the others are not to blame."""
        try:
            await self._store([collected])
        except StorageUnavailable:
            raise
        except ThermapError as error:
            if isinstance(error, Conflict) and await self._go_behind(collected):
                return
            reasons = _blamed_sensors(error)
            blamed = reasons.keys() & collected.temperatures_c.keys()
            if not blamed:
                self._refuse_whole(collected, error.detail)
                if isinstance(error, UnknownThing):
                    self._forget(collected.machine)
                return
            self.refuse(f"machine {collected.machine!r}", error.detail)
            for sensor in blamed:
                del collected.temperatures_c[sensor]
                self._note_refusal(collected.machine, sensor, reasons[sensor])
            collected.refused |= blamed
            if collected.temperatures_c or collected.state:
                await self._store_what_can_be(collected)
            else:
                self._settle(collected, Fate.REFUSED)
        except Exception as why:
            # One that nobody can store takes no other with it.
            self._refuse_whole(collected, words_of(why))

    def _forget(self, machine: str) -> None:
        """Keep nothing of a machine that there is not: senders may name any number."""
        self._latest.pop(machine, None)
        self._usual.pop(machine, None)
        self._wrong_clocks.pop(machine, None)

    def _note_refusal(self, machine: str, sensor: str, reason: str) -> None:
        if len(self._refusals) < MOST_REFUSALS or (machine, sensor) in self._refusals:
            self._refusals[machine, sensor] = reason

    async def _go_behind(self, collected: _Collected) -> bool:
        """Store what is new of a time that has a reading, behind it; False where it contradicts.

        Sensors of one time that come in messages of their own do so where the service was killed
        between two of them. Of two services that read at the same microsecond one goes behind.
        """
        stored = await run_in_threadpool(
            reading_of_time, self._context(), collected.machine, collected.time
        )
        if stored is None:
            return False
        if collected.is_own_time:
            collected.time += random.randint(1, MOST_STEPS) * SMALLEST_STEP
            await self._store_what_can_be(collected)
            return True
        if collected.contradicts(stored.temperatures_c, stored.state):
            return False
        collected.leave_out(stored)
        if collected.names:
            collected.time += SMALLEST_STEP
            await self._store_what_can_be(collected)
        else:
            self._settle(collected, Fate.STORED)
        return True

    def _refuse_whole(self, collected: _Collected, reason: str) -> None:
        self.refuse(f"machine {collected.machine!r}", reason)
        for sensor in collected.temperatures_c:
            self._note_refusal(collected.machine, sensor, reason)
        self._settle(collected, Fate.REFUSED)

    def _settle(self, collected: _Collected, fate: Fate) -> None:
        if collected not in self._kept:  # dropped since, because too many came
            return
        self._kept.remove(collected)
        self.counts.stored += fate is Fate.STORED
        if collected.has_waited and fate is Fate.STORED:
            self._usual.setdefault(collected.machine, set()).update(collected.names)
        self.counts.dropped += fate is Fate.DROPPED
        if not self._kept:
            self._something.clear()
        if fate is Fate.STORED:
            for sensor in collected.temperatures_c:
                self._refusals.pop((collected.machine, sensor), None)
        collected.tell(fate)

    def _close_this(self, key: tuple[str, datetime | None], collected: _Collected) -> None:
        if self._open.get(key) is collected:
            collected.has_waited = True
            self._close(key)

    def _close(self, key: tuple[str, datetime | None]) -> None:
        collected = self._open.pop(key)
        if collected.closing is not None:
            collected.closing.cancel()
        self._kept.add(collected)
        self._something.set()
        while len(self._kept) > self._limits.most_kept:
            self._settle(self._kept.one_too_many(collected.machine), Fate.DROPPED)

    def _drop_all(self) -> None:
        for key in list(self._open):
            self._close(key)
        for collected in list(self._kept):
            self._settle(collected, Fate.DROPPED)

    def _own_time(self, machine: str, now: datetime) -> datetime:
        latest = self._latest.get(machine)
        time_by_clock = now if latest is None else max(now, latest + SMALLEST_STEP)
        if (time_by_clock - now).total_seconds() > self._limits.clock_tolerance_s:
            time_by_clock = now  # the service's clock was ahead, and has been set right
        if len(self._latest) >= MOST_MACHINES and machine not in self._latest:
            self._latest = {name: time for name, time in self._latest.items() if time >= now}
        self._latest[machine] = time_by_clock
        return time_by_clock

    def _judge_clock(self, machine: str, time: datetime, now: datetime) -> None:
        """Warn once when a sender's clock is wrong, and once when it is right again."""
        ahead_s = (time - now).total_seconds()
        wrong = abs(ahead_s) > self._limits.clock_tolerance_s
        self.counts.wrong_clocks += wrong
        now_s, last_s = monotonic(), self._wrong_clocks.get(machine)
        if wrong:
            self._wrong_clocks[machine] = now_s
        if wrong == (last_s is not None):
            return
        if wrong:
            where = "ahead of" if ahead_s > 0 else "behind"
            log.warning(
                "machine %r: a sender's time is %.1f s %s the service's clock",
                *(machine, abs(ahead_s), where),
            )
        elif last_s is not None and now_s - last_s > RIGHT_AGAIN_S:
            del self._wrong_clocks[machine]
            log.warning("machine %r: the sender's time is right again", machine)

    def refuse(self, where: str, reason: str) -> None:
        """Count what cannot be used, say the last, and log one in a while.

        Parameters
        ----------
        where
            What it was for or where it came from, as `machine 'vmc'`.
        """
        self.counts.refused += 1
        self.counts.last_refusal = shown(f"{where}: {reason}")
        now_s = monotonic()
        if now_s - self._logged_s < LOGGED_EVERY_S:
            self._not_logged += 1
            return
        more = f" (and {self._not_logged} more since the last)" if self._not_logged else ""
        log.warning("refused from a connection: %s%s", self.counts.last_refusal, more)
        self._logged_s, self._not_logged = now_s, 0


def _not_usable(
    temperatures_c: Mapping[str, float], state: Mapping[str, float], time: datetime | None
) -> str:
    """Say what no reading can contain; empty where there is nothing."""
    for name, value in [*temperatures_c.items(), *state.items()]:
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            unit = " in °C" if name in temperatures_c else ""
            return f"{name}: expected a finite number{unit}, got {value!r:.80}"
    if time is not None and time.utcoffset() is None:
        return f"expected a time with its zone, got {time.isoformat()}"
    return "" if temperatures_c or state else "expected at least one value, got none"


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer that no float can be
        return False


def _blamed_sensors(error: ThermapError) -> dict[str, str]:
    """Read out of a refusal which sensors' values were refused, and why."""
    if not isinstance(error, InvalidContent):
        return {}
    parts = [
        (field_error.field.partition(SENSOR_FIELD), field_error.message)
        for field_error in error.errors
    ]
    return {name: message for (_, separator, name), message in parts if separator}
