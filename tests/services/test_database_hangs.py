"""The database is there and does not answer: locked by somebody else, or frozen.

The live table and the process' health go on whatever the limits are; everything else is
told in time.
"""

import asyncio
import threading
from contextlib import contextmanager
from datetime import timedelta

import anyio
import pytest
from anyio.to_thread import current_default_thread_limiter
from sqlalchemy import text

from app.api.turns import AT_WORK, Turns
from app.errors import ServiceStopping, StorageBusy, StorageUnavailable
from app.live import database_watch
from app.services import follow_database, machines
from app.services.follow_database import DatabaseFollower
from app.storage import postgresql
from app.storage.database import Database
from app.storage.limits import Limits
from tests.databases import locked
from tests.service_examples import (
    ROOM,
    START,
    client_of,
    problem,
    reading,
    temperatures,
)

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

SOON_S = 60.0
"""A machine may be slow, but nothing hangs."""

STATED = {"temperatures_c": temperatures(25.5)}

HELD_UP = 60


@pytest.fixture
def impatient(monkeypatch):
    """The questions that see whether the database is there give up at once."""
    question = Limits(lock_s=0.2, statement_s=0.4)
    for module in (follow_database, machines, postgresql):
        monkeypatch.setattr(module, "QUESTION", question)
    monkeypatch.setattr(postgresql.ImpatientConnection, "answer_s", question.statement_s)
    monkeypatch.setitem(postgresql._GIVE_UP, "connect_timeout", 2)


async def live_answers(client):
    """Ask for everything that needs no database; return the table at the latest reading."""
    async with asyncio.timeout(SOON_S):
        for path in ("/healthz", "/metrics"):
            assert (await client.get(path)).status_code == 200
        answer = await client.post(f"{ROOM}/compensation", json=STATED)
        assert answer.status_code == 200
        answer = await client.get(f"{ROOM}/compensation")
        assert answer.status_code == 200
        return answer.json()


@contextmanager
def every_thread_taken():
    limiter = current_default_thread_limiter()
    borrowers = [object() for _ in range(int(limiter.available_tokens))]
    for borrower in borrowers:
        limiter.acquire_on_behalf_of_nowait(borrower)
    yield
    for borrower in borrowers:
        limiter.release_on_behalf_of(borrower)


async def test_the_live_table_needs_no_thread(app, client):
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    with every_thread_taken():
        await live_answers(client)
        async with asyncio.timeout(SOON_S):
            assert (await client.get("/readyz")).status_code == 200


@pytest.mark.slow
async def test_waiting_requests_do_not_hold_up_the_live_table(new_app, postgresql_example):
    patient = {"lock_limit_s": 300, "statement_limit_s": 300, "waiting_limit_s": 300}
    service = new_app(postgresql_example, waiting_requests=HELD_UP, **patient)
    async with client_of(service) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        with locked(postgresql_example):
            waiting = [asyncio.create_task(client.get("/v1/machines")) for _ in range(HELD_UP)]
            await asyncio.sleep(0.3)
            await live_answers(client)
            assert not any(task.done() for task in waiting)
        answers = await asyncio.gather(*waiting)
    assert [answer.status_code for answer in answers] == [200] * HELD_UP


async def test_what_waits_in_vain_is_told_and_how_many_may_wait_is_limited(
    new_app, postgresql_example
):
    limits = {"lock_limit_s": 0.5, "waiting_limit_s": 0.1, "waiting_requests": 10}
    service = new_app(postgresql_example, **limits)
    async with client_of(service) as client:
        with locked(postgresql_example):
            async with asyncio.timeout(SOON_S):
                answers = await asyncio.gather(
                    *(client.get("/v1/machines") for _ in range(HELD_UP))
                )
        said = [problem(answer, 503) for answer in answers]
        assert all(int(answer.headers["retry-after"]) > 0 for answer in answers)
        assert {p["title"] for p in said} == {"The database is busy"}
        at_once = sum("10 requests wait for the database already" in p["detail"] for p in said)
        assert 0 < at_once <= HELD_UP - AT_WORK - 10
        assert any("lock timeout" in p["detail"] for p in said)
        assert (await client.get("/v1/machines")).status_code == 200


async def test_a_statement_that_takes_too_long_is_ended(postgresql_example):
    database = Database(postgresql_example, Limits(statement_s=0.2))
    with pytest.raises(StorageBusy, match="statement timeout"), database.reading() as session:
        session.execute(text("SELECT pg_sleep(60)"))
    with database.reading(Limits(statement_s=50.0)) as session:
        assert session.execute(text("SHOW statement_timeout")).scalar() == "50s"
    with database.reading() as session:
        assert session.execute(text("SHOW statement_timeout")).scalar() == "200ms"
        assert session.execute(text("SHOW synchronous_commit")).scalar() == "off", "the URL's own"
    with database.migrating() as connection:
        assert connection.execute(text("SHOW statement_timeout")).scalar() == "0"
        assert connection.execute(text("SHOW lock_timeout")).scalar() == "0"
    database.close()


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
async def test_the_table_says_that_the_database_does_not_answer(
    new_app, postgresql_example, clock, monkeypatch
):
    monkeypatch.setattr(database_watch, "SILENCE_S", 0.05)
    monkeypatch.setattr(follow_database, "QUESTION", Limits(lock_s=300.0, statement_s=300.0))
    service = new_app(postgresql_example)
    follower = DatabaseFollower(service.state.context, every_s=1.0)
    follower.look()
    async with client_of(service) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        with locked(postgresql_example):
            looking = threading.Thread(target=follower.look)
            looking.start()
            async with asyncio.timeout(SOON_S):
                while not (table := await live_answers(client))["warnings"]:
                    await asyncio.sleep(0.05)
            assert "the database has not answered for" in table["warnings"][0]
            assert "thermap_database_away 1.0" in (await client.get("/metrics")).text
            answer = await client.get("/readyz")
            assert (answer.status_code, answer.json()["status"]) == (503, "not-ready")
            assert looking.is_alive()
        looking.join(SOON_S)
        assert (await live_answers(client))["warnings"] == []
        assert (await client.get("/readyz")).status_code == 200


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
async def test_a_look_that_fails_on_a_lock_is_said(new_app, postgresql_example, clock):
    service = new_app(postgresql_example)
    follower = DatabaseFollower(service.state.context, every_s=1.0)
    follower.look()
    async with client_of(service) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        with locked(postgresql_example):
            follower.look()
            clock.advance(7)
            (warning,) = (await live_answers(client))["warnings"]
        assert "the database has been away for 7 s" in warning
        follower.look()
        assert (await live_answers(client))["warnings"] == []


@pytest.mark.slow
async def test_a_sqlite_file_that_another_program_holds(
    new_app, sqlite_example, clock, monkeypatch
):
    service = new_app(sqlite_example, lock_limit_s=0.1)
    follower = DatabaseFollower(service.state.context, every_s=1.0)
    follower.look()
    early = reading(START - timedelta(seconds=60), 25.0)
    async with client_of(service) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        with locked(sqlite_example):
            answer = await client.post(f"{ROOM}/readings", json=early)
            assert problem(answer, 503)["title"] == "The database is busy"
            assert int(answer.headers["retry-after"]) > 0
            assert (await client.get("/v1/machines")).status_code == 200  # readers go on
            follower.look()
            assert (await live_answers(client))["warnings"] == [], "a moment is no trouble"
            monkeypatch.setattr(follow_database, "LOCKED_S", 0.0)
            follower.look()
            clock.advance(6)
            (warning,) = (await live_answers(client))["warnings"]
            assert "the database has been locked, and has taken nothing new, for 6 s" in warning
            answer = await client.get("/readyz")
            assert answer.status_code == 503
            assert "locked" in answer.json()["database"]
        follower.look()
        assert (await live_answers(client))["warnings"] == []
        assert (await client.get("/readyz")).status_code == 200
        assert (await client.post(f"{ROOM}/readings", json=early)).status_code == 201


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
async def test_a_server_that_is_frozen_costs_a_request_its_limit_and_no_more(new_app, wire):
    service = new_app(wire.url, statement_limit_s=0.2)
    async with client_of(service) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        follower = DatabaseFollower(service.state.context, every_s=1.0)
        follower.look()
        wire.freeze()
        async with asyncio.timeout(SOON_S):
            listed, ready, _ = await asyncio.gather(
                client.get("/v1/machines"),
                client.get("/readyz"),
                anyio.to_thread.run_sync(follower.look),
            )
        assert problem(listed, 503)["title"] == "The database is away"
        assert ready.status_code == 503
        assert "the database has been away" in (await live_answers(client))["warnings"][0]
        wire.thaw()
        async with asyncio.timeout(SOON_S):
            assert (await client.get("/v1/machines")).status_code == 200
        follower.look()
        assert (await live_answers(client))["warnings"] == []


async def test_whoever_waits_for_an_answer_is_let_go_when_the_service_ends(postgresql_example):
    database = Database(postgresql_example, Limits(lock_s=300.0, statement_s=300.0))
    caught = []

    def wait():
        try:
            with database.reading() as session:
                session.execute(text("SELECT count(*) FROM machine"))
        except StorageUnavailable as error:
            caught.append(error.detail)

    with locked(postgresql_example):
        threads = [threading.Thread(target=wait) for _ in range(3)]
        for thread in threads:
            thread.start()
        threads[0].join(0.3)
        database.close()
        for thread in threads:
            thread.join(SOON_S)
    assert len(caught) == 3
    assert all("the service ends" in detail for detail in caught)


async def test_turns_are_given_back_whatever_happens():
    turns = Turns(most_waiting=1, wait_s=0.05)
    async with anyio.create_task_group() as group:
        entered = []

        async def work():
            async with turns.taken():
                entered.append(1)
                await anyio.sleep_forever()

        for _ in range(AT_WORK):
            group.start_soon(work)
        while len(entered) < AT_WORK:
            await anyio.sleep(0)
        with pytest.raises(StorageBusy, match=r"work on it for 0\.05 s"):
            async with turns.taken():
                pytest.fail("more at work than may be")
        group.cancel_scope.cancel()
    for _ in range(2 * AT_WORK):
        with pytest.raises(ZeroDivisionError):
            async with turns.taken():
                raise ZeroDivisionError


async def test_at_the_end_who_waits_for_a_turn_is_sent_away_and_who_has_one_goes_on():
    turns = Turns(most_waiting=10, wait_s=SOON_S)
    done, sent_away = [], []
    may_end = anyio.Event()

    async def work():
        try:
            async with turns.taken():
                await may_end.wait()
                done.append(1)
        except ServiceStopping:
            sent_away.append(1)

    async with anyio.create_task_group() as group:
        for _ in range(AT_WORK + 5):
            group.start_soon(work)
        await anyio.wait_all_tasks_blocked()
        turns.end()
        await anyio.wait_all_tasks_blocked()
        assert (len(done), len(sent_away)) == (0, 5)
        with pytest.raises(ServiceStopping, match="nothing was done"):
            async with turns.taken():
                pytest.fail("nobody waits any more")
        may_end.set()
    assert (len(done), len(sent_away)) == (AT_WORK, 5)
    async with turns.taken():
        pass
