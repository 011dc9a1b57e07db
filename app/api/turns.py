"""Turns at the database: a few requests work there, some wait, more are sent away at once.

A database that hangs must not fill the service with requests that hang: the live table
needs none of these turns, and goes on.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from inspect import iscoroutinefunction
from typing import Final, Generic, TypeVar

import anyio
from anyio.to_thread import run_sync
from fastapi import Request

from app.access.authorization import as_service
from app.errors import ServiceStopping, StorageBusy

Answer = TypeVar("Answer")

AT_WORK: Final = 20
"""Requests that work at the same time: half of the threads that there are for them, and of
the connections to PostgreSQL."""


class Turns:
    """Who may work now, and who waits for it."""

    def __init__(self, most_waiting: int, wait_s: float) -> None:
        # A free turn is taken without a switch to other tasks: the usual case costs nothing.
        self._free = anyio.Semaphore(AT_WORK, fast_acquire=True)
        self._most_waiting = most_waiting
        self._wait_s = wait_s
        self._waiting: set[anyio.CancelScope] = set()
        self._ends = False

    def end(self) -> None:
        """Send away who waits, and from now on whoever would have to; to be called by the loop."""
        self._ends = True
        for waiting in self._waiting:  # they leave the set when they run next, not while we do
            waiting.cancel()

    @asynccontextmanager
    async def taken(self) -> AsyncIterator[None]:
        """Wait for a turn, and give it back at the end.

        Raises
        ------
        StorageBusy
            If too many wait already, or the turn does not come in time.
        ServiceStopping
            If it does not come before the service ends.
        """
        await self._take()
        try:
            yield
        finally:
            self._free.release()

    async def _take(self) -> None:
        # Nobody awaits between the look and `acquire`: the count of those who wait is true.
        if self._free.value == 0:
            self._expect_place()
        with anyio.move_on_after(self._wait_s) as waiting:
            self._waiting.add(waiting)
            try:
                await self._free.acquire()
            finally:
                self._waiting.discard(waiting)
        if waiting.cancelled_caught:
            self._expect_future()
            raise StorageBusy(
                f"the database is busy, try again: other requests work on it for {self._wait_s:g} s"
            )

    def _expect_place(self) -> None:
        self._expect_future()
        if len(self._waiting) >= self._most_waiting:
            count = len(self._waiting)
            raise StorageBusy(f"{count} requests wait for the database already, try again")

    def _expect_future(self) -> None:
        if self._ends:
            raise ServiceStopping("the service ends: nothing was done, try again when it is back")


async def take_turn(request: Request) -> AsyncIterator[None]:
    """Let a route that runs in a thread begin when it is its turn, with the body received.

    A route that is `async` works in no thread: the live table, the process' health.
    """
    if iscoroutinefunction(request.scope["route"].endpoint):
        yield
        return
    await request.body()  # kept by the request: nobody holds a turn while he sends
    turns: Turns = request.app.state.turns
    async with turns.taken():
        yield


class SharedQuestion(Generic[Answer]):
    """A question that is asked once at a time, by a thread of its own.

    Whoever wants to know while it is being asked gets the same answer, and nobody waits for
    longer than `patience_s` [s].
    """

    def __init__(self, ask: Callable[[], Answer], patience_s: float) -> None:
        self._ask = ask
        self._patience_s = patience_s
        self._thread = anyio.CapacityLimiter(1)
        self._asking: asyncio.Task[Answer] | None = None

    async def answer(self) -> Answer | None:
        """Give the answer, None where it does not come in time."""
        if self._asking is None or self._asking.done():
            with as_service():  # it is asked for all of them
                self._asking = asyncio.create_task(
                    run_sync(self._ask, abandon_on_cancel=True, limiter=self._thread)
                )
        # Whoever gives up or goes away must not cancel the question for the others.
        with anyio.move_on_after(self._patience_s):
            return await asyncio.shield(self._asking)
        return None
