"""A line for each request, and a number by which everything that belongs to it is found."""

from __future__ import annotations

import logging
import re
import secrets
from contextvars import ContextVar
from itertools import count
from time import perf_counter
from typing import Final

from starlette.types import Message, Scope, Send

log = logging.getLogger("thermap.requests")

HEADER: Final = b"x-request-id"

request_id: ContextVar[str] = ContextVar("request_id", default="")
"""Of the request that is answered; empty outside of any."""

_USABLE: Final = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_QUIET: Final = re.compile(r"/(healthz|readyz|metrics|favicon\.ico|(docs-)?assets/.*)")
"""What is asked every few seconds by those who watch, and what pages are made of."""

_LONGEST_PATH: Final = 200
_OURS: Final = secrets.token_hex(4)
_numbers = count(1)


class RequestLog:
    """Watches one request from its beginning to its end.

    Its number is the sender's own where that states a usable one in X-Request-ID, else one of
    ours; it is answered in the same header, and stands in every line of the log meanwhile.
    `status` is what was answered, 0 before that.
    """

    def __init__(self, scope: Scope, send: Send) -> None:
        self._scope = scope
        self._send = send
        self._began = perf_counter()
        self.status = 0
        self._bytes = 0
        self.number = _number_of(scope)
        request_id.set(self.number)

    async def send(self, message: Message) -> None:
        """Pass an answer on, with its number."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
            headers = [*message.get("headers", ()), (HEADER, self.number.encode())]
            message = {**message, "headers": headers}
        elif message["type"] == "http.response.body":
            self._bytes += len(message.get("body", b""))
        await self._send(message)

    def end(self) -> None:
        """Write the line: a stream's at its end."""
        path = self._scope["path"]
        if not log.isEnabledFor(logging.INFO) or _QUIET.fullmatch(path):
            return
        # What stands behind the question mark may be anybody's secret, and is not written.
        printable = "".join(letter if letter.isprintable() else "?" for letter in path)[
            :_LONGEST_PATH
        ]
        duration_ms = round(1000.0 * (perf_counter() - self._began), 2)
        fields = {"method": self._scope["method"], "path": printable, "status": self.status}
        log.info(
            "%s %s %d, %s ms, %d bytes",
            *(fields["method"], printable, self.status, duration_ms, self._bytes),
            extra=fields | {"duration_ms": duration_ms, "bytes": self._bytes},
        )


def _number_of(scope: Scope) -> str:
    for name, value in scope["headers"]:
        if name == HEADER and _USABLE.fullmatch(value):
            return str(value, "ascii")
    return f"{_OURS}-{next(_numbers)}"
