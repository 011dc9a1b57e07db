"""Several services on one PostgreSQL: each is told at once of what another one stored."""

import threading
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import timedelta
from time import monotonic, sleep

import httpx
import psycopg
import pytest
from sqlalchemy import make_url, text
from sqlalchemy.exc import DBAPIError

from app.access.keys import Role, digest_of
from app.cli.listening import listening, serving, url_of
from app.main import create_app
from app.services import follow_database
from app.services.access_keys import create_key, revoke_key
from app.services.events import ALARM_DUTY, AlarmLog
from app.services.follow_database import DatabaseFollower
from app.settings import Settings
from app.storage.news import CHANNEL, NewsKind, read_payload, tell
from tests.service_examples import (
    ROOM,
    START,
    UNHURRIED,
    client_of,
    iso,
    problem,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio

SOON_S = 60.0
"""A machine may be slow; what is told is seen some time."""

STATED = {"temperatures_c": temperatures(25.5)}


@pytest.fixture
def told_only(monkeypatch):
    """Nobody looks at everything again after the beginning: what is not told is not seen."""
    monkeypatch.setattr(follow_database, "EVERYTHING_S", 3600.0)


@contextmanager
def following(service):
    """Let a service follow the others, as it does while it runs."""
    ring = service.state.access.ring
    follower = DatabaseFollower(service.state.context, every_s=3600.0, refresh_keys=ring.refresh)
    follower.start()
    try:
        yield follower
    finally:
        follower.stop()


@pytest.fixture
def one_app(new_app, postgresql_example, told_only):
    return new_app(postgresql_example)


@pytest.fixture
def other_app(new_app, postgresql_example, told_only):
    """Another service, that has looked at everything once and hears news from now on."""
    service = new_app(postgresql_example)
    with following(service):
        until(lambda: len(service.state.context.live) == 1)
        until(lambda: listeners(postgresql_example) == 1)
        yield service


@pytest.fixture
async def one(one_app):
    async with client_of(one_app) as client:
        yield client


@pytest.fixture
async def other(other_app):
    async with client_of(other_app) as client:
        yield client


def until(is_so, within_s=SOON_S):
    """Wait until something is so."""
    end = monotonic() + within_s
    while not is_so():
        assert monotonic() < end, "it never was"
        sleep(0.005)


def plain(url):
    """The same database for psycopg."""
    return make_url(url).set(drivername="postgresql", query={}).render_as_string(False)


def listeners(url):
    """Count the connections that listen for news and wait; the queue listens for itself."""
    with psycopg.connect(plain(url)) as connection:
        found = connection.execute(
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
            "AND query LIKE 'LISTEN thermap%' AND state = 'idle'"
        )
        return found.fetchone()[0]


def throw_out_listeners(url):
    with psycopg.connect(plain(url)) as connection:
        connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
            "WHERE datname = current_database() AND query LIKE 'LISTEN thermap%'"
        )


async def eventually(ask, is_so):
    """Ask until an answer is as it should be, and give it."""
    end = monotonic() + SOON_S
    while not is_so(answer := await ask()):
        assert monotonic() < end, answer.text
        sleep(0.005)
    return answer


async def test_a_reading_that_one_stored_is_in_the_others_table(one, other):
    problem(await other.get(f"{ROOM}/compensation"), 409)
    await one.post(f"{ROOM}/readings", json=reading(START, 25.5))
    there = await eventually(
        lambda: other.get(f"{ROOM}/compensation"), httpx.Response.is_success.fget
    )
    assert there.content == (await one.get(f"{ROOM}/compensation")).content


async def test_what_one_withdrew_is_in_no_table_of_the_other(one, other):
    await one.post(f"{ROOM}/readings", json=reading(START - timedelta(seconds=30), 24.0))
    await one.post(f"{ROOM}/readings", json=reading(START, 25.5))
    await eventually(
        lambda: other.get(f"{ROOM}/compensation"),
        lambda answer: answer.json().get("reading_time") == iso(START),
    )
    gone = await one.delete(f"{ROOM}/readings", params={"from": iso(START), "to": iso(START)})
    assert gone.json() == {"withdrawn": 1}
    await eventually(
        lambda: other.get(f"{ROOM}/compensation"),
        lambda answer: answer.json()["reading_time"] == iso(START - timedelta(seconds=30)),
    )


async def test_a_key_that_is_revoked_elsewhere_opens_nothing_any_more(
    new_app, postgresql_example, one_app, told_only
):
    database = one_app.state.context.database
    made = create_key(database, "line-3", Role.VIEWER)
    key, digest = made.key, digest_of(made.secret)
    service = new_app(postgresql_example, require_keys=True, refresh_s=3600.0)
    # As it is served: the ring that is told has to be the one that opens.
    with listening("127.0.0.1", 0, "serve") as opened, serving(service, opened, "warning"):
        until(lambda: listeners(postgresql_example) == 1)
        until(lambda: service.state.access.ring.find(digest).key == key)
        revoke_key(database, "line-3")
        until(lambda: service.state.access.ring.find(digest) is None)


async def test_what_was_stored_while_nobody_could_be_told_is_seen_after_the_connection(
    new_app, one, wire, told_only
):
    """The wire is cut, so that what one tells is heard by nobody."""
    service = new_app(wire.url)
    ring = service.state.access.ring
    follower = DatabaseFollower(service.state.context, every_s=0.05, refresh_keys=ring.refresh)
    follower.start()
    live = service.state.context.live
    until(lambda: live.get("mcfv5050") is not None)
    wire.cut()
    until(lambda: live.database.trouble is not None)
    await one.post(f"{ROOM}/readings", json=reading(START, 25.5))
    wire.mend()
    until(lambda: live.get("mcfv5050").readings.latest is not None)
    until(lambda: live.database.trouble is None)
    follower.stop()


async def test_who_is_thrown_out_listens_again(postgresql_example, one, other, other_app):
    window = other_app.state.context.live.get("mcfv5050").readings
    for seconds in (60, 30, 0):
        throw_out_listeners(postgresql_example)
        time = START - timedelta(seconds=seconds)
        await one.post(f"{ROOM}/readings", json=reading(time, 25.5))
        until(lambda time=time: window.latest is not None and window.latest.time == time)


async def test_what_is_told_is_small_and_only_what_was_committed(one_app, postgresql_example):
    database = one_app.state.context.database
    with closing(psycopg.connect(plain(postgresql_example), autocommit=True)) as ears:
        ears.execute(f"LISTEN {CHANNEL}")
        with pytest.raises(DBAPIError), database.writing() as session:
            _tell_and_fail(session)
        async with client_of(one_app) as client:
            many = [reading(START - timedelta(seconds=s), 25.0) for s in range(300)]
            await client.post(f"{ROOM}/readings", json=many)
        told = [one.payload for one in ears.notifies(timeout=SOON_S, stop_after=1)]
        ears.execute("SELECT 1")
        told += [one.payload for one in ears.notifies(timeout=0)]
    assert told == [f"readings {database.sender} mcfv5050"]


async def test_nobody_is_told_of_what_it_stored_itself_nor_confused_by_others(
    one, other, other_app, postgresql_example, monkeypatch
):
    looks = []
    whole = DatabaseFollower.look

    def look(follower, news=None):
        looks.append(news)
        return whole(follower, news)

    monkeypatch.setattr(DatabaseFollower, "look", look)
    await other.post(f"{ROOM}/readings", json=reading(START - timedelta(seconds=30), 25.0))
    with psycopg.connect(plain(postgresql_example), autocommit=True) as somebody:
        somebody.execute(f"NOTIFY {CHANNEL}, 'nothing of ours'")
    await one.post(f"{ROOM}/readings", json=reading(START, 25.5))
    live = other_app.state.context.live.get("mcfv5050")
    until(lambda: live.readings.latest.time == START)
    kinds = [(one.kind, one.machine_id) for news in looks for one in news]
    assert kinds == [(NewsKind.READINGS, "mcfv5050")]
    assert read_payload("readings") is None


@pytest.mark.slow
async def test_streams_of_one_tell_what_another_stored(
    new_app, postgresql_example, one, told_only, clock
):
    service = create_app(Settings(database_url=postgresql_example, refresh_s=3600.0, **UNHURRIED))
    service.state.context = replace(service.state.context, now=clock)
    with (
        listening("127.0.0.1", 0, "serve") as socket,
        serving(service, socket, "warning"),
        httpx.Client(base_url=url_of(socket), trust_env=False, timeout=SOON_S) as client,
        client.stream("GET", f"{ROOM}/compensation/stream") as answer,
    ):
        until(lambda: listeners(postgresql_example) == 1)
        lines = answer.iter_lines()
        posting = threading.Thread(target=_post_apart, args=(postgresql_example, clock))
        posting.start()
        line = next(found for found in lines if f'"reading_time":"{iso(START)}"' in found)
        posting.join()
    assert line.startswith("data: ")


def _tell_and_fail(session):
    tell(session, NewsKind.MACHINE, "undone")
    session.execute(text("SELECT 1 / 0"))


def _post_apart(url, clock):
    """Store a reading by a service in a thread of its own."""
    service = create_app(Settings(database_url=url, **UNHURRIED))
    service.state.context = replace(service.state.context, now=clock)
    with listening("127.0.0.1", 0, "serve") as socket, serving(service, socket, "warning"):
        sent = httpx.post(
            f"{url_of(socket)}{ROOM}/readings",
            json=reading(START, 25.5),
            trust_env=False,
            timeout=SOON_S,
        )
        assert sent.status_code == 201


async def test_one_writes_alarms_and_when_it_is_gone_another(
    new_app, postgresql_example, one, told_only
):
    duties = [new_app(postgresql_example).state.context.database.duty(ALARM_DUTY) for _ in range(3)]
    assert [duty.is_ours() for duty in duties] == [True, False, False]
    assert [duty.is_ours() for duty in duties] == [True, False, False]
    with psycopg.connect(plain(postgresql_example)) as connection:
        connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_locks WHERE locktype = 'advisory' "
            f"AND objid = {ALARM_DUTY} AND database = (SELECT oid FROM pg_database "
            "WHERE datname = current_database())"
        )
    until(lambda: duties[1].is_ours())
    assert [duty.is_ours() for duty in duties] == [False, True, False]
    duties[1].lay_down()
    until(lambda: duties[2].is_ours())
    duties[2].lay_down()


async def test_an_alarm_is_written_once_and_ended_by_who_takes_over(
    new_app, postgresql_example, clock
):
    services = [new_app(postgresql_example) for _ in range(2)]
    followers = [DatabaseFollower(s.state.context, every_s=1.0) for s in services]
    logs = [AlarmLog(service.state.context) for service in services]

    def look():
        for follower in followers:
            follower.look()
        for _ in range(3):
            for log in logs:
                log.look_if_ours()

    async with client_of(services[0]) as client:

        async def at(t_c):
            clock.advance(60)
            await client.post(f"{ROOM}/readings", json=reading(clock(), t_c))
            look()
            asked = await client.get(f"{ROOM}/events", params={"kind": "alarm"})
            return asked.json()["events"]

        assert await at(29.8) == []
        (alarm,) = await at(30.5)
        assert alarm["until"] is None
        logs[0].stop()
        logs.pop(0)
        (same,) = await at(30.6)
        assert (same["id"], same["until"], same["count"]) == (alarm["id"], None, 1)
        await at(29.8)
        (ended,) = await at(29.8)
        assert ended["until"] is not None
        logs[0].stop()
