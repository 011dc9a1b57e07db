"""HTTP with limits: on heads, on what is sent ahead, on time, on connections and on bodies.

Neither the server nor the framework has any. Everything is counted while it comes, and what goes
beyond a limit is refused in a sentence that names it, after the answers to what came before it. The
server looks at all connections once a second: what costs a plain request next to nothing.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

import httptools
import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from app.api.access import holder_of
from app.cli.http_refusals import (
    BODY_TOO_SLOW,
    ENDS,
    FRAMES_TOO_LONG,
    HEAD_TOO_LONG,
    LONGEST_BODY_S,
    LONGEST_HEAD,
    LONGEST_URL,
    MOST_BODY_BYTES,
    MOST_CONNECTIONS,
    MOST_HEADERS,
    MOST_UNANSWERED,
    NO_ROOM,
    STOPPED,
    TOO_MANY_AHEAD,
    TOO_MANY_HEADERS,
    TRAILERS,
    URL_TOO_LONG,
    Refusal,
    Refused,
    unreadable,
)
from app.connections.sparing_log import SparingLog

SLOWEST_BYTES_PER_S: Final = 200
"""Of a body, or of an answer that is waited for to be read, once it has had twice the patience: the
slowest radio link carries more."""

_PIECE: Final = 4096
"""Bytes that the parser is handed at once: limits are looked at in between."""

_LINGER_S: Final = 2.0
"""How long a refused sender may go on before the connection is cut [s]: who still sends when it is
closed loses the answer."""

_SHARE_ENDED: Final = 20
"""One in so many of the connections is ended to make room, so that the next ones find some."""


@dataclass(slots=True)
class _UnansweredRequest:
    """A request that is not answered, and how much of its body has come."""

    cycle: RequestResponseCycle
    body_bytes: int = 0


@dataclass(slots=True, eq=False)
class SharedLimits:
    """What the connections of one process share.

    Parameters
    ----------
    count_refusal
        Is told the status of each refusal.
    most_body_bytes
        Of all requests that are not answered yet.
    """

    count_refusal: Callable[[int], None]
    most_connections: int = MOST_CONNECTIONS
    most_body_bytes: int = MOST_BODY_BYTES
    body_bytes: int = 0
    _log: SparingLog = field(default_factory=SparingLog)

    def note(self, refusal: Refusal, address: str) -> None:
        """Count a refusal, and log one of its kind in a while: floods do not flood the log."""
        self.count_refusal(refusal.status.value)
        self._log.warn(
            refusal.title, f"refused {address} with {refusal.status.value}: {refusal.detail}"
        )

    def make_room(self, connections: set[Any]) -> None:
        """End those that have waited longest for what their senders still owe.

        First those that have asked nothing, then those with half a body. Nobody who is served
        is ended.
        """
        waiting = [c for c in _ours(connections) if c.waits_for_sender]
        waiting.sort(key=lambda c: (bool(c.unanswered), c.began))
        for connection in waiting[: 1 + len(connections) // _SHARE_ENDED]:
            connection.end_for_room()

    def refuse_bodies(self, latest: PatientProtocol, connections: set[Any]) -> None:
        """Keep one sender to half of the bytes, and all to the whole: who has most gives way."""
        half = self.most_body_bytes // 2
        if self.body_bytes <= half:
            return
        with_bodies = [(c.holder, c) for c in _ours(connections) if c.body_bytes]
        bytes_by_holder: Counter[str] = Counter()
        for holder, connection in with_bodies:
            bytes_by_holder[holder] += connection.body_bytes
        if self.body_bytes > self.most_body_bytes:
            most = max(bytes_by_holder, key=bytes_by_holder.__getitem__, default=latest.holder)
        elif bytes_by_holder[latest.holder] > half:
            most = latest.holder
        else:
            return
        unfinished = [c for holder, c in with_bodies if holder == most and c.is_receiving]
        loser = max(unfinished, key=lambda c: c.body_bytes, default=latest)
        loser.refuse(
            Refusal(
                HTTPStatus.SERVICE_UNAVAILABLE,
                "Too many bodies at once",
                f"expected at most {self.most_body_bytes} bytes in all bodies that are not "
                "answered yet, half of them from one sender; send one after the other",
                ("retry-after: 5",),
            )
        )


class PatientProtocol(HttpToolsProtocol):
    """HTTP as the server has it, within limits."""

    def __init__(self, *args: Any, limits: SharedLimits, **named: Any) -> None:
        super().__init__(*args, **named)
        self.limits = limits

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for a first request from here on, where there is room."""
        self.began = self.last_came = self.loop.time()
        self.came_bytes = 0
        self.unreported_bytes = 0
        self.body_bytes = 0
        self.parts: list[bytes] = []
        self.is_receiving = True
        self.has_headers = False
        self.unread: tuple[float, int] | None = None
        self.unanswered: deque[_UnansweredRequest] = deque()
        self.refusal: Refusal | None = None
        self.ended_at: float | None = None
        if len(self.connections) >= self.limits.most_connections:
            self.limits.make_room(self.connections)
        super().connection_made(transport)
        if len(self.connections) > self.limits.most_connections:
            self.refuse(NO_ROOM)

    def connection_lost(self, exc: Exception | None) -> None:
        """Let every request know that nobody waits for its answer.

        The server tells it to the last one that came only. Where several were sent at once, it is
        another one that is being answered, and would write to what is closed.
        """
        for request in self.unanswered:
            request.cycle.disconnected = True
        self._forget(sum(asked.body_bytes for asked in self.unanswered))
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read what came, within limits."""
        self.last_came = self.loop.time()
        self._unset_keepalive_if_required()
        for first in range(0, len(data), _PIECE):
            if self.refusal is not None:
                return
            self._read(data if len(data) <= _PIECE else data[first : first + _PIECE])
        self.limits.refuse_bodies(self, self.connections)

    def _read(self, piece: bytes) -> None:
        self.unreported_bytes += len(piece)
        try:
            self.parser.feed_data(piece)
        except httptools.HttpParserUpgrade:
            self.cycle.keep_alive = False  # it is answered as what else it is, and nothing after it
        except httptools.HttpParserCallbackError as error:
            cause = error.__context__
            self.refuse(cause.refusal if isinstance(cause, Refused) else unreadable(error))
        except httptools.HttpParserError as error:
            self.refuse(unreadable(error))
        else:
            self.came_bytes += len(piece)
            if self.parts:
                self._hand_on_parts()
            if self.unreported_bytes > LONGEST_HEAD:
                self.refuse(FRAMES_TOO_LONG if self.has_headers else HEAD_TOO_LONG)

    def on_message_begin(self) -> None:
        """Begin another request."""
        if len(self.unanswered) >= MOST_UNANSWERED:
            raise Refused(TOO_MANY_AHEAD)
        self.began = self.last_came
        self.came_bytes = self.unreported_bytes = 0
        self.is_receiving = True
        self.has_headers = False
        super().on_message_begin()

    def on_url(self, url: bytes) -> None:
        """Take a part of the URL."""
        super().on_url(url)
        if len(self.url) > LONGEST_URL:
            raise Refused(URL_TOO_LONG)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a header field; one behind the body would be taken for one of the head's."""
        if self.has_headers:
            raise Refused(TRAILERS)
        if len(self.headers) >= MOST_HEADERS:
            raise Refused(TOO_MANY_HEADERS)
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """Know that only a body is still to come."""
        super().on_headers_complete()
        self.has_headers = True
        self.unreported_bytes = 0
        self.unanswered.append(_UnansweredRequest(self.cycle))

    def on_body(self, body: bytes) -> None:
        """Take a part of a body; it may be a byte, as it is sent, and so costs next to nothing."""
        self.parts.append(body)

    def _hand_on_parts(self) -> None:
        """Hand on what came of a body, and count what somebody reads."""
        self.unreported_bytes = 0
        body = b"".join(self.parts)
        self.parts.clear()
        super().on_body(body)
        if not self.cycle.response_complete:
            self.unanswered[-1].body_bytes += len(body)
            self.body_bytes += len(body)
            self.limits.body_bytes += len(body)

    def on_message_complete(self) -> None:
        """Know that all of the request has come."""
        if self.parts:
            self._hand_on_parts()
        self.is_receiving = False
        self.unreported_bytes = 0
        super().on_message_complete()

    def on_response_complete(self) -> None:
        """Go on to the next request; after the last one comes the refusal, where there is one."""
        self._forget(self.unanswered.popleft().body_bytes)
        super().on_response_complete()
        if self.refusal is not None and not self.unanswered and not self.transport.is_closing():
            self._end()

    def resume_writing(self) -> None:
        """Know that what waited was read: what waits from here on is another part."""
        self.unread = None
        super().resume_writing()

    def shutdown(self) -> None:
        """Close what only lingers; the others have their answers first."""
        if self.ended_at is not None:
            self.transport.close()
        else:
            super().shutdown()

    @property
    def holder(self) -> str:
        """Who sends: the key's name, or the address."""
        return holder_of(dict(self.unanswered[-1].cycle.scope)) if self.unanswered else ""

    @property
    def waits_for_sender(self) -> bool:
        """Whether nothing is being answered, nor could be without more of a request."""
        if not self.unanswered:
            return True
        cycle = self.unanswered[0].cycle
        return self.is_receiving and cycle is self.cycle and not cycle.response_started

    def refuse(self, refusal: Refusal) -> None:
        """Answer what came whole, then write the refusal and close; nothing more is read."""
        if self.refusal is not None or self.transport.is_closing():
            return
        self.refusal = refusal
        self.limits.note(refusal, self.client[0] if self.client else "somebody")
        if self.is_receiving and self.has_headers:
            if self.cycle.response_complete:
                self.transport.close()  # it was answered before all of it had come
                return
            self._drop_last()
        if not self.unanswered:
            self._end()

    def _drop_last(self) -> None:
        """Answer the request of which the body is not whole with nothing else."""
        cycle = self.unanswered[-1].cycle
        if cycle.response_started:
            cycle.keep_alive = False
            return
        self._forget(self.unanswered.pop().body_bytes)
        if self.pipeline and self.pipeline[0][0] is cycle:
            self.pipeline.popleft()  # it has not begun
        cycle.disconnected = True
        cycle.message_event.set()

    def _end(self) -> None:
        """Write the refusal, and let who still sends read it before the connection is cut."""
        assert self.refusal is not None
        self.ended_at = self.loop.time()
        self.transport.write(self.refusal.answer)
        self._unset_keepalive_if_required()
        self.flow.resume_reading()
        self.transport.write_eof()

    def _forget(self, body_bytes: int) -> None:
        self.body_bytes -= body_bytes
        self.limits.body_bytes -= body_bytes

    def end_for_room(self) -> None:
        """Make room for another connection."""
        if self.came_bytes and self.is_receiving:
            self.refuse(NO_ROOM)
        self.connections.discard(self)  # it is lost a moment later, and counts no more
        self.transport.close()

    def end_if_stopped(self, now: float, patience_s: float) -> None:
        """Answer 408 and close, where a request has stopped half-way.

        Headers must be complete within the patience. A body may take its time while it goes on,
        at no less than a crawl, until its own end.
        """
        if self.transport.is_closing():
            return
        if self.ended_at is not None:
            if now - self.ended_at > _LINGER_S:
                self.transport.abort()
            return
        if not self.is_receiving:
            return
        if self.flow.read_paused:
            self.last_came = now  # it is we who do not read
            return
        age_s = now - self.began
        if not self.has_headers:
            if age_s > patience_s:
                if self.came_bytes:
                    self.refuse(STOPPED)
                elif not self.unanswered:
                    self.transport.close()
            return
        crawls = self.came_bytes < SLOWEST_BYTES_PER_S * (age_s - 2.0 * patience_s)
        if now - self.last_came > patience_s or crawls:
            self.refuse(STOPPED)
        elif age_s > LONGEST_BODY_S:
            self.refuse(BODY_TOO_SLOW)

    def end_if_not_read(self, now: float, patience_s: float) -> None:
        """Let go of an answer that the other side does not read, or next to nothing of it.

        The server writes no more while much waits, so that until it goes on what waits only
        grows less.
        """
        if not self.flow.write_paused:
            return
        unsent = self.transport.get_write_buffer_size()
        if self.unread is None:
            self.unread = (now, unsent)
        else:
            since, before = self.unread
            if before - unsent < SLOWEST_BYTES_PER_S * (now - since - 2.0 * patience_s):
                self.transport.abort()  # closing would wait until it is read

    def end_with_service(self) -> None:
        """Answer 503 and close, where the answer has not begun."""
        if self.transport.is_closing():
            return
        if self.unanswered and not self.unanswered[0].cycle.response_started:
            self.transport.write(ENDS.answer)
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
            for connection in list(_ours(self.server_state.connections)):
                connection.end_if_stopped(now, self.patience_s)
                connection.end_if_not_read(now, self.patience_s)
        return await super().on_tick(counter)

    def end_connections(self) -> None:
        """Answer whoever has no answer yet that the service ends."""
        for connection in list(_ours(self.server_state.connections)):
            connection.end_with_service()


def _ours(connections: Iterable[Any]) -> Iterable[PatientProtocol]:
    return (c for c in connections if isinstance(c, PatientProtocol))
