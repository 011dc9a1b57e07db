"""Turns for long bodies and files: one for each sender at a time, and few in all.

What a body says takes many times the memory of its bytes, from when it is read until it is
answered, and reading it takes seconds in which others compute more slowly.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Final
from weakref import WeakValueDictionary

import anyio
from starlette.exceptions import HTTPException

AT_ONCE: Final = 2
"""Long bodies that are read and answered at the same time; of one key or address only one."""

LONGEST_WAIT_S: Final = 30
"""After which a long body is refused that has not had its turn [s]."""


class LongBodies:
    """Whose turn it is."""

    def __init__(self) -> None:
        self._all = anyio.Semaphore(AT_ONCE)
        # A sender is forgotten when none of his requests is left.
        self._by_sender: WeakValueDictionary[str, anyio.Semaphore] = WeakValueDictionary()

    @asynccontextmanager
    async def taken(self, sender: str) -> AsyncIterator[None]:
        """Wait for the sender's own turn, then for one of all, and give both back at the end.

        Who sends much thus waits for himself, and the others for one of his bodies at most.

        Raises
        ------
        HTTPException
            503, if the turn does not come in time.
        """
        turn = self._by_sender.setdefault(sender, anyio.Semaphore(1))
        async with AsyncExitStack() as turns:
            with anyio.move_on_after(LONGEST_WAIT_S) as waiting:
                await turns.enter_async_context(turn)
                await turns.enter_async_context(self._all)
            if waiting.cancelled_caught:
                raise HTTPException(
                    503,
                    "other long bodies and files, of which one of each sender and "
                    f"{AT_ONCE} in all are read at once, took more than {LONGEST_WAIT_S} s",
                    {"Retry-After": "5"},
                )
            yield
