"""What OPC UA peers may send, bounded before asyncua takes it in.

asyncua waits for as many bytes as a message's header states, and decodes as many elements as an
array's does, before it looks at its limits; lengths below zero step back in what was read. All of
that comes before anybody has a session.
"""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable
from typing import Any, Final

from asyncua import ua
from asyncua.client.ua_client import UaClient, UASocketProtocol
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.server import server as server_module
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.ua import ua_binary
from asyncua.ua.ua_binary import uatcp_to_binary

LARGEST_CHUNK: Final = 65_535
"""Of a message to the service's own server [bytes]."""

LARGEST_REQUEST: Final = 256 * 1024
"""To it, of all its chunks [bytes]: some thousand nodes are asked for."""

SMALLEST_BUFFER: Final = 8192
"""That a client may state [bytes] (Part 6, 7.1.2.3): its answers would be cut to crumbs."""

MOST_CONNECTIONS: Final = 100
"""Of its clients; beyond them who has no session yet makes room."""

MOST_SUBSCRIPTIONS: Final = 200

MOST_QUEUED: Final = 100
"""Values of a node, and messages of a subscription, that wait for a client."""

ACTIVATED_WITHIN_S: Final = 15.0
"""A client that has no session so long after it came is left [s]."""

MOST_PENDING: Final = 8
"""Requests of a connection that wait for their turn: no more is read meanwhile."""

LARGEST_CHUNK_READ: Final = 128 * 1024
"""Of an answer of a server that is followed [bytes]."""

LARGEST_ANSWER: Final = 16 * 1024 * 1024
"""Of all its chunks [bytes]."""

MOST_PARTS: Final = 1024
"""Chunks of an answer."""

_HEADER: Final = 8
_KINDS: Final = {b"HEL": 32, b"ACK": 28, b"ERR": 16, b"OPN": 12, b"MSG": 12, b"CLO": 12}
"""Kinds of messages, and how long each is at least [bytes]."""


class Refused(ua.UaError):
    """What comes is no message of OPC UA, or a larger one than is read."""


def next_message(received: bytearray, largest: int) -> bytes | None:
    """Take the first message out of what was received; None until it is whole.

    Raises
    ------
    Refused
        As soon as its header says that it will not be read.
    """
    if len(received) < _HEADER:
        return None
    kind, size = bytes(received[:3]), int.from_bytes(received[4:8], "little")
    if kind not in _KINDS:
        raise Refused(f"expected a message of OPC UA, got {kind!r}")
    if not _KINDS[kind] <= size <= largest:
        raise Refused(f"expected a message of {_KINDS[kind]} to {largest} bytes, got {size}")
    if len(received) < size:
        return None
    message = bytes(received[:size])
    del received[:size]
    if kind == b"HEL":
        buffers = (int.from_bytes(message[at : at + 4], "little") for at in (12, 16))
        if min(buffers) < SMALLEST_BUFFER:
            raise Refused(f"expected buffers of at least {SMALLEST_BUFFER} bytes")
    return message


class BoundedProtocol(OPCUAProtocol):
    """A client's connection: whole messages, a few at a time, answers only as they are read."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Make room, where there is none, by leaving who came first and has no session."""
        self._received = bytearray()
        self._is_read = asyncio.Event()
        self._is_read.set()
        if len(self.clients) >= self.iserver.max_connections:
            for other in self.clients:
                if not _has_session(other) and other.transport is not None:
                    other.transport.abort()
                    self.clients.remove(other)
                    break
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Take bytes."""
        self._received += data
        self._hand_on()

    def pause_writing(self) -> None:
        """Answer no more until what was answered is read."""
        self._is_read.clear()

    def resume_writing(self) -> None:
        """Go on."""
        self._is_read.set()

    def _hand_on(self) -> None:
        transport = self.transport
        if transport is None or transport.is_closing():
            return
        try:
            while self.messages.qsize() < MOST_PENDING and (
                message := next_message(self._received, LARGEST_CHUNK)
            ):
                super().data_received(message)
                self._buffer = b""  # of a message that asyncua could not read nothing is left
        except Refused as why:
            code = ua.StatusCode(ua.UInt32(ua.StatusCodes.BadTcpMessageTooLarge))
            error = ua.ErrorMessage(code, ua.String(str(why)))
            kind: Any = ua.MessageType.Error
            transport.write(uatcp_to_binary(kind, error))
            transport.close()
            return
        if self.messages.qsize() < MOST_PENDING:
            transport.resume_reading()
        else:
            transport.pause_reading()

    async def _process_one_msg(self, header: Any, buf: Buffer) -> bool:
        await self._is_read.wait()
        goes_on = await super()._process_one_msg(header, buf)
        self._hand_on()
        return goes_on


def _has_session(client: OPCUAProtocol) -> bool:
    session = None if client.processor is None else client.processor.session
    return session is not None and session.is_activated()


class BoundedServer(BinaryServer):
    """asyncua's, with connections that are bounded."""

    def _make_protocol(self) -> OPCUAProtocol:
        return BoundedProtocol(
            self.iserver, self._policies, self.clients, self.closing_tasks, self.limits
        )


def bound_server(server: server_module.Server) -> None:
    """Set the limits that asyncua has itself."""
    internal: InternalServer = server.iserver
    internal.max_connections = MOST_CONNECTIONS
    internal.max_pending_activation_seconds = ACTIVATED_WITHIN_S
    internal.max_subscriptions = MOST_SUBSCRIPTIONS
    internal.max_monitored_item_queue_size = MOST_QUEUED
    internal.max_unacked_messages_per_subscription = MOST_QUEUED
    server.limits = TransportLimits(
        LARGEST_CHUNK, LARGEST_CHUNK, LARGEST_REQUEST // SMALLEST_BUFFER, LARGEST_REQUEST
    )


class _AnswerLimits(TransportLimits):
    """Limits of what is read, whatever the server says that it would send."""

    def update_client_limits(self, msg: ua.Acknowledge) -> None:
        """Send no larger chunks than the server takes."""
        taken = [size for size in (msg.ReceiveBufferSize, msg.SendBufferSize) if size]
        self.max_send_buffer = max(SMALLEST_BUFFER, min([self.max_send_buffer, *taken]))


class BoundedAnswers(UASocketProtocol):
    """A connection to a server: whole messages of a size that is read."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin."""
        self._received = bytearray()
        super().connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Take bytes; a server that states too much is left."""
        self._received += data
        try:
            while message := next_message(self._received, LARGEST_CHUNK_READ):
                super().data_received(message)
        except Refused as why:
            self._fail_all_pending(why)
            if self.transport is not None:
                self.transport.abort()


def bound_client(client: UaClient) -> None:
    """Let a client take in no more than is read."""

    def make_socket() -> UASocketProtocol:
        limits = _AnswerLimits(65_535, 65_535, MOST_PARTS, LARGEST_ANSWER)
        protocol = BoundedAnswers(client._timeout, client.security_policy, limits)
        protocol.pre_request_hook = client._pre_request_hook
        protocol.on_connection_lost = client._on_transport_lost
        protocol.is_session_closing = client._is_session_closing
        client.protocol = protocol
        return protocol

    client._make_protocol = make_socket  # type: ignore[method-assign]


def _expect_forwards(read: Callable[[Buffer, int], bytes]) -> Callable[[Buffer, int], bytes]:
    @functools.wraps(read)
    def checked(buffer: Buffer, size: int) -> bytes:
        if size < 0:
            raise NotEnoughData(f"expected a length, got {size}")
        return read(buffer, size)

    return checked


def _expect_elements(
    make: Callable[[Any], Callable[[Buffer], Any]],
) -> Callable[[Any], Callable[[Buffer], Any]]:
    """Let arrays have no more elements than bytes are left: of what takes none, any number came."""

    @functools.cache
    def decoder(kind: Any) -> Callable[[Buffer], Any]:
        read = make(kind)

        def checked(data: Buffer) -> Any:
            count = int.from_bytes(data.copy(4).read(4), "little", signed=True)
            if not -1 <= count <= len(data):
                raise NotEnoughData(f"expected an array within {len(data)} bytes, got {count}")
            return read(data)

        return checked

    return decoder


# These are where every message is read, of clients and of servers.
Buffer.read = _expect_forwards(Buffer.read)  # type: ignore[method-assign, assignment]
_codec: Any = ua_binary
_codec._create_list_deserializer = _expect_elements(_codec._create_list_deserializer)
_codec._create_uatype_array_deserializer = _expect_elements(
    _codec._create_uatype_array_deserializer
)
server_module.BinaryServer = BoundedServer  # type: ignore[misc]
