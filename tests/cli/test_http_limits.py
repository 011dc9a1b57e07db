"""What HTTP refuses before a request reaches the service, and that others are served meanwhile."""

import json
import logging
import re
import socket
from contextlib import ExitStack, closing, suppress

import pytest

from app.cli import listening as listening_module
from app.cli.http_protocol import PatientProtocol, SharedLimits
from app.cli.http_refusals import (
    LONGEST_BODY_S,
    LONGEST_HEAD,
    LONGEST_URL,
    MOST_HEADERS,
    MOST_UNANSWERED,
)
from app.cli.listening import listening, serving
from app.main import create_app
from app.settings import Settings
from tests.service_examples import furnish_database

MOST_CONNECTIONS = 40
MOST_BODY_BYTES = 400_000
HEALTH = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
LOGIN = b"POST /login HTTP/1.1\r\nHost: localhost\r\n"
READINGS = (
    b"POST /v1/machines/mcfv5050/readings HTTP/1.1\r\nHost: localhost\r\n"
    b"Content-Type: application/json\r\n"
)
CHUNKED = b"Transfer-Encoding: chunked\r\n\r\n"
PART = 65536


@pytest.fixture(scope="module")
def port(databases):
    url = databases.prepared("sqlite", furnish_database)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(listening_module, "MOST_CONNECTIONS", MOST_CONNECTIONS)
        patch.setattr(listening_module, "MOST_BODY_BYTES", MOST_BODY_BYTES)
        service = create_app(Settings(database_url=url, max_body_bytes=MOST_BODY_BYTES // 4))
        with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
            yield opened.getsockname()[1]
    databases.give_back(url)


def connect(port):
    return socket.create_connection(("127.0.0.1", port), timeout=60)


def read_all(client):
    came = b""
    with suppress(ConnectionResetError):
        while piece := client.recv(PART):
            came += piece
    return came


def endless(port, begin, part):
    """Send a part again and again until the service has had enough; what it answered."""
    with closing(connect(port)) as client:
        client.sendall(begin)
        with suppress(BrokenPipeError, ConnectionResetError):
            for _ in range(4 * 1024**2 // len(part)):
                client.sendall(part)
        return read_all(client)


def health(port):
    with closing(connect(port)) as client:
        client.sendall(HEALTH + b"Connection: close\r\n\r\n")
        return read_all(client)


def refusal(came, status):
    """Give the words of the refusal that is the last answer on a connection."""
    head, _, body = came.rpartition(b"\r\n\r\n")
    start = head[head.rfind(b"HTTP/1.1 ") :]
    assert start.startswith(b"HTTP/1.1 %d " % status)
    assert b"content-type: application/problem+json" in start
    problem = json.loads(body)
    assert problem["status"] == status
    return problem["detail"]


@pytest.mark.parametrize("begin", [b"GET /", b"GET http://localhost/"])
def test_an_endless_url(port, begin):
    assert f"{LONGEST_URL} bytes" in refusal(endless(port, begin, b"a" * PART), 414)


@pytest.mark.parametrize(
    "part", [b"a" * PART, b"a" * 40_000 + b": 1\r\n", b"a: " + b"b" * 40_000 + b"\r\n"]
)
def test_an_endless_head(port, part):
    assert f"{LONGEST_HEAD} bytes" in refusal(endless(port, HEALTH, part), 431)


def test_endless_header_fields(port):
    detail = refusal(endless(port, HEALTH, b"a: b\r\n"), 431)
    assert f"{MOST_HEADERS} header fields" in detail


@pytest.mark.parametrize("request_head", [LOGIN, READINGS])
@pytest.mark.parametrize("part", [b"a" * PART, b"a: b\r\n", b"a: " + b"b" * 4000 + b"\r\n"])
def test_trailers_are_never_taken(port, request_head, part):
    begin = request_head + CHUNKED + b"1\r\n[\r\n0\r\n"
    assert refusal(endless(port, begin, part), 400).startswith("expected ")


def test_a_trailer_is_no_header_field(port):
    with closing(connect(port)) as client:
        client.sendall(READINGS + CHUNKED + b"1\r\n[\r\n0\r\nSec-Fetch-Site: none\r\nA: b\r\n\r\n")
        assert "header fields behind it" in refusal(read_all(client), 400)


def test_an_endless_chunk_extension(port):
    begin = READINGS + CHUNKED + b"1;"
    assert "extensions" in refusal(endless(port, begin, b"a" * PART), 400)


def test_what_is_no_http(port):
    with closing(connect(port)) as client:
        client.sendall(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n")
        assert "HTTP/1.1" in refusal(read_all(client), 400)


def test_requests_ahead_of_their_answers(port):
    came = endless(port, b"", (HEALTH + b"\r\n") * 1000)
    assert f"{MOST_UNANSWERED} requests" in refusal(came, 429)
    # What came whole has its answer all the same, and nothing more.
    assert came.count(b"HTTP/1.1 200 ") == MOST_UNANSWERED
    assert came.count(b"HTTP/1.1 ") == MOST_UNANSWERED + 1


def test_as_many_ahead_as_are_allowed_again_and_again(port):
    with closing(connect(port)) as client:
        for _ in range(3):
            client.sendall((HEALTH + b"\r\n") * MOST_UNANSWERED)
            came = b""
            while came.count(b'"status":"ok"') < MOST_UNANSWERED:
                came += client.recv(PART)
            assert came.count(b"HTTP/1.1 200 ") == MOST_UNANSWERED


def test_heads_within_the_limits_are_taken(port):
    with closing(connect(port)) as client:
        fields = b"".join(b"x-%d: %s\r\n" % (i, b"v" * 300) for i in range(MOST_HEADERS - 2))
        query = b"a" * (LONGEST_URL - 100)
        client.sendall(b"GET /healthz?%s HTTP/1.1\r\nHost: localhost\r\n" % query)
        client.sendall(fields[: LONGEST_HEAD - 8000].rpartition(b"\r\n")[0] + b"\r\n")
        client.sendall(b"Connection: close\r\n\r\n")
        assert read_all(client).startswith(b"HTTP/1.1 ")


def test_an_offered_upgrade_is_answered_as_plain_http(port, caplog):
    with closing(connect(port)) as client:
        client.sendall(HEALTH + b"Connection: upgrade\r\nUpgrade: h2c\r\n\r\n")
        assert read_all(client).startswith(b"HTTP/1.1 200 ")
    assert not caplog.records


def test_idle_connections_make_room(port):
    with ExitStack() as clients:
        idle = [clients.enter_context(closing(connect(port))) for _ in range(3 * MOST_CONNECTIONS)]
        assert health(port).startswith(b"HTTP/1.1 200 ")
        assert idle[0].recv(1) == b""  # who waited longest was ended


def test_half_bodies_make_room_and_are_told(port):
    head = READINGS + b"Content-Length: 1000\r\n\r\n["
    with ExitStack() as clients:
        half = []
        for _ in range(2 * MOST_CONNECTIONS):
            half.append(clients.enter_context(closing(connect(port))))
            half[-1].sendall(head)
        assert health(port).startswith(b"HTTP/1.1 200 ")
        assert "connections" in refusal(read_all(half[0]), 503)


def test_who_is_served_is_not_ended_for_others(port):
    stream = (
        b"GET /v1/machines/mcfv5050/compensation/stream HTTP/1.1\r\nHost: localhost\r\n"
        b"Accept: text/event-stream\r\n\r\n"
    )
    with ExitStack() as clients:
        followers = [clients.enter_context(closing(connect(port))) for _ in range(MOST_CONNECTIONS)]
        for client in followers:
            client.sendall(stream)
            assert client.recv(PART).startswith(b"HTTP/1.1 200 ")
        came = health(port)
        assert "connections" in refusal(came, 503)
        assert re.search(rb"retry-after: \d", came)
        followers.pop().close()
        for client in followers:
            client.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    assert client.recv(PART) != b""


@pytest.mark.slow
def test_all_bodies_together(port):
    share = MOST_BODY_BYTES // 2
    length = MOST_BODY_BYTES // 4
    head = READINGS + b"Content-Length: %d\r\n\r\n" % length
    with ExitStack() as clients:
        half = [clients.enter_context(closing(connect(port))) for _ in range(4)]
        with suppress(BrokenPipeError, ConnectionResetError):
            for client in half:
                client.sendall(head + b" " * (length - 1))
        refused = [client for client in half if is_answered(client)]
        assert 0 < len(refused) < len(half)
        came = read_all(refused[0])
        assert f"{2 * share} bytes" in refusal(came, 503)
        assert re.search(rb"retry-after: \d", came)
    # Who went away holds nothing.
    with closing(connect(port)) as client:
        client.sendall(head + b" " * length)
        assert client.recv(PART).startswith(b"HTTP/1.1 422 ")


def is_answered(client):
    client.settimeout(2)
    try:
        return bool(client.recv(1, socket.MSG_PEEK))
    except TimeoutError:
        return False


def test_refusals_are_counted_and_logged_once_in_a_while(port, caplog):
    with caplog.at_level(logging.WARNING):
        for _ in range(5):
            endless(port, b"PUT /", b"a" * PART)
    lines = [r.getMessage() for r in caplog.records if "414" in r.getMessage()]
    assert len(lines) <= 1  # none where another test's was a moment ago
    with closing(connect(port)) as client:
        client.sendall(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
        counted = re.search(rb'thermap_requests_total\{[^}]*status="414"\} (\d+)', read_all(client))
    assert int(counted[1]) >= 5


def test_a_sender_who_goes_away_is_no_error(port, caplog):
    for head in (LOGIN, READINGS):
        with closing(connect(port)) as client:
            client.sendall(head + b"Content-Length: 100\r\n\r\nkey=")
    assert health(port).startswith(b"HTTP/1.1 200 ")
    assert [r.getMessage() for r in caplog.records if r.levelname == "ERROR"] == []


class Sent:
    """A connection of which the body goes on and on, at a good rate."""

    def __init__(self):
        self.refused = []

    def is_closing(self):
        return False


def test_a_body_ends_some_time_however_well_it_goes_on():
    connection = PatientProtocol.__new__(PatientProtocol)
    connection.transport = Sent()
    connection.flow = type("Flow", (), {"read_paused": False})
    connection.refusal = connection.ended_at = None
    connection.is_receiving = connection.has_headers = True
    connection.began = 0.0
    connection.refuse = connection.transport.refused.append
    for second in range(LONGEST_BODY_S + 2):
        connection.last_came = float(second)
        connection.came_bytes = 10_000 * second
        connection.end_if_stopped(float(second), 10.0)
        assert bool(connection.transport.refused) is (second > LONGEST_BODY_S)
    assert f"{LONGEST_BODY_S} s" in connection.transport.refused[0].detail


class Sender:
    """A connection with so much of a body, whole or not."""

    def __init__(self, holder, body_bytes, is_receiving=True):
        self.holder, self.body_bytes, self.is_receiving = holder, body_bytes, is_receiving
        self.refused = []
        self.refuse = self.refused.append


@pytest.mark.parametrize(
    ("senders", "latest", "refused"),
    [
        # One sender alone has half, and its largest unfinished body gives way.
        ([("a", 60), ("a", 50)], 1, 0),
        ([("a", 60, False), ("a", 50)], 1, 1),
        ([("a", 60), ("b", 50)], 1, None),
        # Of several who have too much together it is the one with most, whoever came last.
        ([("a", 60), ("a", 50), ("b", 100)], 2, 0),
        ([("a", 90), ("b", 80), ("c", 50)], 2, 0),
        ([("a", 30), ("b", 20)], 1, None),
    ],
)
def test_who_has_most_of_all_bodies_gives_way(monkeypatch, senders, latest, refused):
    monkeypatch.setattr("app.cli.http_protocol._ours", lambda connections: connections)
    made = [Sender(*stated) for stated in senders]
    limits = SharedLimits(lambda _status: None, most_body_bytes=200)
    limits.body_bytes = sum(one.body_bytes for one in made)
    limits.refuse_bodies(made[latest], made)
    assert [i for i, one in enumerate(made) if one.refused] == (
        [] if refused is None else [refused]
    )
