"""Workers as processes of their own: killed, told to end, several at a time."""

import asyncio
import signal
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from anyio import to_thread
from sqlalchemy import select

from app.storage.database import Database
from app.storage.records import AnalysisStatus
from app.storage.tables import AnalysisRow
from tests.campaign_examples import LATER, ROOM, campaign_database
from tests.databases import reachable
from tests.faults.service import Worker
from tests.service_examples import Clock, client_of, running

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.slow,
    pytest.mark.skipif(
        not Path("/proc/self/task").exists(), reason="needs Linux' list of processes"
    ),
]

PATH = f"{ROOM}/analyses"
BODY = {"verifications": list(range(1, 9)), "effects": ["backlash"]}
DEADLINE_S = 240.0
"""On a machine that does much else a process alone takes tens of seconds to begin."""


@pytest.fixture
def url(request, databases):
    kind = getattr(request, "param", "postgresql")
    made = reachable(lambda kind: databases.prepared(kind, campaign_database), kind)
    yield made
    databases.give_back(made)


@pytest.fixture
def database(url):
    opened = Database(url)
    yield opened
    opened.close()


@pytest.fixture
async def client(url):
    """A service that leaves analyses to workers."""
    with running(url, Clock(LATER), analyses=False) as service:
        async with client_of(service) as client:
            yield client


@contextmanager
def worker(url, *options):
    """A worker in a process of its own, killed at the end where it still runs."""
    process = Worker(url, "--log-level", "warning", *options)
    try:
        yield process
    finally:
        process.end()


async def until(question):
    deadline = time.monotonic() + DEADLINE_S
    while not (found := question()):
        assert time.monotonic() < deadline
        await asyncio.sleep(0.05)
    return found


def statuses(database):
    """Each analysis' status, in their order; of a machine never more than one that runs."""
    with database.reading() as session:
        found = session.scalars(select(AnalysisRow.status).order_by(AnalysisRow.id)).all()
    assert found.count(AnalysisStatus.RUNNING) <= 1
    return list(found)


async def ask(client, times):
    for _ in range(times):
        answer = await client.post(PATH, json=BODY)
        assert answer.status_code == 202, answer.text


@pytest.mark.parametrize("url", ["sqlite"], indirect=True)
async def test_what_a_killed_worker_ran_another_one_takes_up(url, database, client):
    with worker(url) as first, worker(url) as second:
        await ask(client, 2)

        def who_works():
            statuses(database)
            return next((one for one in (first, second) if one.analyses()), None)

        victim = await until(who_works)
        victim.end(signal.SIGKILL)
        await until(lambda: statuses(database) == ["done"] * 2)
    with database.reading() as session:
        tries = session.scalars(select(AnalysisRow.tries).order_by(AnalysisRow.id)).all()
    assert sorted(tries) == [1, 2]


async def test_a_worker_that_is_told_to_end_gives_back_what_it_runs_or_finishes_it(
    url, database, client
):
    await ask(client, 2)
    with worker(url, "--finish-s", "0") as told:
        await until(lambda: told.analyses())
        assert await to_thread.run_sync(told.end, signal.SIGTERM) == 0
        with database.reading() as session:
            row = session.get(AnalysisRow, 1)
            assert (row.status, row.tries, row.owner) == ("queued", 0, None)
    with worker(url, "--finish-s", "600") as told:
        await until(lambda: told.analyses())
        await to_thread.run_sync(told.end, signal.SIGTERM)
    assert statuses(database) == ["done", "queued"]


async def test_cancelling_reaches_a_worker(url, database, client):
    await ask(client, 2)
    with worker(url) as one:
        before = await until(lambda: one.analyses())
        answer = await client.post(f"{PATH}/1/cancel")
        assert answer.json()["status"] == "cancelled"
        await until(lambda: not before & one.analyses())
        await until(lambda: statuses(database) == ["cancelled", "done"])
