"""What goes wrong on purpose: ends, pauses, locks, half-sent and bad requests, slow readers."""

from __future__ import annotations

import json
import random
import signal
import socket
import sqlite3
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from urllib.parse import urlsplit

import psycopg
from sqlalchemy import make_url

from tests.faults.service import Service
from tests.faults.soak.asking import PATIENCE_S, Shop

EVERY_S = 6.0
BAD = (
    ("POST", "/compensation", b"{"),
    ("POST", "/compensation", b'{"temperatures_c": {"x-middle": NaN}}'),
    ("POST", "/compensation", b'{"temperatures_c": {"nobody": 20}}'),
    ("POST", "/compensation", b'{"temperatures_c": {"x-middle": 295.15}}'),
    ("POST", "/compensation", b'{"temperatures_c": {"x-middle": "warm"}}'),
    ("POST", "/readings", b'{"time": "yesterday", "temperatures_c": {"x-middle": 20}}'),
    ("POST", "/readings", b'{"time": "2199-01-01T00:00:00Z", "temperatures_c": {"x-middle": 20}}'),
    (
        "POST",
        "/readings",
        b'{"time": "2026-01-01T00:00:00Z", "temperatures_c": {"x-middle": 1e999}}',
    ),
    ("POST", "/readings", b"[" * 5000),
    ("POST", "/error-maps", b'{"label": "bad", "components": []}'),
    ("POST", "/error-maps", b"\xff\xfe\x00"),
    ("POST", "/models/999999/activate", b""),
    ("PUT", "/sensor-assignment", b'{"EXX": "nobody"}'),
    ("POST", "/verifications", b'{"label": "bad", "observations": [{"component": "EXX"}]}'),
)
HELD_S = 5.0


class Trouble(threading.Thread):
    """Makes one fault after the other; `service` is the one that runs now."""

    def __init__(
        self, shop: Shop, database_url: str, log: Path, rooms: list[str], seed: int
    ) -> None:
        super().__init__(name="trouble", daemon=True)
        self._shop, self._url, self._log, self._rooms = shop, database_url, log, rooms
        self._chance = random.Random(seed)
        self.service = Service(database_url, log=log, THERMAP_LOCK_LIMIT_S="5")
        self.may_end = True
        self.pause = threading.Lock()
        shop.url = self.service.url

    def run(self) -> None:
        gentle: list[Callable[[], None]] = [
            self._stand_still,
            self._lock_database,
            self._send_half,
            self._read_slowly,
            self._open_and_drop,
            self._send_bad,
            self._send_bad,
        ]
        while not self._shop.ended.wait(self._chance.uniform(0.3, 1.7) * EVERY_S):
            with self.pause:
                try:
                    if self.may_end and self._chance.random() < 0.15:
                        self.end(self._chance.choice((signal.SIGKILL, signal.SIGTERM)))
                    else:
                        self._chance.choice(gentle)()
                except Exception as error:
                    self._shop.tally.find(f"trouble failed: {type(error).__name__}: {error}")

    def end(self, number: signal.Signals) -> None:
        """End the service and start it again, at another port."""
        code = self.service.end(number)
        self._shop.tally.fault(f"service ended by {number.name}")
        if number is signal.SIGTERM and code != 0:
            self._shop.tally.find(f"exit code {code} after SIGTERM, expected 0")
        self.service = Service(self._url, log=self._log, THERMAP_LOCK_LIMIT_S="5")
        self._shop.url = self.service.url

    def _stand_still(self) -> None:
        """Let the whole process stand still, as when its disk does not answer."""
        self._shop.tally.fault("service stood still (SIGSTOP)")
        self.service.send(signal.SIGSTOP)
        try:
            time.sleep(self._chance.uniform(0.5, 4.0))
        finally:
            self.service.send(signal.SIGCONT)

    def _lock_database(self) -> None:
        """Hold what writers need for longer than some of them wait."""
        for_s = self._chance.uniform(0.5, 8.0)
        self._shop.tally.fault("database locked by another")
        url = make_url(self._url)
        if url.get_backend_name() == "sqlite":
            with closing(sqlite3.connect(str(url.database), timeout=30.0)) as connection:
                connection.execute("BEGIN IMMEDIATE")
                time.sleep(for_s)
                connection.rollback()
        else:
            plain = url.set(drivername="postgresql").render_as_string(hide_password=False)
            with psycopg.connect(plain) as connection:
                connection.execute("LOCK TABLE machine IN SHARE ROW EXCLUSIVE MODE")
                time.sleep(for_s)
                connection.rollback()

    def _room(self) -> str:
        return self._chance.choice(self._rooms)

    def _connect(self) -> socket.socket:
        place = urlsplit(self._shop.url)
        return socket.create_connection((place.hostname, place.port), timeout=PATIENCE_S)

    def _send_half(self) -> None:
        """Begin requests, stop half-way, wait a little, and go."""
        opened = [self._connect() for _ in range(self._chance.randint(1, 10))]
        self._shop.tally.fault("half-sent body", len(opened))
        for one in opened:
            head = f"POST {self._room()}/readings HTTP/1.1\r\nHost: localhost\r\n"
            one.sendall(f'{head}Content-Length: 5000\r\n\r\n[{{"time": '.encode())
        self._shop.ended.wait(self._chance.uniform(0.0, HELD_S))
        for one in opened:
            one.close()

    def _read_slowly(self) -> None:
        """Ask for much, and read nothing of it."""
        opened = [self._connect() for _ in range(self._chance.randint(1, 5))]
        self._shop.tally.fault("slow reader", len(opened))
        for one in opened:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            path = self._chance.choice(
                ("/error-maps", "/readings?limit=100000", "/compensation/stream", "/models")
            )
            for _ in range(5):
                one.sendall(
                    f"GET {self._room()}{path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
                )
        self._shop.ended.wait(HELD_S)
        for one in opened:
            one.close()

    def _open_and_drop(self) -> None:
        opened = [self._connect() for _ in range(self._chance.randint(5, 30))]
        self._shop.tally.fault("stream opened and dropped", len(opened))
        for one in opened:
            path = self._chance.choice(("/v1/stream", f"{self._room()}/compensation/stream"))
            one.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
        self._shop.ended.wait(self._chance.uniform(0.0, HELD_S))
        for one in opened:
            with suppress(OSError):
                one.recv(1000)
            one.close()

    def _send_bad(self) -> None:
        """Send what must be refused: with 4xx, and with a problem that can be read."""
        for method, path, body in self._chance.sample(BAD, 4):
            self._shop.tally.fault("bad body")
            head = (
                f"{method} {self._room()}{path} HTTP/1.1\r\nHost: localhost\r\n"
                f"Content-Type: application/json\r\nConnection: close\r\n"
                f"Content-Length: {len(body)}\r\n\r\n"
            )
            with self._connect() as one:
                one.sendall(head.encode() + body)
                answer = b""
                while more := one.recv(65536):
                    answer += more
            status = int(answer.split(b" ", 2)[1]) if answer else 0
            content = answer.partition(b"\r\n\r\n")[2]
            if not (400 <= status < 500 and "detail" in json.loads(content)) and status != 503:
                words = answer[:300].decode(errors="replace")
                self._shop.tally.find(f"{method} {path} {body[:60]!r}: expected 4xx, got {words}")
