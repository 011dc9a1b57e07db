"""What stops half-way or is not read is ended; what goes on slowly is answered whole."""

import json
import socket
import struct
import time
from contextlib import closing, suppress
from threading import Event

import pytest
from uvicorn.protocols.http.flow_control import FlowControl

from app.cli.http_protocol import PatientProtocol
from app.cli.listening import listening, serving
from app.main import create_app
from app.settings import Settings
from tests.service_examples import furnish_database

PATIENCE_S = 0.5
PATH = b"/v1/machines/mcfv5050"
BODY = json.dumps({"temperatures_c": {"x-middle": 21.0, "z-column": 23.0}}).encode()
HEAD = b"POST %s/%s HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


@pytest.fixture(scope="module")
def port(databases):
    url = databases.prepared("sqlite", furnish_database)
    service = create_app(Settings(database_url=url, patience_s=PATIENCE_S))
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "error"):
        # Of each connection: what is sent and not read soon waits in the service.
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 16_384)
        yield opened.getsockname()[1]
    databases.give_back(url)


def answer_to(port, *pieces, pause_s=0.0):
    """Send pieces and read all that comes until the server closes the connection."""
    with closing(socket.create_connection(("127.0.0.1", port), timeout=60)) as client:
        for piece in pieces:
            client.sendall(piece)
            time.sleep(pause_s)
        came = b""
        # What is sent to a connection that was closed early is answered by a reset: what
        # came before it counts.
        with suppress(ConnectionResetError):
            while piece := client.recv(65536):
                came += piece
        return came


def head(path, length=None):
    stated = b"" if length is None else b"Content-Length: %d\r\nConnection: close\r\n\r\n" % length
    return HEAD % (PATH, path) + stated


HALF_SENT = {
    "half a line": [b"POST /v1/mach"],
    "half the headers": [head(b"compensation")],
    "no body": [head(b"compensation", len(BODY))],
    "half a body": [head(b"compensation", len(BODY)), BODY[:20]],
    "half a long body": [head(b"readings", 5000), b"[" * 20],
    "half a chunk": [head(b"readings") + b"Transfer-Encoding: chunked\r\n\r\n10\r\n[["],
}


@pytest.mark.slow
@pytest.mark.parametrize("pieces", HALF_SENT.values(), ids=HALF_SENT)
def test_what_stops_half_way_is_ended(port, pieces):
    came = answer_to(port, *pieces)
    assert came.startswith(b"HTTP/1.1 408 ")
    assert json.loads(came.partition(b"\r\n\r\n")[2])["status"] == 408


@pytest.mark.slow
def test_a_connection_over_which_nothing_comes_is_closed(port):
    assert answer_to(port) == b""


def test_what_was_refused_early_is_not_answered_twice(port):
    came = answer_to(port, head(b"readings", 10**9), b"[")
    assert came.count(b"HTTP/1.1") == 1
    assert came.startswith(b"HTTP/1.1 413 ")


@pytest.mark.slow
def test_a_slow_body_that_goes_on_is_taken(port):
    spaced = BODY + b" " * 600
    pieces = [spaced[i : i + 50] for i in range(0, len(spaced), 50)]
    came = answer_to(port, head(b"compensation", len(spaced)), *pieces, pause_s=PATIENCE_S / 4)
    assert came.startswith(b"HTTP/1.1 200 ")


@pytest.mark.slow
def test_headers_letter_by_letter_are_not_waited_for(port):
    with closing(socket.create_connection(("127.0.0.1", port), timeout=60)) as client:
        client.sendall(head(b"compensation"))
        with pytest.raises(OSError):  # noqa: PT012
            for _ in range(600):
                client.sendall(b"X-Filler: more\r\n")
                time.sleep(0.1)


LARGE = b"/docs-assets/swagger-ui-bundle.js"


def asked_for_much(port):
    """Ask for more than the connection itself holds; its head, and what came with it."""
    client = socket.socket()
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    client.settimeout(60)
    client.connect(("127.0.0.1", port))
    client.sendall(b"GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n" % LARGE)
    came = b""
    while b"\r\n\r\n" not in came:
        came += client.recv(1024)
    stated, _, body = came.partition(b"\r\n\r\n")
    (length,) = [line for line in stated.lower().split(b"\r\n") if line.startswith(b"content-le")]
    return client, body, int(length.partition(b":")[2])


def read_on(client, body, pause_s):
    with suppress(ConnectionResetError):
        while piece := client.recv(65536):
            body += piece
            time.sleep(pause_s)
    return body


@pytest.mark.slow
def test_an_answer_that_nobody_reads_is_let_go(port, monkeypatch):
    gone, is_gone = set(), Event()
    lose = PatientProtocol.connection_lost

    def lost(connection, error):
        gone.add(connection.client)
        is_gone.set()
        lose(connection, error)

    monkeypatch.setattr(PatientProtocol, "connection_lost", lost)
    client, body, length = asked_for_much(port)
    with closing(client):
        deadline = time.monotonic() + 60
        while client.getsockname() not in gone:
            assert is_gone.wait(max(0.0, deadline - time.monotonic()))
            is_gone.clear()
        assert len(read_on(client, body, 0.0)) < length


@pytest.mark.slow
def test_an_answer_that_is_read_slowly_comes_whole(port):
    client, body, length = asked_for_much(port)
    began_s = time.monotonic()
    with closing(client):
        assert len(read_on(client, body, PATIENCE_S / 50)) == length
    assert time.monotonic() - began_s > 2.0 * PATIENCE_S


class Waiting:
    """A transport of which so much waits to be read."""

    def __init__(self, left):
        self.left = left
        self.is_let_go = False

    def get_write_buffer_size(self):
        return self.left

    def abort(self):
        self.is_let_go = True


def waiting(left):
    connection = PatientProtocol.__new__(PatientProtocol)
    connection.transport, connection.flow = Waiting(left), FlowControl(None)
    connection.unread = None
    return connection


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_reader_whom_as_much_awaits_again_is_none_that_stopped(goes_on):
    connection = waiting(60_000)
    for second in range(60):
        connection.pause_writing()
        connection.transport.left = 60_000 - second
        connection.end_if_not_read(float(second), 10.0)
        if goes_on:  # between two looks a part was read, and the next written
            connection.resume_writing()
    assert connection.transport.is_let_go is not goes_on


def test_who_asks_for_much_at_once_and_goes_leaves_no_error(port, caplog):
    for path in ("", "/error-maps", "/models", "/error-maps/1") * 5:
        client = socket.create_connection(("127.0.0.1", port), timeout=60)
        ask = b"GET %s%s HTTP/1.1\r\nHost: localhost\r\n\r\n" % (PATH, path.encode())
        client.sendall(ask * 5)
        # Gone at once, with what it has not read.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.close()
    again = answer_to(
        port, b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
    )
    assert again.startswith(b"HTTP/1.1 200")
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == []
