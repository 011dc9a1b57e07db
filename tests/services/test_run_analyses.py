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

from app.errors import StorageUnavailable
from app.services import carry_analyses as module
from app.services.analysis_process import JobUpdate
from app.services.carry_analyses import PATIENCE_S, AbandonedAnalyses, AnalysisCarrier, Carried
from app.services.context import Context
from app.storage.analyses import (
    MOST_TRIES,
    begin_analysis,
    fail_analysis,
    finish_analysis,
    give_back,
    give_up,
    insert_analysis,
    next_analysis,
    read_analysis,
    record_heartbeat,
)
from app.storage.database import Database
from app.storage.records import AnalysisStatus, AnalysisTask
from app.storage.tables import MachineRow
from tests.campaign_examples import LATER, MACHINE_ID, ROOM, campaign_database
from tests.databases import KINDS, reachable
from tests.faults.service import Service
from tests.service_examples import Clock, client_of, running

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
async def test_a_service_that_stops_gives_its_job_back_to_the_next(url):
    with running(url, Clock(LATER)) as service:
        async with client_of(service) as client:
            number, _ = await begun(client)
            waiting = (await client.post(PATH, json=BODY)).json()["id"]
            service.state.runner.stop()
            assert processes() == []
            assert [await status_of(client, i) for i in (number, waiting)] == ["queued"] * 2
    with running(url, Clock(LATER)) as service:
        async with client_of(service) as client:
            service.state.runner.start()

            async def runs():
                return await status_of(client, number) == "running"

            await until(runs)


@pytest.fixture
def two_machines(database):
    """One analysis of the machine that waits, and one of a sister that waits."""
    with database.writing() as session:
        row = session.get(MachineRow, MACHINE_ID)
        values = {c.name: getattr(row, c.name) for c in MachineRow.__table__.columns}
        session.add(MachineRow(**values | {"id": "sister"}))
        session.flush()
        return [insert_analysis(session, m, TASK, LATER).id for m in (MACHINE_ID, "sister")]


def begin(database, number, owner):
    with database.writing() as session:
        return begin_analysis(session, number, owner, LATER)


def read(database, number):
    with database.reading() as session:
        return read_analysis(session, number)


@pytest.mark.slow
def test_what_no_longer_beats_is_tried_again_and_fails_the_third_time(database, two_machines):
    abandoned, alive = two_machines
    passed_s = [0.0]
    watch = AbandonedAnalyses(Context(database, now=Clock(LATER)), lambda: passed_s[0])
    assert begin(database, alive, "lives")
    for tried in range(1, MOST_TRIES + 1):
        assert begin(database, abandoned, f"try {tried}")
        for _ in range(4):
            watch.look()
            assert read(database, abandoned).status is AnalysisStatus.RUNNING
            with database.writing() as session:
                assert record_heartbeat(session, alive, "lives", 0.5, "searching")
            passed_s[0] += PATIENCE_S / 3.5
        watch.look()
        found = read(database, abandoned)
        if tried < MOST_TRIES:
            assert (found.status, found.progress) == (AnalysisStatus.QUEUED, 0.0)
            assert f"begun {tried} of {MOST_TRIES} times" in found.message
            assert found.started_at is None
    assert (found.status, found.finished_at) == (AnalysisStatus.FAILED, LATER)
    assert "gone" in found.message
    assert read(database, alive).status is AnalysisStatus.RUNNING


def test_nobody_is_given_up_for_not_beating_while_the_database_was_away(
    database, two_machines, monkeypatch
):
    passed_s = [0.0]
    watch = AbandonedAnalyses(Context(database, now=Clock(LATER)), lambda: passed_s[0])
    assert begin(database, two_machines[0], "lives")
    watch.look()

    def away(_session):
        raise StorageUnavailable("the database is away")

    with monkeypatch.context() as patched:
        patched.setattr(module, "running_analyses", away)
        passed_s[0] += 10.0 * PATIENCE_S
        with pytest.raises(StorageUnavailable):
            watch.look()
    watch.look()
    assert read(database, two_machines[0]).status is AnalysisStatus.RUNNING


def test_of_one_machine_one_analysis_runs_at_a_time(database, two_machines):
    with database.writing() as session:
        second = insert_analysis(session, MACHINE_ID, TASK, LATER).id
    carrier = AnalysisCarrier(Context(database, now=Clock(LATER)))
    assert begin(database, two_machines[0], "another")
    assert carrier.carry_out(second) is Carried.BUSY
    assert read(database, second).status is AnalysisStatus.QUEUED
    with database.reading() as session:
        assert next_analysis(session) == two_machines[1]


def test_what_is_given_back_was_not_tried(database, two_machines):
    number = two_machines[0]
    for tried in range(2 * MOST_TRIES):
        assert begin(database, number, f"try {tried}")
        with database.writing() as session:
            assert not give_back(session, number, "another")
            assert give_back(session, number, f"try {tried}")
    assert begin(database, number, "last")
    with database.writing() as session:
        assert give_up(session, number, "last", 0, LATER) is AnalysisStatus.QUEUED


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
    server = Service(url)
    with httpx.Client(base_url=server.url, timeout=120, trust_env=False) as client:
        client.post(PATH, json=BODY).raise_for_status()
        children = Path(f"/proc/{server.pid}/task")
        deadline = time.monotonic() + 60.0
        while client.get(f"{PATH}/1").json()["message"] in ("waits for its turn", "begins"):
            assert time.monotonic() < deadline
        pids = {p for c in children.glob("*/children") for p in c.read_text().split()}
    assert pids
    server.end()
    while any(is_running(pid) for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    databases.give_back(url)


def test_every_job_is_begun_by_one_process_only(database, two_machines):
    with ThreadPoolExecutor(8) as pool:
        begun = list(pool.map(lambda owner: begin(database, two_machines[0], str(owner)), range(8)))
    assert begun.count(True) == 1


def test_what_is_not_the_owners_any_more_is_not_changed(database):
    def change(step, *arguments):
        with database.writing() as session:
            return step(session, *arguments)

    number = change(insert_analysis, MACHINE_ID, TASK, LATER).id
    assert not change(record_heartbeat, number, "one", 0.5, "")
    assert change(begin_analysis, number, "one", LATER)
    assert not change(record_heartbeat, number, "other", 0.5, "")
    assert not change(finish_analysis, number, "other", "{}", LATER)
    assert change(record_heartbeat, number, "one", 0.5, "half")
    assert change(give_up, number, "one", 0, LATER) is None  # it has beaten since
    assert change(finish_analysis, number, "one", "{}", LATER)
    assert not change(fail_analysis, number, "one", "too late", LATER)
    found = read(database, number)
    assert (found.status, found.progress, found.task) == (AnalysisStatus.DONE, 1.0, TASK)


def test_a_result_waits_for_a_database_that_is_away(database, app, monkeypatch):
    monkeypatch.setattr(module, "HEARTBEAT_S", 0.01)
    carrier = AnalysisCarrier(app.state.context)
    with database.writing() as session:
        number = insert_analysis(session, MACHINE_ID, TASK, LATER).id
        begin_analysis(session, number, "one", LATER)
    away = [True, True, False]

    def finish(*arguments):
        if away.pop(0):
            raise StorageUnavailable("the database is away")
        return finish_analysis(*arguments)

    monkeypatch.setattr(module, "finish_analysis", finish)
    carrier._store(number, "one", JobUpdate("done", "{}"))
    assert read(database, number).status is AnalysisStatus.DONE
