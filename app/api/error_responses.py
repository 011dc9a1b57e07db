"""Errors as problem details (RFC 9457): one table from kind of error to status."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import orjson
from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import iter_route_contexts
from pydantic import ValidationError
from sqlalchemy.exc import IntegrityError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.routing import Match
from starlette.types import Scope

from app.api.pages import Page, take_reader, wants_page
from app.api.request_log import request_id
from app.errors import (
    Conflict,
    FieldError,
    InvalidContent,
    KeyUnknown,
    MachineQueueFull,
    NotAllowed,
    QueueFull,
    ServiceStopping,
    StorageBusy,
    StorageFull,
    StorageUnavailable,
    ThermapError,
    UnknownThing,
    list_names,
)
from app.field_errors import field_error
from app.in_pieces import ENOUGH_ERRORS
from app.pages.environment import render_live
from app.pages.wording import message

log = logging.getLogger("thermap")

STATUS: Mapping[type[ThermapError], tuple[int, str]] = {
    UnknownThing: (404, message("Unknown thing")),
    Conflict: (409, message("Conflict")),
    InvalidContent: (422, message("Invalid content")),
    StorageUnavailable: (503, message("The database is away")),
    StorageFull: (507, message("The disk is full")),
    StorageBusy: (503, message("The database is busy")),
    QueueFull: (503, message("Too many analyses wait")),
    MachineQueueFull: (429, message("Too many analyses of the machine wait")),
    ServiceStopping: (503, message("The service ends")),
    KeyUnknown: (401, message("A key is needed")),
    NotAllowed: (403, message("Not allowed")),
}
"""A kind of error, or the nearest above it, to its status and title."""

_TITLES = {
    400: message("Bad request"),
    403: message("Not allowed"),
    404: message("Unknown thing"),
    405: message("Method not allowed"),
    408: message("Request stopped half-way"),
    413: message("Too large"),
    415: message("Wrong type of content"),
    503: message("Too busy"),
}

_AGAIN_LATER = {"Retry-After": "5"}
_HEADERS = {
    401: {"WWW-Authenticate": "Bearer"},
    **dict.fromkeys((429, 503, 507), _AGAIN_LATER),
}

_LONGEST = 4000
"""Characters of a detail."""

_MOST_ERRORS = 20
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
        "detail": _without_surrogates(detail),
        "errors": [
            {"field": _without_surrogates(e.field), "message": _without_surrogates(e.message)}
            for e in errors
        ],
    }
    return Response(
        orjson.dumps(content),
        status_code=status,
        media_type="application/problem+json",
        headers=dict(headers or {}),
    )


def problem_for(
    scope: Scope,
    status: int,
    title: str,
    detail: str,
    errors: Iterable[FieldError] = (),
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Write a problem as a page where a person's browser asked for one, else as `problem` does."""
    if not wants_page(scope):
        return problem(status, title, detail, errors, headers)
    take_reader(Request(scope))
    content = render_live(
        "problem.html",
        status=status,
        title=title,
        detail=_without_surrogates(detail),
        passes=status == 503,
    )
    all_headers = {"Cache-Control": "no-store", **(headers or {})}
    return Page(content, scripts=0, headers=all_headers, status=status)


def problem_of(scope: Scope, error: ThermapError) -> Response:
    """Write one of our errors as the answer to a request."""
    status, title = next(STATUS[kind] for kind in type(error).__mro__ if kind in STATUS)
    headers = _HEADERS.get(status)
    detail = error.detail[:_LONGEST]
    return problem_for(scope, status, title, detail, error.errors[:_MOST_ERRORS], headers)


def error_response(request: Request, error: Exception) -> Response:
    """Answer an error as a problem."""
    return _writer(error)(request, error)


def is_expected(error: Exception) -> bool:
    """Whether there is an answer to an error; else somebody has to look at it."""
    return _writer(error) is not _unexpected


def _writer(error: Exception) -> Callable[[Request, Any], Response]:
    return next(_WRITERS[kind] for kind in type(error).__mro__ if kind in _WRITERS)


def _thermap_error(request: Request, error: ThermapError) -> Response:
    return problem_of(request.scope, error)


def _invalid_request(request: Request, error: RequestValidationError | ValidationError) -> Response:
    # A parameter that two dependencies read is refused by both.
    field_errors = list(dict.fromkeys(map(field_error, error.errors())))
    least = "at least " if len(field_errors) >= ENOUGH_ERRORS else ""
    more = f" (and {least}{len(field_errors) - 3} more)" if len(field_errors) > 3 else ""
    detail = "; ".join(f"{e.field}: {e.message}" for e in field_errors[:3]) + more
    return problem_for(request.scope, 422, "Invalid content", detail, field_errors[:_MOST_ERRORS])


def _http_error(request: Request, error: HTTPException) -> Response:
    if error.status_code == 400:
        return _unreadable(error)
    if error.status_code == 405:
        return _other_method(request)
    title = _TITLES.get(error.status_code, message("Error"))
    detail = str(error.detail)
    if error.status_code == 404:
        detail = f"there is nothing at {request.url.path}; /docs lists what there is"
    return problem_for(request.scope, error.status_code, title, detail, headers=error.headers)


def _other_method(request: Request) -> Response:
    """Say which methods a path has; that is also all there is to say to OPTIONS."""
    allowed = methods_at(request)
    headers = {"Allow": ", ".join(allowed)}
    if request.method == "OPTIONS":
        return Response(status_code=204, headers=headers)
    detail = f"expected {list_names(allowed)}, got {request.method[:80]}"
    return problem(405, _TITLES[405], detail, headers=headers)


def methods_at(request: Request) -> list[str]:
    """List the methods of a path: a path that several routes share has those of all."""
    methods = {"OPTIONS"}
    for context in iter_route_contexts(request.app.routes):
        match, _ = context.matches(request.scope)
        if match is not Match.NONE:
            methods |= context.methods or {"GET"}  # files have none
    return sorted(methods | ({"HEAD"} if "GET" in methods else set()))


def _unreadable(error: HTTPException) -> Response:
    """Refuse a body that the framework gave up on: no UTF-8, or nested without end."""
    message = f"expected JSON in UTF-8, got what cannot be read as such: {error.__cause__}"
    return problem(422, "Invalid content", f"body: {message}", [FieldError("body", message)])


def _concurrent_change(_request: Request, _error: Exception) -> Response:
    return problem(
        409, "Conflict", "another request changed the same thing at the same moment; try again"
    )


def _unexpected(request: Request, error: Exception) -> Response:
    log.error("unexpected error at %s", request.url.path, exc_info=error)
    where = f"the service's log has the details, at request {request_id.get()}"
    detail = f"{type(error).__name__}; {where}"
    return problem_for(request.scope, 500, message("Unexpected error"), detail)


_WRITERS: Final[Mapping[type, Callable[[Request, Any], Response]]] = {
    ThermapError: _thermap_error,
    RequestValidationError: _invalid_request,
    ValidationError: _invalid_request,
    HTTPException: _http_error,
    IntegrityError: _concurrent_change,
    Exception: _unexpected,
}
"""A kind of error, or the nearest above it, to what writes its answer."""


def _without_surrogates(text: str) -> str:
    """Write half characters, which UTF-8 does not have, as what they are."""
    return text.encode("utf-8", "backslashreplace").decode()
