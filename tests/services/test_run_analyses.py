"""Analyses as jobs: whatever happens to the process or to the service, the job says so."""

import asyncio
import multiprocessing
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from app.services import run_analyses as module
from app.services.analysis_process import JobUpdate
from app.services.run_analyses import STOPPED, AnalysisRunner
from app.storage.analyses import (
    claim_analysis,
    fail_analysis,
    finish_analysis,
    insert_analysis,
    read_analysis,
    record_heartbeat,
)
from app.storage.database import Database
from app.storage.records import AnalysisStatus, AnalysisTask
from tests.campaign_examples import LATER, MACHINE_ID, ROOM, campaign_database
from tests.databases import KINDS, reachable
from tests.service_examples import Clock, client_of, running
from tests.services.test_durability import Server

pytestmark = pytest.mark.anyio

PATH = f"{ROOM}/analyses"
TASK = AnalysisTask(3, list(range(1, 9)), 0.3, None, 0)
BODY = {"verifications": list(range(1, 9))}


@pytest.fixture(params=KINDS)
def url(request, databases):
    made = reachable(lambda kind: databases.prepared(kind, campaign_database), request.param)
    yield made
    databases.give_back(made)


@pytest.fixture
def app(url):
    with running(url, Clock(LATER)) as service:
        yield service


@pytest.fixture
async def client(app):
    async with client_of(app) as client:
        yield client


@pytest.fixture
def database(url):
    opened = Database(url)
    yield opened
    opened.close()


def processes():
    """The processes of analyses that this process has."""
    return [p for p in multiprocessing.active_children() if p.name.startswith("analysis ")]


async def until(question):
    deadline = time.monotonic() + 60.0
    while not (found := await question()):
        assert time.monotonic() < deadline
        await asyncio.sleep(0.02)
    return found


async def status_of(client, number):
    return (await client.get(f"{PATH}/{number}")).json()["status"]


async def begun(client, body=BODY):
    """Ask for an analysis, and wait until its process runs."""
    number = (await client.post(PATH, json=body)).json()["id"]

    async def runs():
        return await status_of(client, number) == "running" and processes()

    (process,) = await until(runs)
    return number, process


async def gone():
    return not processes()


@pytest.mark.slow
async def test_a_killed_process_leaves_a_failed_analysis_with_the_reason(client):
    number, process = await begun(client)
    os.kill(process.pid, signal.SIGKILL)

    async def failed():
        found = (await client.get(f"{PATH}/{number}")).json()
        return found if found["status"] == "failed" else None

    found = await until(failed)
    assert "SIGKILL" in found["message"]
    assert found["result"] is None
    assert found["finished_at"] is not None


@pytest.mark.slow
async def test_cancelling_ends_the_process_and_those_that_wait_never_begin(client):
    number, _ = await begun(client)
    waiting = (await client.post(PATH, json=BODY)).json()["id"]
    for analysis in (waiting, number):
        answer = await client.post(f"{PATH}/{analysis}/cancel")
        assert (answer.status_code, answer.json()["status"]) == (200, "cancelled")
    await until(gone)
    again = await client.post(f"{PATH}/{number}/cancel")
    assert again.status_code == 200
    assert [await status_of(client, i) for i in (number, waiting)] == ["cancelled"] * 2


@pytest.mark.slow
async def test_deleting_ends_the_process_and_the_next_one_gets_its_turn(client):
    number, _ = await begun(client)
    waiting = (await client.post(PATH, json=BODY)).json()["id"]
    assert (await client.delete(f"{PATH}/{number}")).status_code == 204

    async def next_one():
        return [p for p in processes() if p.name == f"analysis {waiting}"]

    await until(next_one)
    assert (await client.delete(ROOM)).status_code == 204
    await until(gone)


@pytest.mark.slow
async def test_a_service_that_stops_fails_its_job_and_leaves_the_queue_to_the_next(url):
    with running(url, Clock(LATER)) as service:
        async with client_of(service) as client:
            number, _ = await begun(client)
            waiting = (await client.post(PATH, json=BODY)).json()["id"]
            service.state.runner.stop()
            assert processes() == []
            found = (await client.get(f"{PATH}/{number}")).json()
            assert (found["status"], found["message"]) == ("failed", STOPPED)
            assert await status_of(client, waiting) == "queued"
    with running(url, Clock(LATER)) as service:
        async with client_of(service) as client:
            service.state.runner.start()

            async def runs():
                return await status_of(client, waiting) == "running"

            await until(runs)


@pytest.mark.slow
async def test_what_another_service_ran_fails_once_it_no_longer_beats(
    client, app, database, monkeypatch
):
    # Time passes with the beats of the one that lives: however slow the machine is, it beats.
    passed_s = [0.0]
    monkeypatch.setattr(module, "monotonic", lambda: passed_s[0])
    monkeypatch.setattr(module, "QUEUE_POLL_S", 0.05)
    with database.writing() as session:
        numbers = [insert_analysis(session, MACHINE_ID, TASK, LATER).id for _ in range(2)]
        assert [claim_analysis(session, owner, LATER) for owner in ("gone", "lives")] == numbers
    abandoned, alive = numbers
    app.state.runner.start()

    async def failed():
        with database.writing() as session:
            assert record_heartbeat(session, alive, "lives", 0.5, "searching")
        passed_s[0] += module.PATIENCE_S / 10.0
        return await status_of(client, abandoned) == "failed"

    await until(failed)
    found = (await client.get(f"{PATH}/{abandoned}")).json()
    assert found["message"] == STOPPED
    assert await status_of(client, alive) == "running"


def is_running(pid):
    """Whether a process is there and no zombie, by the system's own list."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs Linux' list of processes")
def test_the_process_ends_with_a_service_that_is_killed(databases):
    """Nobody waits for its result; another service says later that the job failed."""
    url = databases.prepared("sqlite", campaign_database)
    server = Server(url)
    with httpx.Client(base_url=server.url, timeout=120, trust_env=False) as client:
        client.post(PATH, json=BODY).raise_for_status()
        children = Path(f"/proc/{server.pid}/task")
        deadline = time.monotonic() + 60.0
        while client.get(f"{PATH}/1").json()["message"] in ("waits for its turn", "begins"):
            assert time.monotonic() < deadline
        pids = {p for c in children.glob("*/children") for p in c.read_text().split()}
    assert pids
    server.kill()
    while any(is_running(pid) for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    databases.give_back(url)


def test_every_job_is_claimed_by_one_service_only(database):
    with database.writing() as session:
        numbers = {insert_analysis(session, MACHINE_ID, TASK, LATER).id for _ in range(6)}

    def claim(owner):
        with database.writing() as session:
            return claim_analysis(session, str(owner), LATER)

    with ThreadPoolExecutor(8) as pool:
        claimed = list(pool.map(claim, range(8)))
    assert {i for i in claimed if i is not None} == numbers
    assert claimed.count(None) == 2


def test_what_is_not_the_owners_any_more_is_not_changed(database):
    def change(step, *arguments):
        with database.writing() as session:
            return step(session, *arguments)

    number = change(insert_analysis, MACHINE_ID, TASK, LATER).id
    assert not change(record_heartbeat, number, "one", 0.5, "")
    assert change(claim_analysis, "one", LATER) == number
    assert not change(record_heartbeat, number, "other", 0.5, "")
    assert not change(finish_analysis, number, "other", "{}", LATER)
    assert change(record_heartbeat, number, "one", 0.5, "half")
    assert not change(fail_analysis, number, "one", 0, "it has beaten since", LATER)
    assert change(finish_analysis, number, "one", "{}", LATER)
    assert not change(fail_analysis, number, "one", None, "too late", LATER)
    with database.reading() as session:
        found = read_analysis(session, number)
    assert (found.status, found.progress, found.task) == (AnalysisStatus.DONE, 1.0, TASK)


def test_a_result_waits_for_a_database_that_is_away(database, app, monkeypatch):
    monkeypatch.setattr(module, "HEARTBEAT_S", 0.01)
    runner = AnalysisRunner(app.state.context)
    with database.writing() as session:
        number = insert_analysis(session, MACHINE_ID, TASK, LATER).id
        claim_analysis(session, runner._owner, LATER)
    away = [True, True, False]

    def finish(*arguments):
        if away.pop(0):
            raise module.StorageUnavailable("the database is away")
        return finish_analysis(*arguments)

    monkeypatch.setattr(module, "finish_analysis", finish)
    runner._store(number, JobUpdate("done", "{}"))
    with database.reading() as session:
        assert read_analysis(session, number).status is AnalysisStatus.DONE
