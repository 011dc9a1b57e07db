"""Use cases that begin anew where another's transaction came first."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from random import uniform
from time import sleep
from typing import Final, ParamSpec, TypeVar

from app.errors import StorageOvertaken

Asked = ParamSpec("Asked")
Answer = TypeVar("Answer")

TIMES: Final = 5
"""How often a use case is tried in all."""

LONGEST_PAUSE_S: Final = 0.1
"""Before the second time, at most [s]; twice as long before each one after."""


def repeated(use_case: Callable[Asked, Answer]) -> Callable[Asked, Answer]:
    """Let a use case of one transaction begin anew where the database undid that.

    Of transactions that wait for each other, or that saw what another changed, the database
    undoes one, whole. Memory follows only what was committed. So the use case may be repeated
    from its beginning, after a pause by chance, or the same two would meet again.

    Parameters
    ----------
    use_case
        Changes nothing but by one `Database.writing`, and memory only after it.

    Returns
    -------
    callable
        The same; StorageOvertaken, and so "busy", when it was overtaken `TIMES` times.
    """

    @wraps(use_case)
    def until_it_succeeds(*asked: Asked.args, **named: Asked.kwargs) -> Answer:
        for i in range(TIMES - 1):
            try:
                return use_case(*asked, **named)
            except StorageOvertaken:
                sleep(uniform(0.0, LONGEST_PAUSE_S * 2**i))
        return use_case(*asked, **named)

    return until_it_succeeds
