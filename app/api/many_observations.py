"""Reading a verification of up to 100,000 observations, without holding up what else is asked.

A long body is read in a thread, and the observations are cut out of its text and read in
pieces, between which others have their turn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Final

import orjson
from fastapi import Depends, Request
from fastapi.exceptions import RequestValidationError
from pydantic import TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool

from app.api.schemas.verifications import (
    MOST_OBSERVATIONS,
    MeasuredObservation,
    VerificationRequest,
    measured_observations,
)
from app.identification.observations import Observation, Verification

BYTES_AT_ONCE: Final = 50_000
"""Text read between two turns of others: some hundred observations, 5 ms."""

SHORT_BODY: Final = 100_000
"""Below this a body is read as any other is [bytes]."""

_LIST: Final = "observations"
_BEGIN: Final = re.compile(rb'"observations"\s*:\s*\[(?=\s*\{)')
_BETWEEN: Final = re.compile(rb"\}\s*,\s*(?=\{)")
_SOME: Final = b'{"time":"2000-01-01T00:00:00Z","component":"SXY","measured_um":0}'
_OBSERVATIONS: Final = TypeAdapter(list[MeasuredObservation])


async def read_verification_body(request: Request) -> Verification:
    """Read a verification.

    Raises
    ------
    RequestValidationError
        As the framework would, for content that is wrong.
    InvalidContent
        If an observation contradicts itself.
    """
    body = await request.body()
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind and kind != "application/json":
        # As the framework has it: bytes that nobody said are JSON.
        raise RequestValidationError(
            [{"type": "model_attributes_type", "loc": ("body",), "msg": "", "input": body}]
        )
    return await run_in_threadpool(_read, body)


def _read(body: bytes) -> Verification:
    found = _taken_apart(body) if len(body) > SHORT_BODY else None
    if found is not None:
        return found
    try:
        whole = VerificationRequest.model_validate_json(body)
    except ValidationError as error:
        raise _in_body(error) from None
    return whole.to_verification(measured_observations(whole.observations))


def _taken_apart(body: bytes) -> Verification | None:
    """Read the head with one observation instead of all, and the observations in pieces.

    None where the body is not as expected: read as a whole, it is refused in better words.
    """
    begin = _BEGIN.search(body)
    end = body.rfind(b"]")
    if not begin or end < begin.end() or not body[:end].rstrip().endswith(b"}"):
        return None
    found: list[Observation] = []
    try:
        stated = orjson.loads(body[: begin.end()] + _SOME + body[end:])
        if not isinstance(stated, dict) or stated.get(_LIST) != [orjson.loads(_SOME)]:
            return None
        head = VerificationRequest.model_validate(stated)
        for piece in _pieces(body[begin.end() : end]):
            found += _observations(orjson.loads(piece), len(found))
            if len(found) > MOST_OBSERVATIONS:
                return None
    except orjson.JSONDecodeError:
        return None
    except ValidationError as error:
        raise _in_body(error) from None
    return head.to_verification(found)


def _pieces(observations: bytes) -> Iterator[bytes]:
    """Cut a list's text between two observations, again and again; each piece is a list."""
    start = 0
    while start < len(observations):
        cut = _BETWEEN.search(observations, start + BYTES_AT_ONCE)
        stop = cut.start() + 1 if cut else len(observations)
        yield b"[" + observations[start:stop] + b"]"
        start = cut.end() if cut else stop


def _observations(items: list[Any], first: int) -> list[Observation]:
    """Check a piece of the observations, of which so many came before."""
    try:
        piece = _OBSERVATIONS.validate_python(items)
    except ValidationError as error:
        raise _in_body(error, first) from None
    return measured_observations(piece, first)


def _in_body(error: ValidationError, start: int | None = None) -> RequestValidationError:
    """Name the fields as the body has them; those of a piece begin at its first observation."""
    found = []
    for one in error.errors(include_url=False):
        where = one["loc"]
        if start is not None:
            where = (_LIST, start + int(where[0]), *where[1:])
        found.append({**one, "loc": ("body", *where)})
    return RequestValidationError(found)


StatedVerification = Annotated[Verification, Depends(read_verification_body)]
