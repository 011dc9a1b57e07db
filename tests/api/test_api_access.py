"""Keys: who has none is refused, each role may do what it is for, and on its machines only."""

import asyncio
import threading
from datetime import timedelta

import httpx
import pytest
from fastapi import Request
from sqlalchemy import func, select, update

from app.access import failures as module
from app.access.authorization import as_service
from app.access.failures import AT_MOST, WITHIN_S, Failures, source_of
from app.access.keys import Role, digest_of
from app.api.access import COOKIE, sees, viewer
from app.errors import StorageUnavailable
from app.services import access_keys
from app.services.access_keys import (
    BROWSER_LASTS,
    KeyFollower,
    create_key,
    revoke_key,
    show_keys,
)
from app.settings import Settings
from app.storage.access_keys import keys_by_digest
from app.storage.database import Database
from app.storage.tables import AccessKeyRow, EventRow
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    as_published,
    error_map,
    iso,
    problem,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio

CONTENT = {"temperatures_c": temperatures(25.0)}


@pytest.fixture
def guarded(new_app, furnished_url):
    """A service that asks for keys, and is told of changes by the tests."""
    return new_app(furnished_url, require_keys=True, refresh_s=3600)


def with_key(service, secret=None, **more):
    headers = {} if secret is None else {"Authorization": f"Bearer {secret}"}
    return httpx.AsyncClient(
        transport=httpx.ASGITransport(app=service, raise_app_exceptions=False),
        base_url="http://localhost",
        headers=headers,
        trust_env=False,
        event_hooks={"response": [as_published]},
        **more,
    )


def key(service, role, *machines):
    context = service.state.context
    name = f"{role}-{len(show_keys(context.database))}"
    made = create_key(context.database, name, Role(role), machines or None, context.now)
    return made.secret


def revoked(service, name):
    revoke_key(service.state.context.database, name)


REQUESTS = {
    "table": ("POST", f"{ROOM}/compensation", CONTENT),
    "read": ("GET", f"{ROOM}/error-maps", None),
    "reading": ("POST", f"{ROOM}/readings", reading(START, 25.0)),
    "map": ("POST", f"{ROOM}/error-maps", error_map("Run #9", 33.0)),
    "machine": ("PATCH", ROOM, {"name": "Another name"}),
    "keys": ("GET", "/v1/keys", None),
    "new key": ("POST", "/v1/keys", {"name": "line-3", "role": "viewer"}),
    "no key": ("DELETE", "/v1/keys/line-3", None),
}
MAY = {
    "sensor": {"reading"},
    "viewer": {"table", "read"},
    "metrologist": {"table", "read", "reading", "map"},
    "admin": set(REQUESTS),
}


@pytest.mark.parametrize("role", MAY)
async def test_each_role_may_do_what_it_is_for_and_nothing_else(guarded, role):
    async with with_key(guarded, key(guarded, role)) as client:
        for name, (method, path, content) in REQUESTS.items():
            answer = await client.request(method, path, json=content)
            if name in MAY[role]:
                assert answer.is_success, (name, answer.text)
            else:
                assert answer.status_code == 403, (name, answer.text)
                assert role in answer.json()["detail"] or "readings only" in answer.json()["detail"]


async def test_without_a_key_there_is_the_service_s_health_and_nothing_else(guarded):
    async with with_key(guarded) as client:
        for path in ("/healthz", "/readyz", "/login", "/favicon.ico", "/assets/dashboard.css"):
            # A service that has not begun is not ready: that is no matter of keys.
            assert (await client.get(path)).status_code in (200, 204, 503), path
        for method, path, content in REQUESTS.values():
            answer = await client.request(method, path, json=content)
            assert answer.status_code == 401
            assert answer.headers["WWW-Authenticate"] == "Bearer"
            assert "Authorization: Bearer KEY" in problem(answer, 401)["detail"]
        for path in ("/openapi.json", "/docs", "/metrics", "/v1/stream", "/v1/status", "/nothing"):
            assert (await client.get(path)).status_code == 401, path


async def test_a_key_for_one_machine_sees_and_changes_that_one_only(guarded):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        other = await admin.post("/v1/machines", json=MACHINE | {"id": "second", "name": "VMC-2"})
        assert other.status_code == 201
        assert len((await admin.get("/v1/machines")).json()) == 2
    async with with_key(guarded, key(guarded, "metrologist", "second")) as client:
        assert [m["id"] for m in (await client.get("/v1/machines")).json()] == ["second"]
        assert [m["machine"] for m in (await client.get("/v1/status")).json()] == ["second"]
        page = (await client.get("/")).text
        assert "VMC-2" in page
        assert "MCFV5050LN" not in page
        for path in (ROOM, f"{ROOM}/status", "/machines/mcfv5050", "/metrics"):
            assert (await client.get(path)).status_code == 403, path
        answer = await client.post(f"{ROOM}/readings", json=reading(START, 25.0))
        assert "is not for the machine 'mcfv5050'" in problem(answer, 403)["detail"]
        assert (await client.get("/v1/machines/second")).status_code == 200


async def test_a_key_for_a_machine_is_none_for_another_that_gets_its_id(guarded):
    admin = key(guarded, "admin")
    async with with_key(guarded, admin) as client:
        await client.post("/v1/machines", json=MACHINE | {"id": "second"})
        only = key(guarded, "viewer", "second")
        both = key(guarded, "viewer", "second", "mcfv5050")
        everywhere = key(guarded, "viewer")
        assert (await client.delete("/v1/machines/second")).status_code == 204
        await client.post("/v1/machines", json=MACHINE | {"id": "second"})
        kept = {k["name"]: k["machines"] for k in (await client.get("/v1/keys")).json()}
        texts = [e["text"] for e in (await client.get("/v1/events?kind=key")).json()["events"]]
    expected = {only: (401, 401), both: (403, 200), everywhere: (200, 200)}
    for secret, codes in expected.items():
        async with with_key(guarded, secret) as client:
            paths = ("/v1/machines/second", ROOM)
            assert tuple([(await client.get(path)).status_code for path in paths]) == codes
    assert kept == {"admin-0": None, "viewer-2": ["mcfv5050"], "viewer-3": None}
    assert "key 'viewer-1' revoked with its only machine, 'second'" in texts
    assert "key 'viewer-2' is no longer for 'second', which was deleted" in texts


async def test_what_an_older_version_left_is_no_key_to_a_new_machine(guarded):
    async with with_key(guarded, key(guarded, "admin")) as client:
        old = key(guarded, "viewer", "mcfv5050")
        with guarded.state.context.database.writing() as session:
            session.execute(
                update(AccessKeyRow)
                .where(AccessKeyRow.name == "viewer-1")
                .values(machines=["second"])
            )
        await client.post("/v1/machines", json=MACHINE | {"id": "second"})
        assert [k["name"] for k in (await client.get("/v1/keys")).json()] == ["admin-0"]
    async with with_key(guarded, old) as client:
        assert (await client.get("/v1/machines/second")).status_code == 401


async def test_no_way_of_writing_a_path_leads_past_what_a_key_may(guarded):
    """What routes take for one of theirs must not be another path to the keys."""
    async with with_key(guarded, key(guarded, "admin")) as client:
        made = await client.post("/v1/machines", json=MACHINE | {"id": "another"})
        assert made.status_code == 201, made.text
    own = key(guarded, "metrologist", "another")
    everywhere = key(guarded, "metrologist")
    async with with_key(guarded, own) as client:
        for way in (f"{ROOM}/error-maps", f"{ROOM}/compensation", "/metrics", "/machines/mcfv5050"):
            for end in ("%0A", "%0D%0A", "%0A%0A", "/%0A", "%00", "%7F"):
                problem(await client.get(way + end), 400)
            for other in (f"/{way}", way.upper(), f"{way}/", f"/x/..{way}", f"/%2e%2e{way}"):
                answer = await client.get(f"http://localhost{other}", follow_redirects=True)
                assert answer.status_code in (403, 404), other
        asked = await client.post(f"{ROOM}/compensation%0A", json=CONTENT)
        problem(asked, 400)
    async with with_key(guarded, everywhere) as client:
        problem(await client.post("/v1/machines%0A", json=MACHINE | {"id": "mine"}), 400)
        problem(await client.post("/v1/machines", json=MACHINE | {"id": "mine"}), 403)
        for method in ("DELETE", "PATCH", "delete", "Delete", "TRACE", "PROPFIND"):
            answer = await client.request(method, f"{ROOM}?access_token={own}", json={})
            assert answer.status_code in (400, 403, 405), method
    async with with_key(guarded) as client:
        told = await client.options(ROOM)
        assert (told.status_code, told.content) == (204, b"")
        for path in ("/openapi.json", "/docs", "/metrics", "/", "/assets%2f..%2fv1/machines"):
            for query in ("", f"?key={everywhere}", f"?access_token={everywhere}"):
                assert (await client.get(path + query)).status_code in (401, 404), path
                assert (await client.head(path + query)).status_code in (401, 404), path


async def test_cookies_and_credentials_of_others_do_not_hide_a_session(guarded):
    """Cookies are a computer's, whatever port they came from; a proxy may ask for a password."""
    secret = key(guarded, "viewer")
    async with with_key(guarded) as client:
        answer = await client.post("/login", data={"key": secret})
        assert answer.status_code == 303
        session = client.cookies[COOKIE]
    for cookies in (
        f'state={{"a": 1, "b": [2]}}; {COOKIE}={session}',
        f'bad[name]=x; {COOKIE}="{session}"; other',
        f"{COOKIE}={session}; a=b=c",
    ):
        for more in ({}, {"Authorization": "Basic c2hvcDpzaG9w"}):
            async with with_key(guarded) as client:
                answer = await client.get(f"{ROOM}/error-maps", headers={"Cookie": cookies} | more)
                assert answer.status_code == 200, (cookies, more)


async def test_a_revoked_key_is_none_any_more_and_uses_are_noted(guarded, clock):
    secret = key(guarded, "viewer")
    database = guarded.state.context.database
    async with with_key(guarded, secret) as client:
        assert (await client.get(ROOM)).status_code == 200
        clock.advance(90)
        assert (await client.get(ROOM)).status_code == 200
        guarded.state.access.ring.store_uses()
        assert show_keys(database)[0].last_used_at == START + timedelta(seconds=90)
        revoked(guarded, "viewer-0")
        assert (await client.get(ROOM)).status_code == 401


async def test_a_key_revoked_beside_an_idle_service_is_accepted_for_no_request_more(
    new_app, furnished_url
):
    service = new_app(furnished_url, require_keys=True, refresh_s=0.01)
    beside = Database(furnished_url)
    ring = service.state.access.ring
    secret = key(service, "viewer")
    async with service.router.lifespan_context(service), with_key(service, secret) as client:
        assert (await client.get(ROOM)).status_code == 200
        revoke_key(beside, "viewer-0")
        async with asyncio.timeout(60):
            while ring.find(digest_of(secret)) is not None:
                await asyncio.sleep(0.01)
        assert (await client.get(ROOM)).status_code == 401
    beside.close()


async def test_keys_follow_the_database_although_asking_fails_in_between(
    new_app, furnished_url, monkeypatch
):
    service = new_app(furnished_url, require_keys=True)
    ring = service.state.access.ring
    secret = key(service, "viewer")
    asked = []

    def fail(_session):
        asked.append(1)
        if len(asked) < 3:
            raise ZeroDivisionError
        return keys_by_digest(_session)

    monkeypatch.setattr(access_keys, "keys_by_digest", fail)
    follower = KeyFollower(ring, 0.01)
    follower.start()
    try:
        beside = Database(furnished_url)
        revoke_key(beside, "viewer-0")
        beside.close()
        async with asyncio.timeout(60):
            while ring.find(digest_of(secret)) is not None:
                await asyncio.sleep(0.01)
    finally:
        follower.stop()


async def test_who_has_a_key_does_not_wait_for_a_database_that_hangs(new_app, furnished_url):
    service = new_app(furnished_url, require_keys=True, refresh_s=0.001)
    secret = key(service, "viewer")
    held = threading.Event()
    service.state.access.ring.refresh = held.wait
    try:
        async with with_key(service, secret) as client, asyncio.timeout(60):
            for _ in range(3):
                answer = await client.post(f"{ROOM}/compensation", json=CONTENT)
                assert answer.status_code == 200
    finally:
        held.set()


# -- keys made over HTTP -------------------------------------------------------------------


async def test_an_admin_makes_a_key_that_is_shown_once_and_revokes_it(guarded, clock):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        stated = {"name": "line-3", "role": "viewer", "machines": ["mcfv5050", "mcfv5050"]}
        made = await admin.post("/v1/keys", json=stated)
        assert made.status_code == 201
        assert made.headers["Cache-Control"] == "no-store"
        assert made.headers["Location"] == "/v1/keys/line-3"
        secret, listed = made.json()["secret"], made.json()["key"]
        assert listed["machines"] == ["mcfv5050"]
        assert listed["last_used_at"] is None
        problem(await admin.post("/v1/keys", json=stated), 409)
        async with with_key(guarded, secret) as client:  # known at once, without a new look
            assert (await client.get(ROOM)).status_code == 200
            clock.advance(60)
            guarded.state.access.ring.store_uses()
            found = (await admin.get("/v1/keys")).json()
            assert [one["name"] for one in found] == ["admin-0", "line-3"]
            assert found[1]["last_used_at"] == iso(START)
            assert secret not in str(found)
            assert (await admin.delete("/v1/keys/line-3")).status_code == 204
            assert (await client.get(ROOM)).status_code == 401
        assert "there are: admin-0" in problem(await admin.delete("/v1/keys/line-3"), 404)["detail"]


async def test_who_made_and_revoked_a_key_stands_in_the_log(guarded):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        stated = {"name": "line-3", "role": "viewer", "machines": ["mcfv5050"]}
        await admin.post("/v1/keys", json=stated)
        await admin.delete("/v1/keys/line-3")
        revoked, made = (await admin.get("/v1/events?kind=key&limit=2")).json()["events"]
        assert made["who"].startswith("admin-0, ")
        assert made["text"] == "key 'line-3' made: viewer, for mcfv5050"
        assert made["details"] == {"key": "line-3", "role": "viewer", "machines": ["mcfv5050"]}
        assert revoked["who"].startswith("admin-0, ")
        assert revoked["details"] == {"key": "line-3"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"machines": []}, "one or more"),  # never to be read as all of them
        ({"machines": ["vmc"]}, "expected one of mcfv5050, got 'vmc'"),
        ({"role": "admin", "machines": ["mcfv5050"]}, "none for the role admin"),
        ({"role": "owner"}, "'metrologist'"),
        ({"name": "a/b"}, "1 to 64 letters"),
        ({"secret": "thermap_mine"}, "secret"),
    ],
)
async def test_a_key_that_cannot_be_is_not_made(guarded, changes, words):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        answer = await admin.post("/v1/keys", json={"name": "b", "role": "viewer"} | changes)
        assert words in problem(answer, 422)["detail"]
        assert len((await admin.get("/v1/keys")).json()) == 1


async def test_the_last_admin_locks_nobody_out_unasked(guarded):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        await admin.post("/v1/keys", json={"name": "second", "role": "admin"})
        await admin.post("/v1/keys", json={"name": "line-3", "role": "viewer"})
        assert (await admin.delete("/v1/keys/second")).status_code == 204
        refused = problem(await admin.delete("/v1/keys/admin-0"), 409)
        assert "the last key of an admin" in refused["detail"]
        assert "last_admin" in refused["detail"]
        assert (await admin.get("/v1/keys")).status_code == 200
        assert (await admin.delete("/v1/keys/admin-0?last_admin=true")).status_code == 204
        assert (await admin.get("/v1/keys")).status_code == 401


async def test_an_admin_s_key_for_one_machine_makes_no_wider_one(guarded):
    """None is made by thermap; one may stand in the database all the same."""
    limited = key(guarded, "admin")
    with guarded.state.context.database.writing() as session:
        session.execute(update(AccessKeyRow).values(machines=["mcfv5050"]))
    guarded.state.access.ring.refresh()
    async with with_key(guarded, limited) as client:
        assert (await client.get(ROOM)).status_code == 200
        for method, path, content in REQUESTS.values():
            if path.startswith("/v1/keys"):
                refused = problem(await client.request(method, path, json=content), 403)
                assert refused["detail"] == "expected a key for all machines, got one for some"


async def test_where_nobody_is_asked_for_a_key_nobody_makes_one(new_app, furnished_url):
    """It would still be one when the service is no longer open."""
    service = new_app(furnished_url)
    async with with_key(service) as client:
        for method, path, content in REQUESTS.values():
            if path.startswith("/v1/keys"):
                refused = problem(await client.request(method, path, json=content), 403)
                assert "--require-keys" in refused["detail"]
    assert show_keys(service.state.context.database) == []


async def test_the_key_itself_is_stored_nowhere(guarded):
    secret = key(guarded, "viewer")
    with guarded.state.context.database.engine.connect() as connection:
        stored = str(connection.exec_driver_sql("SELECT * FROM access_key").fetchall())
    assert secret not in stored
    assert secret.removeprefix("thermap_") not in stored


async def test_who_guesses_has_to_wait_and_who_has_a_key_has_not(guarded):
    right = key(guarded, "viewer")
    async with with_key(guarded) as client:
        for _ in range(AT_MOST):
            assert (await client.get(ROOM, headers=bearer("wrong"))).status_code == 401
        answer = await client.get(ROOM, headers=bearer("wrong"))
        assert problem(answer, 429)["title"] == "Too many wrong keys"
        assert 0 < int(answer.headers["Retry-After"]) <= WITHIN_S
        assert (await client.get(ROOM, headers=bearer(right))).status_code == 200


def bearer(secret):
    return {"Authorization": f"Bearer {secret}"}


async def test_wrong_keys_are_counted_however_they_are_stated(guarded):
    """In the header, as a session, at a page, which leads to /login, and there."""
    page = {"Accept": "text/html"}
    async with with_key(guarded) as client:
        asked = (
            lambda: client.get(ROOM, headers=bearer("wrong")),
            lambda: client.get("/", headers=bearer("wrong") | page),
            lambda: client.get(ROOM, headers={"Cookie": f"{COOKIE}=wrong"}),
            lambda: client.get("/", headers={"Cookie": f"{COOKIE}=wrong"} | page),
            lambda: client.post("/login", data={"key": "wrong"}),
        )
        codes = [(await ask()).status_code for ask in asked * 3]
    assert codes == [401, 303, 401, 303, 403] * 2 + [429] * 5


def test_ten_wrong_keys_are_taken_within_any_minute():
    failures = Failures()
    times_s = [30.0] + [59.0] * 9
    assert [failures.count("a", t) for t in times_s] == [0.0] * 10
    assert failures.count("a", 61.0) == 29.0
    assert failures.count("b", 61.0) == 0.0
    assert failures.count("a", 90.0) == 0.0
    assert failures.count("a", 91.0) == 28.0


def test_addresses_of_one_subscriber_are_counted_as_one():
    failures = Failures()
    waits = [failures.count(f"2001:db8:1:2::{i:x}", float(i)) for i in range(AT_MOST + 1)]
    assert waits == [0.0] * AT_MOST + [WITHIN_S - AT_MOST]
    assert failures.count("2001:db8:1:3::1", 11.0) == 0.0
    assert source_of("::ffff:192.0.2.7") == "192.0.2.7"


def test_addresses_without_end_fill_no_memory(monkeypatch):
    monkeypatch.setattr(module, "MOST_ADDRESSES", 3)
    failures = Failures()
    for i in range(50):
        failures.count(f"192.0.2.{i}", 0.0)
    assert len(failures._times_s) == 3


async def test_while_the_database_is_away_keys_go_on_as_they_were(guarded, monkeypatch):
    secret = key(guarded, "viewer")
    async with with_key(guarded, secret) as client:
        assert (await client.post(f"{ROOM}/compensation", json=CONTENT)).status_code == 200

        def away(*_asked, **_named):
            raise StorageUnavailable("the database is away")

        monkeypatch.setattr(Database, "reading", away)
        assert (await client.post(f"{ROOM}/compensation", json=CONTENT)).status_code == 200


@pytest.mark.parametrize(
    ("form", "status"),
    [
        ("key=" + "k" * 5000, 413),
        ("&".join(f"{name}=1" for name in "abcdefghi"), 422),
        ("a=%ff&b", 403),
    ],
)
async def test_a_form_that_nobody_sends_is_refused(guarded, form, status):
    async with with_key(guarded) as browser:
        headers = {"Content-Type": "application/x-www-form-urlencoded"}
        assert (await browser.post("/login", content=form, headers=headers)).status_code == status


async def test_a_browser_states_a_key_once(guarded, clock):
    secret = key(guarded, "viewer")
    async with with_key(guarded) as browser:
        answer = await browser.get("/machines/mcfv5050?x=EXX", headers={"Accept": "text/html"})
        assert answer.status_code == 303
        assert answer.headers["Location"] == "/login?next=/machines/mcfv5050%3Fx%3DEXX"
        wrong = await browser.post("/login", data={"key": "thermap_guess", "next": "/"})
        assert wrong.status_code == 403
        assert "This is no key" in wrong.text
        right = await browser.post("/login", data={"key": secret, "next": "//evil.example/"})
        assert right.status_code == 303
        assert right.headers["Location"] == "/"
        cookie = right.headers["Set-Cookie"]
        assert {"HttpOnly", "SameSite=strict"} <= set(cookie.split("; "))
        assert secret not in cookie
        assert (await browser.get("/machines/mcfv5050")).status_code == 200
        assert (await browser.patch(ROOM, json={"name": "x"})).status_code == 403
        clock.advance(BROWSER_LASTS.total_seconds() + 1)
        assert (await browser.get(ROOM)).status_code == 401


async def test_a_browser_is_forgotten_on_demand_and_with_its_key(guarded):
    secret = key(guarded, "viewer")
    async with with_key(guarded) as browser:
        await browser.post("/login", data={"key": secret})
        session = browser.cookies[COOKIE]
        assert (await browser.get(ROOM)).status_code == 200
        await browser.post("/logout")
        stale = {"Cookie": f"{COOKIE}={session}"}
        assert (await browser.get(ROOM, headers=stale)).status_code == 401
        await browser.post("/login", data={"key": secret})
        assert "was revoked" not in (await client_page(browser, "/machines/mcfv5050"))
        revoked(guarded, "viewer-0")
        assert (await browser.get(ROOM)).status_code == 401
        # The page that asks for a key says why it does so again.
        for path in ("/machines/mcfv5050", "/fleet", "/"):
            assert "was revoked" in await client_page(browser, path)


async def client_page(browser, path):
    answer = await browser.get(path, headers={"Accept": "text/html"}, follow_redirects=True)
    assert answer.status_code == 200
    return answer.text


async def test_another_page_cannot_use_a_browser_s_session(guarded):
    secret = key(guarded, "admin")
    async with with_key(guarded) as browser:
        await browser.post("/login", data={"key": secret})
        foreign = {"Origin": "https://evil.example", "Sec-Fetch-Site": "cross-site"}
        assert (await browser.delete(ROOM, headers=foreign)).status_code == 403
        sent = await browser.post("/login", data={"key": secret}, headers=foreign)
        assert sent.status_code == 403


async def test_what_a_stream_may_send_is_looked_at_for_each_event(guarded):
    async with with_key(guarded, key(guarded, "admin")) as admin:
        await admin.post("/v1/machines", json=MACHINE | {"id": "second"})
        who, request = await viewer_of(guarded, key(guarded, "viewer", "mcfv5050", "second"))
        assert [sees(request)(m) for m in ("mcfv5050", "second", "third")] == [True, True, False]
        assert [who.sees(m) for m in ("mcfv5050", "second", "third")] == [True, True, False]
        before = newest_entry(guarded)
        await admin.delete("/v1/machines/second")
        await admin.post("/v1/machines", json=MACHINE | {"id": "second"})
        assert who.is_welcome()
        assert [who.sees(m) for m in ("mcfv5050", "second", "third")] == [True, False, False]
        after = newest_entry(guarded)
        assert before < after
        assert not who.sees_entry("second", after)
        assert not who.sees_entry(None, after)
        assert who.sees_entry("mcfv5050", after)
        new, _ = await viewer_of(guarded, key(guarded, "viewer", "second"))
        assert new.sees("second")
        assert not new.sees_entry("second", before)
        assert new.sees_entry("second", after)
        revoked(guarded, "viewer-1")
        assert not who.is_welcome()
        assert not who.sees("mcfv5050")
        assert not who.sees_entry("mcfv5050", after)


async def viewer_of(service, secret):
    scope = {
        "type": "http",
        "method": "GET",
        "path": "/v1/stream",
        "headers": [(b"authorization", f"Bearer {secret}".encode())],
        "app": service,
        "state": {},
    }
    service.find_route(scope)
    with as_service():
        assert await service.state.access.refusal(scope) is None
    request = Request(scope)
    return viewer(request), request


def newest_entry(service):
    with service.state.context.database.reading() as session:
        return session.scalar(select(func.max(EventRow.number)))


async def test_eight_at_once_with_a_new_key_are_all_let_in(new_app, furnished_url):
    service = new_app(furnished_url, require_keys=True, refresh_s=3600)
    async with with_key(service, key(service, "viewer")) as client:
        answers = await asyncio.gather(*(client.get(ROOM) for _ in range(8)))
        assert [answer.status_code for answer in answers] == [200] * 8


@pytest.mark.parametrize(
    ("options", "asks"),
    [
        ({}, False),
        ({"host": "localhost"}, False),
        ({"host": "::1"}, False),
        ({"require_keys": True}, True),
        ({"host": "0.0.0.0"}, True),
        ({"host": "192.0.2.7"}, True),
        ({"host": "shop.example"}, True),
        ({"host": "0.0.0.0", "insecure": True}, False),
    ],
)
def test_keys_are_asked_for_where_other_computers_reach_the_service(options, asks):
    assert Settings(**options).asks_for_keys is asks


def test_every_route_says_who_may_use_it(guarded):
    """What nobody named is for viewers where it reads, for metrologists where it may write."""
    of_role, of_all_machines = {}, set()
    for route in guarded.router.routes:
        assert "access" in vars(route), route.path
        for method in getattr(route, "methods", None) or ["GET"]:
            of_role.setdefault(route.access.role, set()).add(f"{method} {route.path}")
        if route.access.all_machines:
            of_all_machines.add(route.path)
        if "/machines/{" in route.path:
            assert "/machines/{machine}" in route.path  # a key for some is asked for by that name
    assert of_role[Role.SENSOR] == {"POST /v1/machines/{machine}/readings"}
    assert of_role[Role.ADMIN] == {
        "POST /v1/machines",
        "PATCH /v1/machines/{machine}",
        "DELETE /v1/machines/{machine}",
        "GET /v1/keys",
        "POST /v1/keys",
        "DELETE /v1/keys/{name}",
    }
    assert not [name for name in of_role[Role.METROLOGIST] if name.startswith("GET ")]
    of_machine = "POST /v1/machines/{machine}"
    assert {name for name in of_role[Role.VIEWER] if not name.startswith("GET ")} == {
        "POST /v1/controllers/{controller}/parse",
        "POST /v1/fleet/tried-effects",
        "POST /v1/volumetric-accuracy/from-lines",
        f"{of_machine}/analyses/plan",
        f"{of_machine}/compensation",
        f"{of_machine}/compensation/compare",
        f"{of_machine}/compensation/export",
        f"{of_machine}/compensation/grid",
        f"{of_machine}/compensation/levels",
        f"{of_machine}/measurements/step-diagonal/simulate",
        f"{of_machine}/models/compare",
        f"{of_machine}/picture",
        f"{of_machine}/predictions",
        f"{of_machine}/residuals",
        f"{of_machine}/rotary-axis-error",
        f"{of_machine}/sensor-assignment/correlate",
        f"{of_machine}/volumetric-accuracy",
        f"{of_machine}/volumetric-error",
    }
    assert of_role[None] == {
        "GET /assets",
        "GET /docs-assets",
        "GET /favicon.ico",
        "GET /healthz",
        "GET /login",
        "GET /readyz",
        "POST /login",
        "POST /logout",
    }
    assert of_all_machines == {
        "/fleet",
        "/metrics",
        "/v1/fleet",
        "/v1/fleet/analyses",
        "/v1/fleet/analyses/cancel",
        "/v1/fleet/tried-effects",
        "/v1/keys",
        "/v1/keys/{name}",
    }


async def test_a_route_that_says_nothing_is_for_admins_alone(guarded):
    guarded.get("/unstated")(lambda: "")
    for role, status in (("viewer", 403), ("metrologist", 403), ("admin", 200)):
        async with with_key(guarded, key(guarded, role)) as client:
            assert (await client.get("/unstated")).status_code == status


async def test_a_page_offers_nobody_what_is_refused_him(guarded):
    writing = {
        "/machines/mcfv5050/maps": ("data-activate", 'id="choose"'),
        "/machines/mcfv5050/loop": ('id="file"',),
    }
    shown = {}
    async with with_key(guarded, key(guarded, "metrologist")) as client:
        for label, t_c in (("again", 41.0), ("and again", 43.0)):
            stored = await client.post(f"{ROOM}/error-maps", json=error_map(label, t_c))
            assert stored.status_code == 201
    for role in ("viewer", "metrologist"):
        async with with_key(guarded, key(guarded, role)) as client:
            shown[role] = {path: (await client.get(path)).text for path in writing}
    for path, marks in writing.items():
        for mark in marks:
            assert mark in shown["metrologist"][path], (path, mark)
            assert mark not in shown["viewer"][path], (path, mark)
        assert "Reads only" in shown["viewer"][path]
        assert "Log out" in shown["viewer"][path]


async def test_a_key_for_one_machine_is_not_led_to_the_page_of_all(guarded):
    for machines, is_led in ((("mcfv5050",), False), ((), True)):
        async with with_key(guarded, key(guarded, "viewer", *machines)) as client:
            assert ('href="/fleet"' in await client_page(client, "/")) == is_led
            answer = await client.get("/fleet", headers={"Accept": "text/html"})
            assert answer.headers["Content-Type"].startswith("text/html")
            assert answer.status_code == (200 if is_led else 403)
