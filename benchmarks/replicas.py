"""How soon a replica answers as the one to which something was sent.

Two `thermap serve` on one PostgreSQL. To one of them readings are sent, an older model version is
activated, a key is made and revoked; the other is asked every millisecond until its answer shows
it. The time runs from the answer to what was sent, which comes after the commit. Once with nothing
else to do, and once while to each of both readings of a hundred other machines are sent.

    python -m benchmarks.replicas [--server postgresql://postgres@127.0.0.1:5432/postgres]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from uuid import uuid4

import httpx
import numpy as np
import psycopg
from sqlalchemy import make_url

from app.access.keys import Role
from app.services.access_keys import create_key, revoke_key
from app.storage.database import Database
from benchmarks.example import TEMPERATURES_C, prepare_database
from benchmarks.http_table import free_port

ROOM = "/v1/machines/mcfv5050"
OTHERS = 100
PATIENCE_S = 30.0
CLIENTS = 4
PAUSE_S = 0.02
ASKED_EVERY_S = 0.001
STARTS_WITHIN_S = 240.0


@contextmanager
def scratch_database(server: str) -> Iterator[str]:
    """Make a database on a server, and drop it after."""
    url = make_url(server)
    name = f"thermap_benchmark_{uuid4().hex[:12]}"
    plain = url.set(drivername="postgresql").render_as_string(hide_password=False)
    with psycopg.connect(plain, autocommit=True) as connection:
        connection.execute(f'CREATE DATABASE "{name}"')
        try:
            yield url.set(database=name).render_as_string(hide_password=False)
        finally:
            connection.execute(f'DROP DATABASE "{name}" WITH (FORCE)')


@contextmanager
def service(url: str, *options: str) -> Iterator[str]:
    """Run `thermap serve`, and wait until all machines are in its memory."""
    port = free_port()
    command = [sys.executable, "-m", "app", "serve", "--port", str(port), *options]
    process = subprocess.Popen(
        [*command, "--database-url", url], stdout=subprocess.DEVNULL, env=os.environ
    )
    base = f"http://127.0.0.1:{port}"
    try:
        _wait_until_ready(base)
        yield base
    finally:
        process.terminate()
        process.wait()


def _wait_until_ready(base: str) -> None:
    end = time.monotonic() + STARTS_WITHIN_S
    while time.monotonic() < end:
        try:
            if httpx.get(f"{base}/readyz").status_code == httpx.codes.OK:
                return
        except httpx.TransportError:
            time.sleep(0.05)
    raise RuntimeError(f"{base} was not ready within {STARTS_WITHIN_S:g} s")


def seen_after(is_there: Callable[[], bool]) -> float:
    """Ask again and again until something is there; say how long it took [s]."""
    began = time.perf_counter()
    while not is_there():
        time.sleep(ASKED_EVERY_S)
        if time.perf_counter() - began > PATIENCE_S:
            raise RuntimeError("it never came")
    return time.perf_counter() - began


def of_readings(here: httpx.Client, there: httpx.Client, count: int) -> list[float]:
    """Send readings."""
    waits = []
    for _ in range(count):
        at = datetime.now(UTC).isoformat().replace("+00:00", "Z")
        sent = here.post(f"{ROOM}/readings", json={"time": at, "temperatures_c": TEMPERATURES_C})
        sent.raise_for_status()
        shown = f'"reading_time":"{at}"'.encode()
        waits.append(seen_after(lambda s=shown: s in there.get(f"{ROOM}/compensation").content))
        time.sleep(PAUSE_S)
    return waits


def of_asking(here: httpx.Client, count: int) -> list[float]:
    """Ask for what is there already: what this machine adds to each of the others."""
    waits = []
    for _ in range(count):
        waits.append(seen_after(lambda: bool(here.get(f"{ROOM}/compensation").content)))
        time.sleep(PAUSE_S)
    return waits


def of_versions(here: httpx.Client, there: httpx.Client, count: int) -> list[float]:
    """Activate versions in turn."""
    waits = []
    stated = {"temperatures_c": TEMPERATURES_C}
    for i in range(count):
        wanted = 2 + i % 2
        here.post(f"{ROOM}/models/{wanted}/activate").raise_for_status()

        def is_active(wanted: int = wanted) -> bool:
            return there.post(f"{ROOM}/compensation", json=stated).json()["model_version"] == wanted

        waits.append(seen_after(is_active))
        time.sleep(PAUSE_S)
    return waits


def of_revoked(database: Database, keyed: httpx.Client, count: int) -> list[float]:
    """Revoke keys that a service knows."""
    waits = []
    for i in range(count):
        secret = create_key(database, f"key-{i}", Role.VIEWER).secret
        asks = {"Authorization": f"Bearer {secret}"}

        def is_open(asks: dict[str, str] = asks) -> bool:
            return keyed.get("/v1/machines", headers=asks).status_code == httpx.codes.OK

        seen_after(is_open)
        revoke_key(database, f"key-{i}")
        waits.append(seen_after(lambda is_open=is_open: not is_open()))
        time.sleep(PAUSE_S)
    return waits


@contextmanager
def others_at_work(bases: list[str]) -> Iterator[list[int]]:
    """Send readings of other machines to all services for as long as the block lasts."""
    ends = threading.Event()
    sent: list[int] = []

    def send(base: str, first: int) -> None:
        with httpx.Client(base_url=base, timeout=PATIENCE_S) as client:
            number = first
            while not ends.is_set():
                at = datetime.now(UTC).isoformat()
                body = {"time": at, "temperatures_c": {"a": 20.0 + number % 7}}
                client.post(f"/v1/machines/other-{number % OTHERS}/readings", json=body)
                sent.append(number)
                number += CLIENTS
                time.sleep(PAUSE_S)

    threads = [
        threading.Thread(target=send, args=(base, i)) for base in bases for i in range(CLIENTS // 2)
    ]
    for thread in threads:
        thread.start()
    try:
        yield sent
    finally:
        ends.set()
        for thread in threads:
            thread.join()


def told(what: str, waits: list[float]) -> str:
    """Say a series in a line of the table."""
    ms = 1e3 * np.array(waits)
    return (
        f"| {what} | {len(waits)} | {np.median(ms):.1f} ms | {np.quantile(ms, 0.99):.1f} ms "
        f"| {ms.max():.1f} ms |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", default="postgresql://postgres@127.0.0.1:5432/postgres")
    parser.add_argument("--count", type=int, default=500, help="readings of each series")
    stated = parser.parse_args()
    with ExitStack() as stack:
        url = stack.enter_context(scratch_database(stated.server))
        prepare_database(url)
        database = Database(url)
        stack.callback(database.close)
        bases = [stack.enter_context(service(url)) for _ in range(2)]
        here, there = (
            stack.enter_context(httpx.Client(base_url=base, timeout=PATIENCE_S)) for base in bases
        )
        for i in range(OTHERS):
            machine = {"id": f"other-{i}", "name": "Other", "sensors": [{"name": "a"}]}
            machine |= {"configuration": "XYFZ", "axes": {"x": {"min_mm": 0, "max_mm": 500}}}
            here.post("/v1/machines", json=machine).raise_for_status()
        print("| | times | median | 99 % | longest |\n| --- | --- | --- | --- | --- |")
        print(told("a reading", of_readings(here, there, stated.count)))
        print(told("a table that is there already", of_asking(there, stated.count)))
        print(told("another model version", of_versions(here, there, stated.count // 5)))
        keyed_base = stack.enter_context(service(url, "--require-keys"))
        keyed = stack.enter_context(httpx.Client(base_url=keyed_base, timeout=PATIENCE_S))
        print(told("a key that is revoked", of_revoked(database, keyed, stated.count // 5)))
        with others_at_work(bases) as sent:
            began = time.perf_counter()
            waits = of_readings(here, there, stated.count)
            rate = len(sent) / (time.perf_counter() - began)
        print(told(f"a reading, beside {rate:.0f} a second of other machines", waits))


if __name__ == "__main__":
    main()
