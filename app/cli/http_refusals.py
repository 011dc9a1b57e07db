"""What HTTP refuses before a request reaches the service: the limits, and the sentences."""

from __future__ import annotations

import json
from dataclasses import dataclass
from http import HTTPStatus
from typing import Final

LONGEST_BODY_S: Final = 600
"""Until when all of a body must have come [s]: who was allowed to send it may not be any more."""

LONGEST_URL: Final = 8 * 1024
"""Path and query [bytes]."""

LONGEST_HEAD: Final = 32 * 1024
"""A head, or what stands between the parts of a body, which is never anything [bytes]."""

MOST_HEADERS: Final = 100
"""Header fields of a request."""

MOST_UNANSWERED: Final = 16
"""Requests on one connection that wait for their answers."""

MOST_CONNECTIONS: Final = 4096
"""Of one process, or half of the files that it may open where these are fewer."""

MOST_BODY_BYTES: Final = 128 * 1024 * 1024
"""Of all requests that are not answered yet; one sender has half of it."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """An answer that ends its connection, with further header fields, such as Retry-After."""

    status: HTTPStatus
    title: str
    detail: str
    headers: tuple[str, ...] = ()

    @property
    def answer(self) -> bytes:
        """Write the whole answer, after which the connection is closed."""
        content: dict[str, object] = {
            "type": "about:blank",
            "title": self.title,
            "status": self.status.value,
            "detail": self.detail,
            "errors": [],
        }
        body = json.dumps(content, separators=(",", ":"))
        lines = [
            f"HTTP/1.1 {self.status.value} {self.status.phrase}",
            *self.headers,
            "connection: close",
            "content-type: application/problem+json",
            f"content-length: {len(body)}",
        ]
        return "\r\n".join([*lines, "", body]).encode("ascii")


class Refused(Exception):
    """What the parser calls back stops it with."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.detail)
        self.refusal = refusal


STOPPED: Final = Refusal(
    HTTPStatus.REQUEST_TIMEOUT,
    "Request stopped half-way",
    "expected the rest of the request, got nothing or next to nothing for too long",
)
BODY_TOO_SLOW: Final = Refusal(
    HTTPStatus.REQUEST_TIMEOUT,
    "Request too slow",
    f"expected the whole body within {LONGEST_BODY_S} s; send it in parts",
)
URL_TOO_LONG: Final = Refusal(
    HTTPStatus.REQUEST_URI_TOO_LONG,
    "URL too long",
    f"expected a URL of at most {LONGEST_URL} bytes",
)
HEAD_TOO_LONG: Final = Refusal(
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
    "Head too long",
    f"expected a head of at most {LONGEST_HEAD} bytes",
)
TOO_MANY_HEADERS: Final = Refusal(
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE,
    "Too many header fields",
    f"expected at most {MOST_HEADERS} header fields",
)
FRAMES_TOO_LONG: Final = Refusal(
    HTTPStatus.BAD_REQUEST,
    "Chunk too long",
    f"expected the size of a chunk, with extensions, in at most {LONGEST_HEAD} bytes",
)
TRAILERS: Final = Refusal(
    HTTPStatus.BAD_REQUEST, "Trailers", "expected the end of the body, got header fields behind it"
)
TOO_MANY_AHEAD: Final = Refusal(
    HTTPStatus.TOO_MANY_REQUESTS,
    "Too many requests at once",
    f"expected at most {MOST_UNANSWERED} requests on a connection before their answers",
    ("retry-after: 1",),
)
NO_ROOM: Final = Refusal(
    HTTPStatus.SERVICE_UNAVAILABLE,
    "Too many connections",
    "all connections are in use; of those that wait for their sender the oldest were ended",
    ("retry-after: 5",),
)
ENDS: Final = Refusal(
    HTTPStatus.SERVICE_UNAVAILABLE,
    "The service ends",
    "the service ends before the answer is there: whether something was changed is not known, "
    "try again when it is back",
    ("retry-after: 5",),
)


def unreadable(error: Exception) -> Refusal:
    """Refuse what is no HTTP."""
    return Refusal(
        HTTPStatus.BAD_REQUEST,
        "Bad request",
        f"expected a request of HTTP/1.1, got what cannot be read as one: {error}",
    )
