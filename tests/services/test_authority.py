"""What a key may do is looked at where it is used: after the body, when something is written, and
as long as a stream lasts. Keys are revoked in the service itself, and beside it, unknown to it.
"""

import asyncio
import socket
import threading
from contextlib import closing, contextmanager
from datetime import timedelta
from urllib.parse import urlsplit

import httpx
import orjson
import pytest
from sqlalchemy import insert, select, update

from app.access.authorization import Authorization, as_service, asking
from app.access.keys import Role, digest_of
from app.api import access
from app.api.access import COOKIE, requirement_of
from app.events.event import EventKind
from app.services.access_keys import create_key, revoke_key, show_keys
from app.services.context import Context
from app.services.follow_database import DatabaseFollower
from app.services.load_machine import load_machine
from app.services.machines import create_machine, delete_machine, show_machine
from app.services.readings import ReadingBatch, _Together
from app.storage import access_keys as module
from app.storage.database import Database
from app.storage.events import begin_passing
from app.storage.machines import RowLock, find_machine
from app.storage.tables import AccessKeyRow, BrowserSessionRow
from app.thermal.reading import Reading
from tests.followed_streams import opened
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    contents,
    error_map,
    iso,
    problem,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio

NEVER = 3600.0
"""A service that asks so seldom learns nothing of what is done beside it."""

CONTENT = {"temperatures_c": temperatures(25.0)}
CSV = b"# component: EXX\n"
JSON_KIND, CSV_KIND = {"Content-Type": "application/json"}, {"Content-Type": "text/csv"}

WITH_BODY = {
    "table": ("POST", f"{ROOM}/compensation", orjson.dumps(CONTENT), JSON_KIND),
    "readings": ("POST", f"{ROOM}/readings", orjson.dumps(reading(START, 25.0)), JSON_KIND),
    "more readings": (
        *("POST", f"{ROOM}/readings?"),
        *(orjson.dumps([reading(START - timedelta(seconds=s), 25.0) for s in range(9)]), JSON_KIND),
    ),
    "map": ("POST", f"{ROOM}/error-maps", orjson.dumps(error_map("Run #9", 40.0)), JSON_KIND),
    "file": ("POST", f"{ROOM}/files", CSV, CSV_KIND),
    "machine": ("PATCH", ROOM, b'{"name": "Mine"}', JSON_KIND),
    "new machine": (
        *("POST", "/v1/machines", orjson.dumps(MACHINE | {"id": "mine"})),
        JSON_KIND,
    ),
    "key": ("POST", "/v1/keys", b'{"name": "mine", "role": "admin"}', JSON_KIND),
    "predictions": ("POST", f"{ROOM}/predictions", b"{}", JSON_KIND),
    "parse": ("POST", "/v1/controllers/thermap-csv/parse", b"{}", JSON_KIND),
}


@pytest.fixture
def service(new_app, furnished_url):
    return new_app(furnished_url, require_keys=True, refresh_s=NEVER)


@pytest.fixture
def beside(furnished_url):
    """The database as `thermap keys` has it: the service is told of nothing."""
    with closing(Database(furnished_url)) as database:
        yield database


def client_with(service, secret):
    return httpx.AsyncClient(
        transport=httpx.ASGITransport(app=service, raise_app_exceptions=False),
        base_url="http://localhost",
        headers={"Authorization": f"Bearer {secret}"},
        trust_env=False,
    )


def made(database, name, role, *machines):
    return create_key(database, name, Role(role), machines or None).secret


def stored(service):
    """All that is stored but keys, sessions and what the log says of keys."""
    found = contents(service)
    for table in ("access_key", "browser_session", "event"):
        found.pop(table, None)
    return found


# -- between head and body -------------------------------------------------------------------


@pytest.mark.parametrize("name", WITH_BODY)
async def test_a_request_whose_key_is_revoked_before_its_body_has_come_does_nothing(
    service, furnished_url, name
):
    database = service.state.context.database
    made(database, "boss", "admin")
    secret = made(database, "guest", "admin")
    before = stored(service)
    method, path, body, kind = WITH_BODY[name]

    async def slowly():
        yield body[:5]
        revoke_key(database, "guest")
        yield body[5:]

    headers = kind | {"Content-Length": str(len(body))}
    async with client_with(service, secret) as client:
        answer = await client.request(method, path, content=slowly(), headers=headers)
    found = problem(answer, 401)
    assert answer.headers["WWW-Authenticate"] == "Bearer"
    assert "revoked" in found["detail"]
    assert stored(service) == before
    assert [key.name for key in show_keys(database)] == ["boss"]


async def test_a_browser_that_logs_out_before_a_body_has_come_does_nothing_more(service):
    database = service.state.context.database
    secret = made(database, "boss", "admin")
    async with client_with(service, "") as client:
        del client.headers["Authorization"]
        await client.post("/login", data={"key": secret})
        session = client.cookies[COOKIE]

        async def slowly():
            yield b'{"name": '
            service.state.access.ring.close_browser(session)
            yield b'"Mine"}'

        answer = await client.patch(ROOM, content=slowly(), headers=JSON_KIND)
    problem(answer, 401)
    assert show_machine(service.state.context, "mcfv5050").machine.name != "Mine"


# -- in the transaction ----------------------------------------------------------------------


WRITING = {
    name: WITH_BODY[name] for name in ("readings", "more readings", "map", "new machine", "key")
} | {
    "machine": WITH_BODY["machine"],
    "no machine": ("DELETE", ROOM, b"", {}),
    "no key": ("DELETE", "/v1/keys/boss?last_admin=true", b"", {}),
    "activation": ("POST", f"{ROOM}/models/2/activate", b"", {}),
    "withdrawal": ("DELETE", f"{ROOM}/readings?from={iso(START)}&to={iso(START)}", b"", {}),
}
READING = {
    "maps": f"{ROOM}/error-maps",
    "machines": "/v1/machines",
    "verdicts": "/v1/status",
    "events": "/v1/events",
    "keys": "/v1/keys",
    "page": "/machines/mcfv5050",
    "all machines": "/",
}


@pytest.mark.parametrize("name", WRITING)
async def test_a_key_that_the_service_still_believes_in_writes_nothing(service, beside, name):
    made(service.state.context.database, "boss", "admin")
    guest = made(service.state.context.database, "guest", "admin")
    before = stored(service)
    revoke_key(beside, "guest")
    method, path, body, kind = WRITING[name]
    async with client_with(service, guest) as client:
        problem(await client.request(method, path, content=body, headers=kind), 401)
    assert stored(service) == before
    assert [key.name for key in show_keys(beside)] == ["boss"]


@pytest.mark.parametrize("name", READING)
async def test_a_key_that_the_service_still_believes_in_reads_nothing_stored(service, beside, name):
    guest = made(service.state.context.database, "guest", "admin")
    async with client_with(service, guest) as client:
        assert (await client.get(READING[name])).status_code == 200
        revoke_key(beside, "guest", last_admin=True)
        problem(await client.get(READING[name]), 401)


async def test_a_key_whose_role_or_machines_became_less_does_no_more_than_that(service, beside):
    guest = made(service.state.context.database, "guest", "metrologist", "mcfv5050")
    changes = (
        ({"role": "viewer"}, "expected a key of the role sensor, got one of viewer"),
        ({"machines": ["another"]}, "is not for the machine 'mcfv5050'"),
        ({"role": "owner"}, "unknown, revoked"),
        ({"machines": []}, "unknown, revoked"),
        ({"machines": {"mcfv5050": 1}}, "unknown, revoked"),
    )
    before = stored(service)
    async with client_with(service, guest) as client:
        for values, words in changes:
            with beside.writing() as session:
                whole = {"role": "metrologist", "machines": ["mcfv5050"]} | values
                session.execute(update(AccessKeyRow).values(**whole))
            answer = await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
            assert answer.status_code in (401, 403)
            assert words in answer.json()["detail"]
    assert stored(service) == before


async def test_what_is_stored_together_asks_for_each_key(service, beside):
    context = service.state.context
    load_machine(context, "mcfv5050")
    secrets = {name: made(context.database, name, "sensor") for name in ("one", "two")}
    batches = {}
    for i, (name, secret) in enumerate(secrets.items()):
        with authorized(service, secret, "POST", f"{ROOM}/readings"):
            one = Reading(START - timedelta(seconds=i + 1), {"spindle": 20.0}, {})
            batches[name] = ReadingBatch("mcfv5050", [one])
    revoke_key(beside, "two")
    group = _Together(context)
    group.store(list(batches.values()))
    assert [batch.outcome for batch in batches.values()] == [None, None]
    group.store([batches["one"]])
    group.follow([batches["one"]])
    assert batches["one"].outcome is not None
    assert asking.get() is None


@contextmanager
def authorized(service, secret, method, path):
    """Do something as the request of a key."""
    stored_key = service.state.access.ring.find(digest_of(secret))
    scope = {"type": "http", "method": method, "path": path}
    service.find_route(scope)
    requirement = requirement_of(scope)
    now = service.state.access.ring.now
    authorization = Authorization(digest_of(secret), stored_key.key, requirement, None, now)
    with as_service():
        asking.set(authorization)
        yield


@pytest.mark.slow
@pytest.mark.parametrize("furnished_url", ["postgresql"], indirect=True)
async def test_who_revokes_waits_for_what_is_being_written_and_nobody_for_each_other(
    service, beside
):
    """So that of a write and a revocation one is the first."""
    database = service.state.context.database
    guest = made(database, "guest", "metrologist", "mcfv5050")
    written, go_on = threading.Event(), threading.Event()
    order = []

    def write():
        with authorized(service, guest, "PUT", f"{ROOM}/x"), database.writing() as session:
            find_machine(session, "mcfv5050", RowLock.CHANGED)
            module.confirm_authorization(session, locked=True)
            written.set()
            go_on.wait(60.0)
            order.append("written")

    def revoke():
        revoke_key(beside, "guest")
        order.append("revoked")

    def delete():
        delete_machine(service.state.context, "mcfv5050")
        order.append("deleted")

    threads = [threading.Thread(target=one) for one in (write, revoke, delete)]
    threads[0].start()
    assert written.wait(60.0)
    for thread in threads[1:]:
        thread.start()
    threads[1].join(0.3)
    assert order == []
    go_on.set()
    for thread in threads:
        thread.join(60.0)
    assert order[0] == "written"
    assert sorted(order) == ["deleted", "revoked", "written"]


# -- numbers and sessions --------------------------------------------------------------------


async def test_a_session_is_opened_for_the_key_that_was_stated_and_for_none_after_it(
    service, beside
):
    guest = made(service.state.context.database, "guest", "viewer")
    number = service.state.access.ring.find(digest_of(guest)).key.id
    revoke_key(beside, "guest")
    boss = create_key(beside, "boss", Role.ADMIN).key
    assert boss.id > number  # it is not given again
    async with client_with(service, "") as client:
        answer = await client.post("/login", data={"key": guest})
    assert answer.status_code == 403
    assert COOKIE not in answer.cookies
    with beside.reading() as session:
        assert session.scalars(select(BrowserSessionRow)).all() == []


async def test_a_session_states_no_key_for_another_session(service):
    guest = made(service.state.context.database, "guest", "viewer")
    async with client_with(service, "") as client:
        await client.post("/login", data={"key": guest})
        answer = await client.post("/login", data={"key": client.cookies[COOKIE]})
    assert answer.status_code == 403


@pytest.mark.parametrize("limit", ["MOST_SESSIONS_OF_KEY", "MOST_SESSIONS"])
async def test_sessions_are_limited_and_the_first_one_ends(service, clock, monkeypatch, limit):
    monkeypatch.setattr(module, limit, 3)
    database = service.state.context.database
    secrets = [made(database, name, "viewer") for name in ("one", "two")]
    stated = secrets[:1] * 5 if limit == "MOST_SESSIONS_OF_KEY" else secrets * 3
    async with client_with(service, "") as client:
        del client.headers["Authorization"]
        sessions = []
        for secret in stated:
            clock.advance(1)
            client.cookies.clear()
            assert (await client.post("/login", data={"key": secret})).status_code == 303
            sessions.append(client.cookies[COOKIE])
        codes = []
        for session in sessions:
            client.cookies = {COOKIE: session}
            codes.append((await client.get(ROOM)).status_code)
    assert codes == [401] * (len(stated) - 3) + [200] * 3
    with database.reading() as session:
        assert len(session.scalars(select(BrowserSessionRow)).all()) == 3


async def test_unknown_keys_let_the_database_be_asked_once_for_all_of_them(service, monkeypatch):
    ring = service.state.access.ring
    asked = []
    looking_again = service.state.access._looking_again
    monkeypatch.setattr(looking_again, "_ask", lambda: asked.append(ring.refresh()))
    monkeypatch.setattr(access, "LOOK_AGAIN_S", NEVER)
    ring.asked_s = -2.0 * NEVER
    async with client_with(service, "wrong") as client:
        for _ in range(5):
            await asyncio.gather(*(client.get(ROOM) for _ in range(20)))
    assert len(asked) == 1


async def test_many_stored_sessions_are_not_in_memory(service, clock):
    database = service.state.context.database
    number = create_key(database, "guest", Role.VIEWER).key.id
    with database.writing() as session:
        end = clock() + timedelta(days=1)
        rows = [{"digest": f"{i:064x}", "key_id": number, "expires_at": end} for i in range(5000)]
        session.execute(insert(BrowserSessionRow), rows)
    service.state.access.ring.refresh()
    assert len(service.state.access.ring._stored) == 1 + module.MOST_SESSIONS


# -- a machine that is made anew under an old id ---------------------------------------------


async def test_a_key_for_an_older_machine_of_its_id_is_none_for_the_new_one(
    service, beside, clock, furnished_url
):
    """Another service deletes it and makes it anew: this one knows the machine, not the keys."""
    database = service.state.context.database
    limited = made(database, "guest", "viewer", "mcfv5050")
    other = Context(beside, now=clock)
    async with client_with(service, limited) as client:
        path = f"{ROOM}/compensation"
        assert (await client.post(path, json=CONTENT)).status_code == 200
        machine = show_machine(other, "mcfv5050").machine
        delete_machine(other, "mcfv5050")
        clock.advance(1)
        create_machine(other, machine)
        DatabaseFollower(service.state.context, NEVER).look()
        found = problem(await client.post(path, json=CONTENT), 403)
        assert "an older machine 'mcfv5050'" in found["detail"]
        problem(await client.get(ROOM), 403)


async def test_the_log_of_an_older_machine_is_not_read_with_a_key_for_the_new_one(service, clock):
    context = service.state.context
    machine = show_machine(context, "mcfv5050").machine
    details = {"state": "stale"}
    with context.database.writing() as session:
        text = "of the old one"
        begin_passing(session, "mcfv5050", EventKind.ALARM, "stale", text, clock(), details)
    delete_machine(context, "mcfv5050")
    create_machine(context, machine)
    with context.database.writing() as session:
        text = "of the new one"
        begin_passing(session, "mcfv5050", EventKind.ALARM, "stale", text, clock(), details)
    secrets = {
        "new": made(context.database, "new", "viewer", "mcfv5050"),
        "all": made(context.database, "all", "viewer"),
    }
    texts = {}
    for name, secret in secrets.items():
        async with client_with(service, secret) as client:
            for path in ("/v1/events", f"{ROOM}/events"):
                events = (await client.get(path)).json()["events"]
                texts[name, path] = [e["text"] for e in events if e["machine"] == "mcfv5050"]
            page = (await client.get("/machines/mcfv5050")).text
            assert ("of the old one" in page) == (name == "all")
    new = ["of the new one", "machine created"]
    assert texts["new", "/v1/events"] == texts["new", f"{ROOM}/events"] == new
    assert texts["all", "/v1/events"][:2] == new
    assert "of the old one" in texts["all", "/v1/events"]


# -- streams ---------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/v1/stream", f"{ROOM}/compensation/stream"])
def test_an_idle_stream_ends_when_its_key_is_revoked_beside_the_service(furnished_url, clock, path):
    with closing(Database(furnished_url)) as beside:
        guest = made(beside, "guest", "viewer")
        with opened(furnished_url, clock, analyses=False, require_keys=True) as shop:
            headers = {"Authorization": f"Bearer {guest}"}
            with shop.follow(path, headers=headers, heartbeat_s=60) as stream:
                assert stream.until("status") is not None
                revoke_key(beside, "guest")
                while stream.next() is not None:
                    pass


def test_a_stream_tells_nothing_of_a_machine_made_anew_under_an_old_id(furnished_url, clock):
    with closing(Database(furnished_url)) as beside:
        both = made(beside, "boss", "admin")
        with opened(furnished_url, clock, analyses=False, require_keys=True) as shop:
            boss = {"Authorization": f"Bearer {both}"}
            shop("POST", "/v1/machines", json=MACHINE | {"id": "second"}, headers=boss)
            guest = made(beside, "guest", "viewer", "second", "mcfv5050")
            headers = {"Authorization": f"Bearer {guest}"}
            kinds = ["table", "status", "event"]
            shop.service.state.access.ring.refresh()
            with shop.follow("/v1/stream", headers=headers, kind=kinds) as stream:
                shop("DELETE", "/v1/machines/second", headers=boss)
                clock.advance(1)
                shop("POST", "/v1/machines", json=MACHINE | {"id": "second"}, headers=boss)
                shop("PATCH", "/v1/machines/second", json={"name": "New"}, headers=boss)
                shop("PATCH", ROOM, json={"name": "Last"}, headers=boss)
                told = []
                while (event := stream.until("event")).content["machine"] != "mcfv5050":
                    told.append(event.content["text"])
            assert told in ([], ["machine deleted"])


# -- rounds over HTTP ------------------------------------------------------------------------


@pytest.mark.slow
def test_of_ten_rounds_over_http_none_is_won(furnished_url, clock):
    """Half a request, then the key is revoked, then the rest; and a login in between."""
    with closing(Database(furnished_url)) as database:
        boss = {"Authorization": f"Bearer {made(database, 'boss', 'admin')}"}
        with opened(furnished_url, clock, analyses=False, require_keys=True) as shop:
            for i in range(10):
                guest = shop("POST", "/v1/keys", json=named("guest", "admin"), headers=boss)
                secret = guest.json()["secret"]
                viewer = shop("POST", "/v1/keys", json=named("viewer", "viewer"), headers=boss)
                body = orjson.dumps(named(f"won-{i}", "admin"))
                with half_sent(shop, "/v1/keys", body, secret) as rest:
                    shop("DELETE", "/v1/keys/guest", headers=boss)
                    assert rest().startswith(b"HTTP/1.1 401 ")
                logins = [threading.Thread(target=log_in, args=(shop, viewer, i))]
                logins[0].start()
                shop("DELETE", "/v1/keys/viewer", headers=boss)
                shop("POST", "/v1/keys", json=named("next", "admin"), headers=boss)
                logins[0].join(60.0)
                with database.reading() as session:
                    assert session.scalars(select(BrowserSessionRow)).all() == []
                shop("DELETE", "/v1/keys/next", headers=boss)
            assert [key.name for key in show_keys(database)] == ["boss"]


def named(name, role):
    return {"name": name, "role": role}


def log_in(shop, made_key, _round):
    url = str(shop._client.base_url)
    httpx.post(f"{url}/login", data={"key": made_key.json()["secret"]}, trust_env=False)


@contextmanager
def half_sent(shop, path, body, secret):
    """Send the head of a request and a byte of its body; what is given sends the rest."""
    url = urlsplit(str(shop._client.base_url))
    head = (
        f"POST {path} HTTP/1.1\r\nHost: {url.netloc}\r\nAuthorization: Bearer {secret}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    with socket.create_connection((url.hostname, url.port), timeout=60.0) as connection:
        connection.sendall(head.encode() + body[:1])

        def rest():
            connection.sendall(body[1:])
            return connection.recv(65536)

        yield rest
