"""Requests that stop half-way are ended; slow ones that go on are answered."""

import json
import socket
import time
from contextlib import closing, suppress

import pytest

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
    "no body, short way": [head(b"compensation", len(BODY))],
    "half a body, short way": [head(b"compensation", len(BODY)), BODY[:20]],
    "half a body, ordinary way": [head(b"readings", 5000), b"[" * 20],
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
