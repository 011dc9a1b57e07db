"""The short way to the live table: its answers are remembered.

Sensors resolve a tenth or a hundredth of a degree, so the same request comes
again and again: but for its time, its answer is remembered. With adopted effects, which may
depend on the time, it is computed each time.
"""

from __future__ import annotations

from collections import OrderedDict
from datetime import UTC, datetime
from threading import Lock
from typing import Final
from weakref import ref

import orjson
from pydantic import TypeAdapter

from app.api.json_text import without_minus_zeros
from app.api.schemas.compensation import CompensationRequest
from app.api.short_way.plain import MACHINES, Answer, ShortWay
from app.api.table_json import OPTIONS, table_json
from app.live.registry import LiveModel
from app.services.context import Context
from app.services.live_table import table_at

LARGEST_PLAIN_BODY = 4096
"""Longer bodies go the ordinary way [bytes]; some hundred sensors fit."""

LARGEST_PLAIN_TABLE = 4000
"""Larger tables go the ordinary way [numbers]: remembered answers would fill the memory."""

ANSWERS_BYTES = 32 * 2**20
"""Room for remembered answers, over all machines: some 2,000 of 12 × 21 numbers."""

_ANSWER_BYTES = 500
"""What an answer takes besides its text and that of its question: places in tables, headers."""

_SOME_TIME = datetime(1970, 1, 1, tzinfo=UTC)
_SOME_TIME_TEXT = orjson.dumps(_SOME_TIME, option=OPTIONS)

_REQUEST = TypeAdapter(CompensationRequest).validator


def plain_answer(context: Context, machine_id: str, body: bytes) -> bytes | None:
    """Write the table if the request is in order in every way, else None."""
    live = context.live.get(machine_id)
    if live is None or context.live.database.trouble is not None:
        return None
    try:
        if live.current.effects:
            return _answer(live.current, body, context.now())
        before, after = ANSWERS.around_time(live.current, body)
    except Exception:
        return None  # whatever it is, the ordinary way meets it too, and has the words for it
    return b"".join((before, orjson.dumps(context.now(), option=OPTIONS), after))


class Answers:
    """Answers that were written, in so much memory at most: those asked for longest ago go first.

    A model is not held by its answers: with each version of each machine there is another one.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._kept: OrderedDict[tuple[ref[LiveModel], bytes], tuple[bytes, bytes]] = OrderedDict()
        self._lock = Lock()
        self.bytes = 0

    def around_time(self, current: LiveModel, body: bytes) -> tuple[bytes, bytes]:
        """Find the answer to a body, or write it: what comes before and after the time."""
        key = (ref(current), body)
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
                return found
        found = _around_time(current, body)
        with self._lock:
            if key not in self._kept:
                self._kept[key] = found
                self.bytes += _size(body, found)
            while self.bytes > self._most_bytes:
                (_, oldest), answer = self._kept.popitem(last=False)
                self.bytes -= _size(oldest, answer)
        return found


def _size(body: bytes, answer: tuple[bytes, bytes]) -> int:
    """Bytes that an answer and its question take."""
    return len(body) + len(answer[0]) + len(answer[1]) + _ANSWER_BYTES


ANSWERS = Answers(ANSWERS_BYTES)


def _around_time(current: LiveModel, body: bytes) -> tuple[bytes, bytes]:
    """Write the answer to a body: what comes before and after the time of computing."""
    if current.model.numbers > LARGEST_PLAIN_TABLE:
        raise ValueError("too large to be remembered")
    # No real table is of 1970: its time marks the place where the present one goes.
    before, _, after = _answer(current, body, _SOME_TIME).partition(_SOME_TIME_TEXT)
    return before, after


def _answer(current: LiveModel, body: bytes, now: datetime) -> bytes:
    stated = _REQUEST.validate_json(without_minus_zeros(body))
    names = len(stated.model_fields_set) + len(stated.temperatures_c) + len(stated.state)
    # JSON's parser keeps the last of two equal names; the ordinary way refuses them. Each name has
    # one colon, so that more of them are a repeated name, or a colon in a text: both go that way.
    if body.count(b":") != names:
        raise ValueError("a name may stand there twice")
    return table_json(table_at(current, stated.temperatures_c, now, state=stated.state))


async def _plain_table(context: Context, machine_id: str, body: bytes) -> Answer | None:
    content = plain_answer(context, machine_id, body)
    return None if content is None else Answer(200, content)


TABLES: Final = ShortWay(f"{MACHINES}{{machine}}/compensation", LARGEST_PLAIN_BODY, _plain_table)
