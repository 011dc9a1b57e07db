"""Errors as problem details (RFC 9457): one table from kind of error to status."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from typing import Any

import orjson
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from sqlalchemy.exc import IntegrityError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from app.api.schemas.base import way_of
from app.errors import (
    Conflict,
    FieldError,
    InvalidContent,
    StorageUnavailable,
    ThermapError,
    UnknownThing,
    counted,
)
from app.units import unit_of_field

log = logging.getLogger("thermap")

STATUS: Mapping[type[ThermapError], tuple[int, str]] = {
    UnknownThing: (404, "Unknown thing"),
    Conflict: (409, "Conflict"),
    InvalidContent: (422, "Invalid content"),
    StorageUnavailable: (503, "The database is away"),
}
"""A kind of error, or the nearest above it, to its status and title."""

_TITLES = {
    400: "Bad request",
    404: "Unknown thing",
    405: "Method not allowed",
    413: "Too large",
    415: "Wrong type of content",
}

_WHERE = ("body", "query", "path", "header")
"""Where in a request a field was; the first part of a path, but of no field's name."""

_WAYS = ("[key]", *map(way_of, ("one", "more", "point", "line")))
"""Parts of pydantic's paths that are no fields."""

_LONGEST = 4000
"""Characters of a detail."""

_LONGEST_SHOWN = 80
"""Characters of one value, or of one part of a field's name, that are repeated."""

_SHOWN = 20
"""Errors listed in one answer: a list of 10,000 readings can have 10,000."""


def problem(
    status: int,
    title: str,
    detail: str,
    errors: Iterable[FieldError] = (),
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Write a problem as application/problem+json."""
    content = {
        "type": "about:blank",
        "title": title,
        "status": status,
        "detail": _sayable(detail),
        "errors": [{"field": _sayable(e.field), "message": _sayable(e.message)} for e in errors],
    }
    return Response(
        orjson.dumps(content),
        status_code=status,
        media_type="application/problem+json",
        headers=dict(headers or {}),
    )


def install_error_responses(app: FastAPI) -> None:
    """Let an application answer every error as a problem."""
    app.add_exception_handler(ThermapError, _thermap_error)
    app.add_exception_handler(RequestValidationError, _invalid_request)
    app.add_exception_handler(ValidationError, _invalid_request)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(IntegrityError, _overtaken)
    app.add_exception_handler(Exception, _unexpected)


async def _thermap_error(_request: Request, error: Exception) -> Response:
    assert isinstance(error, ThermapError)
    status, title = next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)
    headers = {"Retry-After": "5"} if status == 503 else None
    return problem(status, title, error.detail[:_LONGEST], error.errors[:_SHOWN], headers)


async def _invalid_request(_request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError | ValidationError)
    found = [field_error(e) for e in error.errors()]
    more = f" (and {len(found) - 3} more)" if len(found) > 3 else ""
    detail = "; ".join(f"{e.field}: {e.message}" for e in found[:3]) + more
    return problem(422, "Invalid content", detail, found[:_SHOWN])


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 400:
        return _unreadable(error)
    title = _TITLES.get(error.status_code, "Error")
    detail = str(error.detail)
    if error.status_code == 404:
        detail = f"there is nothing at {request.url.path}; /docs lists what there is"
    return problem(error.status_code, title, detail, headers=error.headers)


def _unreadable(error: HTTPException) -> Response:
    """Refuse a body that the framework gave up on: no UTF-8, or nested without end."""
    message = f"expected JSON in UTF-8, came what cannot be read as such: {error.__cause__}"
    return problem(422, "Invalid content", f"body: {message}", [FieldError("body", message)])


async def _overtaken(_request: Request, _error: Exception) -> Response:
    return problem(
        409, "Conflict", "another request changed the same thing at the same moment; try again"
    )


async def _unexpected(request: Request, error: Exception) -> Response:
    log.error("unexpected error at %s", request.url.path, exc_info=error)
    return problem(
        500, "Unexpected error", f"{type(error).__name__}; the service's log has the details"
    )


def field_error(error: Mapping[str, Any]) -> FieldError:
    """Say of one of pydantic's errors what was expected, what came, and the unit."""
    path = [_cut(str(part)) for part in error["loc"] if part not in _WAYS]
    if path and path[0] in _WHERE:
        del path[0]
    if error["type"] == "json_invalid":
        return FieldError("body", f"expected JSON, came text that is none: {_reason(error)}")
    if error["type"] == "extra_forbidden":
        return FieldError(".".join(path), "unknown field; expected only the documented ones")
    field = ".".join(path) or "body"
    if isinstance(error.get("input"), bytes):
        return FieldError(field, "expected JSON with the header Content-Type: application/json")
    unit = next((u for u in map(unit_of_field, reversed(path)) if u), None)
    in_unit = f" in {unit}" if unit else ""
    if error["type"] == "missing":
        return FieldError(field, f"expected a value{in_unit}, came nothing")
    context = error.get("ctx", {})
    if error["type"] in ("too_short", "too_long"):
        came = counted(context["actual_length"], "entry", "entries")
    else:
        came = _shorten(error.get("input"))
    return FieldError(field, f"expected {_expected(error, context)}{in_unit}, came {came}")


_LENGTHS = {
    "too_short": ("at least", "min_length", "entry", "entries"),
    "too_long": ("at most", "max_length", "entry", "entries"),
    "string_too_short": ("text of at least", "min_length", "character", "characters"),
    "string_too_long": ("text of at most", "max_length", "character", "characters"),
}

_EXPECTED = {
    "string_type": "text",
    "string_pattern_mismatch": "text that matches {pattern}",
    "list_type": "a list",
    "dict_type": "an object with names and values",
    "model_attributes_type": "an object",
    "model_type": "an object",
    "float_type": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "timezone_aware": "a time with its zone, such as 2026-03-01T06:00:00Z",
}


def _expected(error: Mapping[str, Any], context: Mapping[str, Any]) -> str:
    """Say in a few words what one of pydantic's errors expected."""
    if error["type"] in _LENGTHS:
        limit, length, one, more = _LENGTHS[error["type"]]
        return f"{limit} {counted(context[length], one, more)}"
    known = _EXPECTED.get(error["type"])
    if known is not None:
        return known.format(**context)
    return str(error["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")


def _reason(error: Mapping[str, Any]) -> str:
    return str(error.get("ctx", {}).get("error", error["msg"]))


def _sayable(text: str) -> str:
    """Write half characters, which UTF-8 does not have, as what they are."""
    return text.encode("utf-8", "backslashreplace").decode()


def _shorten(value: object) -> str:
    """Write a value as JSON has it, so that who sent it recognises it; text in quotes."""
    if isinstance(value, str):
        return _cut(repr(value))
    return _cut(json.dumps(value, ensure_ascii=False, default=repr))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 3]}…"
