"""Ending requests that stop half-way, answers that nobody reads, and what the end overtakes.

Neither the server nor the framework ever ends the former, and the latter get no answer of theirs.

Who opens many connections and sends or reads a little over each would otherwise keep them all, and
an answer that nobody reads would stay in memory for as long as its connection. The
server looks at all connections once a second: what costs a plain request next to nothing.
"""

from __future__ import annotations

import asyncio
import json
from http import HTTPStatus
from typing import Final

import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

SLOWEST_BYTES_PER_S: Final = 200
"""Of a body, or of an answer that is waited for to be read, once it has had twice the patience: the
slowest radio link carries more."""


def _answer(status: HTTPStatus, title: str, detail: str, *headers: str) -> bytes:
    """Write a whole answer, after which the connection is closed."""
    content = {"type": "about:blank", "title": title, "status": status.value, "detail": detail}
    body = json.dumps(content | {"errors": []}, separators=(",", ":"))
    lines = [
        f"HTTP/1.1 {status.value} {status.phrase}",
        *headers,
        "connection: close",
        "content-type: application/problem+json",
        f"content-length: {len(body)}",
    ]
    return "\r\n".join([*lines, "", body]).encode("ascii")


_STOPPED: Final = _answer(
    HTTPStatus.REQUEST_TIMEOUT,
    "Request stopped half-way",
    "expected the rest of the request, got nothing or next to nothing for too long",
)

_ENDS: Final = _answer(
    HTTPStatus.SERVICE_UNAVAILABLE,
    "The service ends",
    "the service ends before the answer is there: whether something was changed is not known, "
    "try again when it is back",
    "retry-after: 5",
)


class PatientProtocol(HttpToolsProtocol):
    """HTTP as the server has it, and since when a request is on its way."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a first request from here on."""
        self.began = self.last_came = self.loop.time()
        self.came_bytes = 0
        self.is_receiving = True
        self.has_headers = False
        self.unread: tuple[float, int] | None = None
        self.unanswered: list[RequestResponseCycle] = []
        super().connection_made(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Let every request know that nobody waits for its answer.

        The server tells it to the last one that came only. Where several were sent at once, it is
        another one that is being answered, and would write to what is closed.
        """
        for cycle in self.unanswered:
            cycle.disconnected = True
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Note when something came, and how much."""
        self.last_came = self.loop.time()
        super().data_received(data)
        self.came_bytes += len(data)

    def on_message_begin(self) -> None:
        """Begin another request."""
        self.began = self.last_came
        self.came_bytes = 0
        self.is_receiving = True
        self.has_headers = False
        super().on_message_begin()

    def on_headers_complete(self) -> None:
        """Know that only a body is still to come."""
        self.has_headers = True
        super().on_headers_complete()
        waiting = [cycle for cycle in self.unanswered if not cycle.response_complete]
        if self.cycle is not None and self.cycle not in waiting:  # none where it is no longer HTTP
            waiting.append(self.cycle)
        self.unanswered = waiting

    def on_message_complete(self) -> None:
        """Know that all of the request has come."""
        self.is_receiving = False
        super().on_message_complete()

    def resume_writing(self) -> None:
        """Know that what waited was read: what waits from here on is another part."""
        self.unread = None
        super().resume_writing()

    def end_if_stopped(self, now: float, patience_s: float) -> None:
        """Answer 408 and close, where a request has stopped half-way.

        Headers must be complete within the patience. A body may take as long as it likes while
        it goes on, at no less than a crawl.
        """
        if not self.is_receiving or self.transport.is_closing():
            return
        if self.flow.read_paused:
            self.last_came = now  # it is we who do not read
            return
        age_s = now - self.began
        if self.has_headers:
            crawls = self.came_bytes < SLOWEST_BYTES_PER_S * (age_s - 2.0 * patience_s)
            stopped = now - self.last_came > patience_s or crawls
        else:
            stopped = age_s > patience_s
        if not stopped:
            return
        is_answering = self.cycle is not None and not self.cycle.response_complete
        if self.has_headers:
            may_answer = is_answering and not self.cycle.response_started
        elif is_answering:
            return  # the request before has its answer first
        else:
            may_answer = self.came_bytes > 0
        if may_answer:
            self.transport.write(_STOPPED)
        self.transport.close()

    def end_if_not_read(self, now: float, patience_s: float) -> None:
        """Let go of an answer that the other side does not read, or next to nothing of it.

        The server writes no more while much waits, so that until it goes on what waits only
        grows less.
        """
        if not self.flow.write_paused:
            return
        left = self.transport.get_write_buffer_size()
        if self.unread is None:
            self.unread = (now, left)
        else:
            since, before = self.unread
            if before - left < SLOWEST_BYTES_PER_S * (now - since - 2.0 * patience_s):
                self.transport.abort()  # closing would wait until it is read

    def end_with_service(self) -> None:
        """Answer 503 and close, where the answer has not begun."""
        if self.transport.is_closing():
            return
        waiting = [cycle for cycle in self.unanswered if not cycle.response_complete]
        if waiting and not waiting[0].response_started:
            self.transport.write(_ENDS)
        self.transport.close()


class PatientServer(uvicorn.Server):
    """A server that ends requests that stop half-way, and answers that are not read."""

    def __init__(self, config: uvicorn.Config, patience_s: float) -> None:
        super().__init__(config)
        self.patience_s = patience_s

    async def on_tick(self, counter: int) -> bool:
        """Look at all connections once a second; the server calls this ten times as often."""
        if counter % 10 == 0:
            now = asyncio.get_running_loop().time()
            for connection in self._connections():
                connection.end_if_stopped(now, self.patience_s)
                connection.end_if_not_read(now, self.patience_s)
        return await super().on_tick(counter)

    def end_connections(self) -> None:
        """Answer whoever has no answer yet that the service ends."""
        for connection in self._connections():
            connection.end_with_service()

    def _connections(self) -> list[PatientProtocol]:
        return [c for c in self.server_state.connections if isinstance(c, PatientProtocol)]
