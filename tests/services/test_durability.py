"""What was answered with 201 is there after the process was killed; nothing is there by half."""

import os
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from sqlalchemy import make_url

from tests.service_examples import MACHINE, ROOM, START, error_map, iso, reading

PACKAGE_FOLDER = Path(__file__).parents[2]
BATCH = 40
LONG = list(range(400))


class Server:
    """The service in a process of its own, on a socket that is open before it is."""

    def __init__(self, url):
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self._socket.listen(100)
        self.url = f"http://127.0.0.1:{self._socket.getsockname()[1]}"
        descriptor = self._socket.fileno()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "uvicorn", "--factory", "app.main:create_app"),
                *("--fd", str(descriptor), "--log-level", "warning"),
            ],
            pass_fds=[descriptor],
            cwd=PACKAGE_FOLDER,
            env=os.environ | {"THERMAP_DATABASE_URL": url, "THERMAP_LOCK_LIMIT_S": "60"},
        )

    @property
    def pid(self):
        return self._process.pid

    def kill(self):
        """Kill it without a warning."""
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()
        self._socket.close()


def big_map(label, t_c):
    """A map whose rows take a while to be written."""
    components = [
        {"component": code, "positions_mm": LONG, "errors_um": [t_c] * len(LONG)}
        for code in ("EXX", "EYX", "EZX", "EXY", "EYY", "EZY", "EXZ", "EYZ", "EZZ")
    ]
    return error_map(label, t_c, components=components)


class Writers:
    """Clients that store without pause, and remember what was answered and what was sent."""

    def __init__(self, url, round_number):
        self._url = url
        self._round = round_number
        self.answered_maps = []
        self.answered_batches = []
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, args=(step,))
            for step in (self._store_map, self._store_batch, self._store_batch)
        ]
        self._numbers = iter(range(10**6))
        self._lock = threading.Lock()

    def run_until(self, maps, batches):
        """Write until so many have been answered, then return in the middle of it."""
        for thread in self._threads:
            thread.start()
        deadline = time.monotonic() + 60
        while len(self.answered_maps) < maps or len(self.answered_batches) < batches:
            assert time.monotonic() < deadline, "the server does not answer"
            time.sleep(0.001)

    def join(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _run(self, step):
        with httpx.Client(base_url=self._url, timeout=60, trust_env=False) as client:
            while not self._stop.is_set():
                with self._lock:
                    number = next(self._numbers)
                try:
                    step(client, number)
                except httpx.TransportError:
                    return

    def _store_map(self, client, number):
        label = f"{self._round}/{number}"
        content = big_map(label, 20.0 + 25.0 * self._round + 0.11 * len(self.answered_maps))
        answer = client.post(f"{ROOM}/error-maps", json=content)
        assert answer.status_code == 201, answer.text
        self.answered_maps.append((label, content))

    def _store_batch(self, client, number):
        first = START - timedelta(days=number, hours=self._round)
        batch = [reading(first + timedelta(seconds=s), 20.0 + number % 7) for s in range(BATCH)]
        answer = client.post(f"{ROOM}/readings", json=batch)
        assert answer.status_code == 201, answer.text
        self.answered_batches.append(batch)


@pytest.fixture
def kill_at_the_end():
    servers = []
    yield servers.append
    for server in servers:
        server.kill()


@pytest.mark.slow
def test_what_was_answered_survives_kill_9_and_nothing_is_half_stored(sqlite_url, kill_at_the_end):
    maps, batches = [], []
    for round_number in range(2):
        server = Server(sqlite_url)
        kill_at_the_end(server)
        with httpx.Client(base_url=server.url, timeout=60, trust_env=False) as client:
            client.post("/v1/machines", json=MACHINE).raise_for_status() if not maps else None
        writers = Writers(server.url, round_number)
        writers.run_until(maps=4, batches=12)
        server.kill()
        writers.join()
        maps += writers.answered_maps
        batches += writers.answered_batches

    _check_file(make_url(sqlite_url).database)
    server = Server(sqlite_url)
    kill_at_the_end(server)
    with httpx.Client(base_url=server.url, timeout=60, trust_env=False) as client:
        _check_maps(client, maps)
        _check_readings(client, batches)


def _check_file(path):
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []
    connection.close()


def _check_maps(client, answered):
    stored = {m["label"]: m for m in client.get(f"{ROOM}/error-maps").json()}
    for label, content in answered:
        kept = stored[label]["components"]
        assert [(c["component"], c["errors_um"]) for c in kept] == [
            (c["component"], c["errors_um"]) for c in content["components"]
        ]
    assert all(len(m["components"]) == 9 for m in stored.values())
    versions = client.get(f"{ROOM}/models").json()
    assert [len(v["maps"]) for v in versions] == list(range(1, len(stored) + 1))
    assert versions[-1]["active"]


def _check_readings(client, answered):
    listed = client.get(f"{ROOM}/readings", params={"limit": 100_000}).json()
    stored = {r["time"]: r["temperatures_c"] for r in listed}
    for batch in answered:
        for sent in batch:
            assert stored[sent["time"]] == sent["temperatures_c"]
    assert len(stored) % BATCH == 0, "half a batch is stored"
    assert iso(START) not in stored or len(stored) >= BATCH
