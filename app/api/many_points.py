"""Reading a request with up to a million points, without holding up what else is asked.

A body of some ten megabytes takes seconds to be read as any other body is, and the live
table waits meanwhile. Here it is read in a thread, and the points are cut out of its text
and read in pieces, between which others have their turn.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Annotated, Any, Final

import numpy as np
import orjson
from fastapi import Depends, Request
from fastapi.exceptions import RequestValidationError
from pydantic import TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool

from app.api.schemas.volumetric_error import MOST_POINTS, Points, VolumetricErrorRequest
from app.arrays import FloatArray

BYTES_AT_ONCE: Final = 250_000
SHORT_BODY: Final = 100_000
"""Below this a body is read as any other is [bytes]."""

_BEGIN: Final = re.compile(rb'"points_mm"\s*:\s*\[(?=\s*\[)')
_END: Final = re.compile(rb"\]\s*\]")
_COMMA: Final = re.compile(rb"\s*,\s*")

_POINTS: Final[TypeAdapter[Points]] = TypeAdapter(Points)


async def read_points(request: Request) -> tuple[VolumetricErrorRequest, FloatArray]:
    """Read a question and its points [mm], shape (n, 3).

    The question that is returned has the first point only.

    Raises
    ------
    RequestValidationError
        As the framework would, for content that is wrong.
    """
    body = await request.body()
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind and kind != "application/json":
        # As the framework has it: bytes that nobody said are JSON.
        raise RequestValidationError(
            [{"type": "model_attributes_type", "loc": ("body",), "msg": "", "input": body}]
        )
    return await run_in_threadpool(_read, body)


def _read(body: bytes) -> tuple[VolumetricErrorRequest, FloatArray]:
    try:
        parts = _taken_apart(body) if len(body) > SHORT_BODY else None
        if parts is not None:
            stated, points_mm = parts
            return VolumetricErrorRequest.model_validate(stated), points_mm
        question = VolumetricErrorRequest.model_validate_json(body)
    except ValidationError as error:
        raise _in_body(error) from None
    return question, np.array(question.points_mm, dtype=np.float64)


def _taken_apart(body: bytes) -> tuple[dict[str, Any], FloatArray] | None:
    """Read the question with one point instead of all, and all points.

    None where the body is not as expected: read as a whole, it is refused in better words.
    """
    begin = _BEGIN.search(body)
    end = begin and _END.search(body, begin.end())
    if not begin or not end:
        return None
    arrays: list[FloatArray] = []
    try:
        stated = orjson.loads(body[: begin.end()] + b"[0,0,0]" + body[end.end() - 1 :])
        if not isinstance(stated, dict) or stated.get("points_mm") != [[0, 0, 0]]:
            return None
        read = 0
        for piece in _pieces(body[begin.end() : end.start() + 1]):
            arrays.append(_as_array(orjson.loads(piece), read))
            read += len(arrays[-1])
            if read > MOST_POINTS:
                return None
    except orjson.JSONDecodeError:
        return None
    return stated, np.concatenate(arrays)


def _pieces(points: bytes) -> Iterator[bytes]:
    """Cut a list's text behind a point, again and again; each piece is a list."""
    start = 0
    while start < len(points):
        stop = points.find(b"]", start + BYTES_AT_ONCE) + 1 or len(points)
        yield b"[" + points[start:stop] + b"]"
        comma = _COMMA.match(points, stop)
        if comma is None and stop < len(points):
            yield b"no comma, no JSON"
        start = comma.end() if comma else stop


def _as_array(points: list[Any], first: int) -> FloatArray:
    """Check a piece of the points, of which so many came before, and make an array of it."""
    try:
        return np.array(_POINTS.validate_python(points), dtype=np.float64)
    except ValidationError as error:
        raise _in_body(error, first) from None


def _in_body(error: ValidationError, start: int | None = None) -> RequestValidationError:
    """Name the fields as the body has them; those of a piece begin at its first point."""
    found = []
    for one in error.errors(include_url=False):
        where = one["loc"]
        if start is not None:
            where = ("points_mm", start + int(where[0]), *where[1:])
        found.append({**one, "loc": ("body", *where)})
    return RequestValidationError(found)


ManyPoints = Annotated[tuple[VolumetricErrorRequest, FloatArray], Depends(read_points)]
