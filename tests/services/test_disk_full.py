"""A database without room: it is said, nothing is there by half, and what comes after is stored."""

import asyncio
from datetime import timedelta

import pytest
from sqlalchemy import event

from app.storage.database import _has_no_room
from tests.service_examples import (
    ROOM,
    START,
    client_of,
    contents,
    error_map,
    furnish_database,
    problem,
    reading,
)

pytestmark = pytest.mark.anyio

TABLE = {"temperatures_c": {"x-middle": 25.0, "y-front": 24.0, "z-column": 27.0, "spindle": 30.0}}
LONG = [float(i) for i in range(500)]


class SmallDisk:
    """A limit on a SQLite file's pages, on every connection of a service, as a full disk is one."""

    def __init__(self, service):
        self._engine = service.state.context.database.engine
        self._most = None
        event.listen(self._engine, "begin", self._limit)

    def _limit(self, connection):
        driver = connection.connection.driver_connection
        driver.execute(f"PRAGMA max_page_count = {self._most or 2**30}")

    def fill(self):
        """Leave no room for another page."""
        self._most = 1  # SQLite takes the pages that there are

    def make_room(self):
        self._most = None


def long_map(label, t_c):
    components = [
        {"component": code, "positions_mm": LONG, "errors_um": [t_c] * len(LONG)}
        for code in ("EXX", "EYX", "EZX")
    ]
    return error_map(label, t_c, components=components)


def many_readings():
    first = START - timedelta(days=1)
    return [reading(first + timedelta(seconds=s), 25.0) for s in range(2000)]


@pytest.fixture
def service(new_app, databases):
    url = databases.prepared("sqlite", furnish_database)
    yield new_app(url)
    databases.give_back(url)


async def test_what_finds_no_room_is_507_and_there_is_nothing_of_it(service):
    disk = SmallDisk(service)
    async with client_of(service) as client:
        before = await asyncio.to_thread(contents, service)
        table = (await client.post(f"{ROOM}/compensation", json=TABLE)).json()["components"]
        disk.fill()
        requests = {
            "error-maps": long_map("Run #9", 33.0),
            "readings": many_readings(),
        }
        for path, content in requests.items():
            answer = await client.post(f"{ROOM}/{path}", json=content)
            refused = problem(answer, 507)
            assert refused["title"] == "The disk is full"
            assert "nothing was stored" in refused["detail"]
            assert "make room" in refused["detail"]
            assert answer.headers["Retry-After"] == "5"
        assert await asyncio.to_thread(contents, service) == before
        # What is there can be read, and compensates.
        assert (await client.get(f"{ROOM}/error-maps")).status_code == 200
        again = await client.post(f"{ROOM}/compensation", json=TABLE)
        assert again.json()["components"] == table
        disk.make_room()
        for path, content in requests.items():
            answer = await client.post(f"{ROOM}/{path}", json=content)
            assert answer.status_code == 201, answer.text
        listed = (await client.get(f"{ROOM}/error-maps")).json()
        assert listed[-1]["label"] == "Run #9"
        assert len((await client.get(f"{ROOM}/readings?limit=10000")).json()) == len(
            requests["readings"]
        )


def test_other_troubles_are_no_full_disk():
    class Away(Exception):
        sqlstate = "08006"

    class Full(Exception):
        sqlstate = "53100"

    assert _has_no_room(Full(), "could not extend file")
    assert not _has_no_room(Away(), "server closed the connection unexpectedly")
    assert not _has_no_room(OSError(), "disk I/O error")
