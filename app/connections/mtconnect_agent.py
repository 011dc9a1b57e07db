"""Ask an MTConnect agent over HTTP: bounded in time and size, since an agent may be anything."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncGenerator, Callable, Iterator, Mapping, Sequence
from contextlib import aclosing
from email.message import Message
from typing import Final, TypeVar

import httpx
from starlette.concurrency import run_in_threadpool

from app.connections.mtconnect_documents import (
    DataItem,
    NotMtconnect,
    Streams,
    read_probe,
    read_streams,
)

Document = TypeVar("Document")

LARGEST_DOCUMENT: Final = 8 * 1024 * 1024
"""Of any answer, or any part of a streamed one [bytes]: some ten thousand observations."""

SHORT_DOCUMENT: Final = 64 * 1024
"""That is read at once [bytes]: a longer one would hold up live tables, and has a thread."""

MOST_AT_ONCE: Final = 1000
"""Observations that are asked for at once; an agent refuses more than its buffer has room for."""

ANSWER_S: Final = 20.0
"""How long an answer may take from the first to the last byte [s]."""

HEARTBEAT_S: Final = 10.0
"""After so long without an observation a streaming agent sends an empty document [s]."""

PART_HEADER: Final = 8192
"""Largest header of a streamed document [bytes]."""

DOCUMENTS: Final = "text/xml, application/xml"


_END_OF_HEADER: Final = re.compile(rb"\n\r?\n")
"""Lines end with either, also in one header."""


class Parts:
    """Takes documents out of a `multipart/x-mixed-replace` body as it comes."""

    def __init__(self, boundary: str) -> None:
        self._mark = b"--" + boundary.encode("latin-1", "replace")
        self._buffer = bytearray()
        self._length: int | None = None
        self._in_body = False
        self._looked_to = 0

    def feed(self, content: bytes) -> Iterator[bytes]:
        """Take bytes, give the documents that are whole by now.

        Raises
        ------
        NotMtconnect
            If a document is too large, or has no header.
        """
        self._buffer += content
        while (document := self._next()) is not None:
            yield document
        if len(self._buffer) > LARGEST_DOCUMENT:
            raise _too_large()

    def _next(self) -> bytes | None:
        if not self._in_body and not self._take_header():
            return None
        length = self._length
        if length is None:
            # Without a length a document ends where the next begins.
            length = self._buffer.find(self._mark, self._looked_to)
            if length < 0:
                # The mark may begin at the end of what has come; what lies before is not searched
                # twice.
                self._looked_to = max(0, len(self._buffer) - len(self._mark))
                return None
        if len(self._buffer) < length:
            return None
        document = bytes(self._buffer[:length])
        del self._buffer[:length]
        self._in_body = False
        return document.strip()

    def _take_header(self) -> bool:
        begin = self._buffer.find(self._mark)
        if begin < 0:
            if len(self._buffer) > PART_HEADER:
                raise NotMtconnect("expected the boundary of a streamed document, got none")
            return False
        end = _END_OF_HEADER.search(self._buffer, begin, begin + PART_HEADER)
        if end is None:
            if len(self._buffer) - begin >= PART_HEADER:
                raise NotMtconnect("expected a streamed document's header, got no end of it")
            return False
        self._length = _length_of(bytes(self._buffer[begin : end.start()]))
        del self._buffer[: end.end()]
        self._in_body, self._looked_to = True, 0
        return True


def _length_of(header: bytes) -> int | None:
    for line in header.split(b"\n"):
        name, _, value = line.partition(b":")
        if name.strip().lower() != b"content-length":
            continue
        if not value.strip().isdigit() or len(value.strip()) > 12:
            raise NotMtconnect(f"expected a streamed document's length, got {value[:40]!r}")
        if int(value) > LARGEST_DOCUMENT:
            raise _too_large()
        return int(value)
    return None


class Agent:
    """An agent's three questions, and the streamed form of the last.

    All raise `AgentRefused`, `NotMtconnect`, httpx.HTTPError or TimeoutError.
    """

    def __init__(self, http: httpx.AsyncClient, url: str) -> None:
        self._http = http
        self._url = url.rstrip("/")
        self.most_at_once = MOST_AT_ONCE

    async def probe(self) -> Sequence[DataItem]:
        """Ask what data items there are."""
        return await _read(read_probe, await self._whole("probe", {}))

    async def current(self) -> Streams:
        """Ask what holds now; what is asked for from then on fits the agent's buffer."""
        streams = await _read(read_streams, await self._whole("current", {}))
        self.most_at_once = max(1, min(MOST_AT_ONCE, streams.buffer_size or MOST_AT_ONCE))
        return streams

    async def sample(self, since: int) -> Streams:
        """Ask what was observed from a sequence number on."""
        query = {"from": str(since), "count": str(self.most_at_once)}
        return await _read(read_streams, await self._whole("sample", query))

    async def stream(self, since: int, interval_s: float) -> AsyncGenerator[Streams, None]:
        """Let the agent send what it observes from a sequence number on, and heartbeats.

        An agent that does not stream answers once.
        """
        query = {
            "from": str(since),
            "count": str(self.most_at_once),
            "interval": str(round(interval_s * 1000)),
            "heartbeat": str(round(HEARTBEAT_S * 1000)),
        }
        limit = httpx.Timeout(ANSWER_S, read=3 * HEARTBEAT_S)
        async with self._http.stream(
            "GET", f"{self._url}/sample", params=query, headers=_HEADERS, timeout=limit
        ) as response:
            boundary = _boundary_of(response)
            if boundary is None:
                async with asyncio.timeout(ANSWER_S):
                    content = await _content_of(response)
                yield await _read(read_streams, content)
                return
            async with aclosing(_documents(response, Parts(boundary))) as documents:
                async for document in documents:
                    yield await _read(read_streams, document)

    async def _whole(self, question: str, query: Mapping[str, str]) -> bytes:
        async with (
            asyncio.timeout(ANSWER_S),
            self._http.stream(
                "GET", f"{self._url}/{question}", params=query, headers=_HEADERS
            ) as response,
        ):
            return await _content_of(response)


async def _read(read: Callable[[bytes], Document], content: bytes) -> Document:
    if len(content) <= SHORT_DOCUMENT:
        return read(content)
    return await run_in_threadpool(read, content)


# Compressed, a small answer could be a huge one.
_HEADERS: Final = {"Accept": DOCUMENTS, "Accept-Encoding": "identity"}


async def _content_of(response: httpx.Response) -> bytes:
    """Read an answer up to its limit; error documents come with any status."""
    _expect_plain(response)
    content = bytearray()
    async for piece in response.aiter_raw():
        content += piece
        if len(content) > LARGEST_DOCUMENT:
            raise _too_large()
    if not content.strip():
        raise NotMtconnect(
            f"expected a document of MTConnect, got HTTP {response.status_code} and nothing"
        )
    if response.is_success or b"MTConnectError" in content:
        return bytes(content)
    raise NotMtconnect(
        f"expected a document of MTConnect, got HTTP {response.status_code} from {response.url}"
    )


async def _documents(response: httpx.Response, parts: Parts) -> AsyncGenerator[bytes, None]:
    """Give streamed documents; TimeoutError where bytes come, but for too long no document."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(3 * HEARTBEAT_S) as limit:
        async for piece in response.aiter_raw():
            for document in parts.feed(piece):
                # The time of whoever takes the document is not the agent's.
                limit.reschedule(None)
                yield document
                limit.reschedule(loop.time() + 3 * HEARTBEAT_S)


def _boundary_of(response: httpx.Response) -> str | None:
    """Name what stands between streamed documents; None where there is one document."""
    _expect_plain(response)
    header = Message()
    header["Content-Type"] = response.headers.get("Content-Type", "")
    if not header.get_content_type().startswith("multipart/"):
        return None
    boundary = header.get_boundary()
    if not boundary:
        raise NotMtconnect("expected a multipart answer's boundary, got none")
    # Some agents write it with its leading dashes.
    return boundary.removeprefix("--")


def _expect_plain(response: httpx.Response) -> None:
    encoding = response.headers.get("Content-Encoding", "identity")
    if encoding != "identity":
        raise NotMtconnect(f"expected an answer that is not compressed, got {encoding[:40]!r}")


def _too_large() -> NotMtconnect:
    return NotMtconnect(
        f"expected a document of at most {LARGEST_DOCUMENT >> 20} MiB, got a larger one"
    )
