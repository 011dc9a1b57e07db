"""Bytes of OPC UA from whoever connects, before any session: refused, and nobody waits for them."""

import asyncio
import random
import struct
from contextlib import asynccontextmanager

import pytest

pytest.importorskip("asyncua", reason="the extra opcua is not installed")

from asyncua import Client, Server, ua
from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.ua.ua_binary import struct_from_binary, variant_from_binary

from app.connections import opcua_bounds
from app.connections.opcua_bounds import Refused, bound_server, next_message
from app.connections.opcua_readers import OwnServer, Readers
from app.connections.opcua_session import Access, session_with
from tests.connections.mosquitto_example import free_port

pytestmark = pytest.mark.anyio


def header(kind=b"HEL", size=32, chunk=b"F"):
    return kind + chunk + struct.pack("<I", size)


def hello(receive=65535, send=65535, url=b"opc.tcp://h"):
    body = struct.pack("<5I", 0, receive, send, 0, 0) + struct.pack("<i", len(url)) + url
    return header(size=8 + len(body)) + body


@asynccontextmanager
async def serving():
    server = Server(OwnServer(Readers(None)))
    await server.init()
    bound_server(server)
    port = free_port()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}/thermap")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    async with server:
        yield server, port


async def serves(port):
    async with asyncio.timeout(60), Client(f"opc.tcp://127.0.0.1:{port}/thermap") as client:
        return await client.nodes.server_state.read_value() == 0


NO_MESSAGES = [
    header(b"HEL", 2**32 - 1),
    header(b"OPN", 2**32 - 1),
    header(b"MSG", 65_536),
    header(b"MSG", 8),
    header(b"HEL", 0),
    header(b"GET", 100),
    b"GET / HTTP/1.1\r\n\r\n",
    hello(receive=1),
    hello(send=0),
]


@pytest.mark.parametrize("sent", NO_MESSAGES)
def test_what_is_no_message_is_refused_at_its_header(sent):
    with pytest.raises(Refused, match="expected"):
        next_message(bytearray(sent), opcua_bounds.LARGEST_CHUNK)


async def test_who_sends_no_message_is_told_so_and_left():
    async with serving() as (_, port):
        for sent in NO_MESSAGES:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(sent)
            async with asyncio.timeout(60):
                assert (await reader.read()).startswith(b"ERRF")
            writer.close()
        assert await serves(port)


def test_a_message_is_whole_before_it_is_handed_on():
    received = bytearray()
    for byte in hello():
        assert next_message(received, 65_535) is None
        received.append(byte)
    assert next_message(received, 65_535) == hello()
    assert received == b""


async def test_idle_connections_make_room(monkeypatch):
    monkeypatch.setattr(opcua_bounds, "MOST_CONNECTIONS", 20)
    async with serving() as (server, port):
        idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(60)]
        assert await serves(port)
        assert len(server.bserver.clients) <= 20
        for _, writer in idle:
            writer.close()


async def test_who_has_a_session_is_not_sent_away(monkeypatch):
    monkeypatch.setattr(opcua_bounds, "MOST_CONNECTIONS", 5)
    async with serving() as (_, port), Client(f"opc.tcp://127.0.0.1:{port}/thermap") as client:
        idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(30)]
        assert await client.nodes.server_state.read_value() == 0
        for _, writer in idle:
            writer.close()


@pytest.mark.parametrize(
    "content",
    [
        # An array of nothing, of which an element takes no byte.
        bytes([0x80]) + struct.pack("<i", 2**31 - 1),
        # Strings whose length steps back to before itself.
        bytes([0x80 | 12]) + struct.pack("<ii", 2**31 - 1, -4),
        bytes([0x80 | 24]) + struct.pack("<i", 2**31 - 1) + bytes(8),
        bytes([12]) + struct.pack("<i", -8),
    ],
)
def test_no_length_is_more_than_is_there(content):
    with pytest.raises(NotEnoughData):
        variant_from_binary(Buffer(content))


def test_no_list_of_a_request_is_more_than_is_there():
    content = struct.pack("<i", 1) + b"u" + struct.pack("<ii", 2**31 - 1, -4) + bytes(8)
    with pytest.raises(NotEnoughData):
        struct_from_binary(ua.GetEndpointsParameters, Buffer(content))


async def test_a_server_that_states_four_gigabytes_is_left():
    async def answer(reader, writer):
        await reader.read(100)
        writer.write(header(b"ACK", 2**32 - 1))
        await reader.read()
        writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]

    async def lost(_why):
        pass

    async with server:
        with pytest.raises(Refused, match="4294967295"):
            async with session_with(Access(f"opc.tcp://127.0.0.1:{port}/x"), lost):
                pass


async def recorded(port):
    """Take down what a client sends that opens a session and reads."""
    sent = bytearray()

    async def relay(reader, writer):
        there, out = await asyncio.open_connection("127.0.0.1", port)

        async def back():
            while data := await there.read(65_536):
                writer.write(data)

        returning = asyncio.create_task(back())
        while data := await reader.read(65_536):
            sent.extend(data)
            out.write(data)
        out.close()
        await returning
        writer.close()

    server = await asyncio.start_server(relay, "127.0.0.1", 0)
    async with server:
        assert await serves(server.sockets[0].getsockname()[1])
    messages = []
    while message := next_message(sent, 65_535):
        messages.append(message)
    return messages


def mutated(random_, messages):
    """Change bytes, lengths and order of a few messages of a session."""
    chosen = messages[: random_.randint(1, len(messages))]
    if random_.random() < 0.3:
        chosen = random_.choices(messages, k=random_.randint(1, 6))
    out = bytearray()
    for message in chosen:
        changed = bytearray(message)
        for _ in range(random_.choice([0, 0, 1, 2, 8])):
            at = random_.randrange(len(changed))
            kind = random_.random()
            if kind < 0.4:
                changed[at] = random_.randrange(256)
            elif kind < 0.7:
                number = random_.choice([0, -1, -4, -8, 2**31 - 1, 100_000, 255])
                changed[at : at + 4] = struct.pack("<i", number)
            elif kind < 0.85:
                del changed[at : at + random_.randint(1, 16)]
            else:
                changed[at:at] = random_.randbytes(random_.randint(1, 16))
        if random_.random() < 0.7 and len(changed) >= 8:
            changed[4:8] = struct.pack("<I", len(changed))
        out += changed
    return bytes(out)


async def test_hostile_bytes_end_nothing_but_their_connection(hostile_inputs):
    random_ = random.Random(28)
    unforeseen = []
    asyncio.get_running_loop().set_exception_handler(lambda _loop, about: unforeseen.append(about))
    async with serving() as (server, port):
        messages = await recorded(port)
        assert len(messages) > 5
        for _ in range(hostile_inputs):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(mutated(random_, messages))
            await asyncio.sleep(0)
            writer.transport.abort()
        assert await serves(port)
        async with asyncio.timeout(120):
            while len(server.bserver.clients) > 1:
                await asyncio.sleep(0.05)
    assert [about for about in unforeseen if "exception" in about] == []
