"""Hostile HTTP against a service of its own: it refuses, says why, and goes on with its tables."""

import json
import random
import re
import socket
import subprocess
import sys
import time
from contextlib import closing, suppress
from pathlib import Path

import pytest

from tests.service_examples import furnish_database

SEED = 28
QUIET_S = 0.05
MOST_MORE_BYTES = 300 * 2**20
ROOM = b"/v1/machines/mcfv5050"
BODY = json.dumps({"temperatures_c": {"x-middle": 21.0, "z-column": 23.0}}).encode()
PATHS = [
    *(b"/", b"/login", b"/healthz", b"/metrics", b"/docs", b"/v1/events", b"/v1/machines", ROOM),
    *(ROOM + b"/" + name for name in (b"readings", b"compensation", b"predictions", b"error-maps")),
    *(ROOM + b"/" + name for name in (b"files", b"verifications", b"models/1")),
]
METHODS = [b"GET", b"POST", b"PUT", b"PATCH", b"DELETE", b"HEAD", b"OPTIONS", b"CONNECT", b"G\x00T"]
FIELDS = [
    *(b"Host", b"Content-Type", b"Content-Length", b"Transfer-Encoding", b"Connection"),
    *(b"Upgrade", b"Expect", b"Authorization", b"Cookie", b"If-None-Match", b"Last-Event-ID"),
    *(b"Accept", b"Origin", b"X-Request-ID", b"X-Forwarded-For", b"User-Agent", b"a b", b""),
]
VALUES = [
    *(b"", b"application/json", b"text/csv", b"chunked", b"close", b"upgrade", b"100-continue"),
    *(b"0", b"-1", b"5", b"99999999999999999999", b"18446744073709551617", b"1e3", b"\xff\xfe"),
    *(b"localhost", b"evil.example", b"Bearer x", b"h2c", b"*/*;q=", b"9" * 30, b"\x00", b"[["),
]
QUERIES = [b"", b"?", b"?before=9223372036854775808", b"?limit=%00", b"?from=0001-01-01T00:00Z"]
QUERIES += [b"?a" * 500, b"?%ff=%fe", b"?name=" + b"x" * 300, b"?kind=&kind=\xe4"]
TEXTS = [b"{}", b"[]", b"null", b"[" * 300, b'{"a":' * 300, b"1" * 5000, b'"\\ud800"', BODY]
TEXTS += [b'{"observations":[{"state":{"a":1e999}}]}', b"\xff\xfe", b"key=" + b"k" * 5000]


@pytest.fixture(scope="module")
def service(tmp_path_factory, databases):
    """A service in a process of its own: the port, the process, and its log."""
    url = databases.prepared("sqlite", furnish_database)
    log = tmp_path_factory.mktemp("hostile") / "log"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "app", "serve", "--port", str(port), "--database-url", url]
    with log.open("w") as file:
        process = subprocess.Popen(command, stdout=file, stderr=file)
    try:
        for _ in range(1200):
            assert process.poll() is None, log.read_text()
            with suppress(OSError):
                connect(port).close()
                break
            time.sleep(0.1)
        assert table(port)
        yield port, process, log
    finally:
        process.terminate()
        process.wait(60)
    databases.give_back(url)


def connect(port):
    return socket.create_connection(("127.0.0.1", port), timeout=60)


def exchange(port, sent):
    """Send bytes and no more; what is answered until nothing comes for a while."""
    came = b""
    with closing(connect(port)) as client, suppress(ConnectionError, TimeoutError):
        client.sendall(sent)
        client.settimeout(QUIET_S)
        while piece := client.recv(65536):
            came += piece
    return came


def table(port):
    """Ask for the live table; whether it came."""
    head = b"POST %s/compensation HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    sent = (head % ROOM) + b"Content-Length: %d\r\nConnection: close\r\n\r\n" % len(BODY) + BODY
    with closing(connect(port)) as client:
        client.sendall(sent)
        return client.recv(65536).startswith(b"HTTP/1.1 200 ")


def resident_bytes(process):
    status = Path(f"/proc/{process.pid}/status")
    if not status.exists():
        return 0
    return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status.read_text())[1])


def fields_of(chance, counts):
    return [
        chance.choice(FIELDS) + b": " + chance.choice(VALUES) for _ in range(chance.choice(counts))
    ]


def head_of(chance, fields=()):
    line = b"%s %s%s HTTP/1.%d\r\n" % (
        chance.choice(METHODS),
        chance.choice(PATHS) + bytes(chance.choices(range(256), k=chance.choice([0, 0, 0, 5]))),
        chance.choice(QUERIES),
        chance.choice([0, 1, 1, 1, 1, 9]),
    )
    stated = [b"Host: localhost", *fields]
    stated += fields_of(chance, [0, 1, 2, 5, 150])
    if chance.random() < 0.1:
        stated.append(b"a: " + b"b" * chance.choice([5000, 40_000, 100_000]))
    chance.shuffle(stated)
    return line + b"\r\n".join(stated) + b"\r\n\r\n"


def with_length(chance):
    text = chance.choice(TEXTS)
    length = len(text) + chance.choice([0, 0, 0, 1, -1])
    kind = chance.choice([b"application/json", b"text/csv", b"application/x-www-form-urlencoded"])
    fields = [b"Content-Type: " + kind, b"Content-Length: %d" % length]
    return head_of(chance, fields) + text


def chunked(chance):
    """A body in chunks, of which some are none, with or without trailers."""
    parts = [head_of(chance, [b"Content-Type: application/json", b"Transfer-Encoding: chunked"])]
    for _ in range(chance.choice([0, 1, 3, 500])):
        text = chance.choice(TEXTS)[: chance.choice([1, 20, 5000])]
        size = chance.choice([b"%x"] * 8 + [b"-%x", b"%x0", b"%xffffffffffffffff"]) % len(text)
        extension = chance.choice([b""] * 8 + [b";a=b", b";" + b"a" * 100_000, b"\x00"])
        parts.append(size + extension + b"\r\n" + text + chance.choice([b"\r\n"] * 9 + [b"\n"]))
    parts.append(chance.choice([b"0\r\n", b"0\r\n", b"", b"00000000000000000000\r\n"]))
    parts += [field + b"\r\n" for field in fields_of(chance, [0, 0, 1, 200])]
    return b"".join([*parts, b"\r\n"])


def pipelined(chance):
    return b"".join(
        chance.choice([with_length, chunked, head_of, head_of])(chance)
        for _ in range(chance.choice([2, 5, 40]))
    )


def noise(chance):
    """What one of the others has, with some bytes changed, or cut off."""
    sent = bytearray(chance.choice([with_length, chunked, pipelined])(chance))
    for _ in range(chance.choice([1, 3, 30])):
        sent[chance.randrange(len(sent))] = chance.randrange(256)
    return bytes(sent[: chance.choice([len(sent), chance.randrange(len(sent))])])


@pytest.mark.slow
@pytest.mark.parametrize("kind", [head_of, with_length, chunked, pipelined, noise])
def test_what_comes_is_answered_or_refused_and_tables_go_on(service, kind, hostile_inputs):
    port, process, log = service
    chance = random.Random(SEED)
    before = resident_bytes(process)
    logged = log.stat().st_size
    for i in range(hostile_inputs):
        sent = kind(chance)
        statuses = {int(s) for s in re.findall(rb"HTTP/1\.1 (\d{3}) ", exchange(port, sent))}
        assert not {s for s in statuses if s >= 500 and s != 503}, (i, sent[:2000], statuses)
        if i % 50 == 0:
            assert table(port)
    assert table(port)
    assert resident_bytes(process) - before < MOST_MORE_BYTES
    with log.open() as file:
        file.seek(logged)
        lines = file.read()
    assert "Traceback" not in lines, lines[:5000]
    assert len(lines.splitlines()) < 50  # a flood of refusals is no flood of lines
