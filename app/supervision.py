"""What runs for as long as the service does: where it ends it is said, and it is begun again."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import Awaitable, Callable
from time import monotonic
from typing import Final, NoReturn

from app.errors import ThermapError
from app.foreign_text import shown

log = logging.getLogger("thermap")

FIRST_PAUSE_S: Final = 1.0
"""Before what ended is begun again [s]; twice as long each time that it ends."""

LONGEST_PAUSE_S: Final = 30.0

STEADY_S: Final = 60.0
"""What ran for so long ran well: the next pause is the first again [s]."""


async def keep_running(
    name: str,
    run: Callable[[], Awaitable[None]],
    ended: Callable[[str], None] | None = None,
    *,
    lets_through: tuple[type[Exception], ...] = (),
) -> NoReturn:
    """Run something again and again, until it is cancelled.

    Parameters
    ----------
    ended
        Is told each time why it ended, in a sentence; without it the log is, each sentence once.
    lets_through
        Exceptions that end whoever waits for it, too.
    """
    pause_s, logged = FIRST_PAUSE_S, ""
    while True:
        began_s = monotonic()
        try:
            await run()
            words = "it ended"
        except Exception as why:
            if isinstance(_innermost(why), lets_through):
                raise
            words = words_of(why)
            if words != logged and not is_foreseen(why):
                log.exception("%s: %s", name, words)
        if ended is not None:
            ended(words)
        elif words != logged:
            log.warning("%s: %s; it begins anew", name, words)
        logged = words
        if monotonic() - began_s >= STEADY_S:
            pause_s, logged = FIRST_PAUSE_S, ""
        # Many that lost the same thing do not come back all at once.
        await asyncio.sleep(pause_s * random.uniform(0.8, 1.2))
        pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


def words_of(why: BaseException) -> str:
    """Put in a sentence why something ended: its own words, or what nobody foresaw.

    >>> words_of(ThermapError("contact is lost")), words_of(TimeoutError())
    ('contact is lost', 'no answer in time')
    >>> words_of(ZeroDivisionError("division by zero"))
    'ZeroDivisionError: division by zero'
    """
    why = _innermost(why)
    if isinstance(why, TimeoutError) and not str(why):
        return "no answer in time"
    if is_foreseen(why) and str(why):
        return shown(str(why))
    return shown(f"{type(why).__name__}: {why}" if str(why) else type(why).__name__)


def is_foreseen(why: BaseException) -> bool:
    """Whether it is said in a sentence what went wrong; else the log needs where."""
    return isinstance(_innermost(why), ThermapError | OSError)


def _innermost(why: BaseException) -> BaseException:
    """Take the first exception out of what a group of tasks raised."""
    while isinstance(why, BaseExceptionGroup):
        why = why.exceptions[0]
    return why
