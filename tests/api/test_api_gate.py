"""Whom the service answers: its own hosts, and no write that another web page sent."""

import socket

import pytest

from app.api.gate import Gate
from app.settings import Settings
from tests.service_examples import ROOM, client_of, contents, furnish_database, problem

pytestmark = pytest.mark.anyio


@pytest.fixture
def furnished_url(databases):
    """None of this depends on the database."""
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


WRITES = [
    ("POST", f"{ROOM}/models/1/activate", None),
    ("POST", f"{ROOM}/compensation", {"temperatures_c": {"x-middle": 21.0}}),
    ("PATCH", ROOM, {"name": "taken over"}),
    ("PUT", f"{ROOM}/sensor-assignment", {"EXX": "spindle"}),
    ("DELETE", ROOM, None),
]
FOREIGN = {
    "another site": {"origin": "http://evil.example", "sec-fetch-site": "cross-site"},
    "an old browser": {"origin": "http://evil.example"},
    "a sister site": {"sec-fetch-site": "same-site"},
    "no origin": {"sec-fetch-site": "cross-site"},
    "a file": {"origin": "null"},
    "another port": {"origin": "http://localhost:8080"},
    "a name that begins alike": {"origin": "http://localhost.evil.example"},
    "an extension": {"origin": "moz-extension://localhost"},
    "nothing": {"origin": ""},
}
OWN = {
    "a program": {},
    "its own page": {"origin": "http://localhost", "sec-fetch-site": "same-origin"},
    "its own page, old browser": {"origin": "http://LOCALHOST"},
    "behind a proxy that ends TLS": {"origin": "https://localhost"},
    "typed": {"sec-fetch-site": "none"},
}


@pytest.mark.parametrize(("method", "path", "body"), WRITES)
async def test_what_another_page_sends_changes_nothing(app, client, method, path, body):
    before = contents(app)
    for headers in FOREIGN.values():
        found = problem(await client.request(method, path, json=body, headers=headers), 403)
        assert "--allowed-host" in found["detail"]
    assert contents(app) == before


async def test_programs_and_own_pages_may_write(client):
    for case, headers in OWN.items():
        answer = await client.post(f"{ROOM}/models/1/activate", headers=headers)
        assert answer.status_code == 200, case


async def test_reading_is_left_to_the_browsers_own_rule(client):
    for headers in FOREIGN.values():
        answer = await client.get(ROOM, headers=headers)
        assert answer.status_code == 200
        assert not [name for name in answer.headers if name.startswith("access-control")]


GOOD_HOSTS = [
    "localhost",
    "LocalHost:8000",
    "localhost.",
    "thermap.localhost:8000",
    "127.0.0.1:8000",
    "192.168.7.20",
    "[::1]:8000",
    "[fe80::1]",
    socket.gethostname(),
]
BAD_HOSTS = [
    "evil.example",
    "evil.example:8000",
    "localhost.evil.example",
    "127.0.0.1.evil.example",
    "127.0.0.1@evil.example",
    "notlocalhost",
    "[::1",
    "[evil.example]",
    "localhost:80:80",
    "",
]


async def test_hosts_that_no_page_can_point_elsewhere(client):
    for host in GOOD_HOSTS:
        answer = await client.get("/healthz", headers={"host": host})
        assert answer.status_code == 200, host


@pytest.mark.parametrize("path", ["/v1/machines", f"{ROOM}/compensation", "/healthz", "/docs"])
async def test_a_foreign_host_is_refused_on_every_path(client, path):
    for host in BAD_HOSTS:
        found = problem(await client.get(path, headers={"host": host}), 421)
        assert "--allowed-host" in found["detail"]


async def test_a_foreign_host_is_refused_a_table_too(client):
    body = {"temperatures_c": {"x-middle": 21.0}}
    answer = await client.post(f"{ROOM}/compensation", json=body, headers={"host": "evil.example"})
    problem(answer, 421)
    assert 'status="421"' in (await client.get("/metrics")).text


@pytest.mark.parametrize(
    ("allowed", "host", "status"),
    [
        ("thermap.shop", "thermap.shop:443", 200),
        ("thermap.shop", "other.shop", 421),
        ("a.example, *.shop", "thermap.shop", 200),
        ("*.shop", "shop", 421),
        ("*", "anything.example", 200),
    ],
)
async def test_an_operator_allows_names(new_app, furnished_url, allowed, host, status):
    async with client_of(new_app(furnished_url, allowed_hosts=allowed)) as client:
        answer = await client.get("/v1/machines", headers={"host": host})
        assert answer.status_code == status


async def test_a_proxy_may_state_its_own_address_as_the_host(new_app, furnished_url):
    async with client_of(new_app(furnished_url, allowed_hosts=["thermap.shop"])) as client:
        for origin, status in [("https://thermap.shop", 200), ("https://other.shop", 403)]:
            headers = {"origin": origin, "host": "127.0.0.1:8000"}
            answer = await client.post(f"{ROOM}/models/1/activate", headers=headers)
            assert answer.status_code == status


def test_several_hosts_and_none():
    gate = Gate("127.0.0.1")
    own = (b"host", b"localhost")
    assert gate.refusal({"method": "GET", "headers": [own, own]}).status_code == 400
    assert gate.refusal({"method": "GET", "headers": []}) is None


PAGES = ["/docs", f"{ROOM}/picture?missing_components=zero"]


@pytest.mark.parametrize("path", PAGES)
async def test_pages_run_their_own_scripts_alone_and_in_no_frame(client, path, clock):
    body = {"time": clock().isoformat(), "temperatures_c": {"x-middle": 21.0, "z-column": 23.0}}
    assert (await client.post(f"{ROOM}/readings", json=body)).status_code == 201
    page = await client.get(path, headers={"accept": "text/html"})
    assert page.headers["content-type"].startswith("text/html")
    is_page(page)


def is_page(page):
    """Check a page's headers."""
    policy = dict(
        part.split(maxsplit=1) for part in page.headers["content-security-policy"].split(";")
    )
    assert policy["default-src"] == "'none'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in policy["script-src"]
    assert "sha256-" in policy["script-src"]
    assert page.headers["x-frame-options"] == "DENY"
    assert page.headers["x-content-type-options"] == "nosniff"
    assert page.headers["referrer-policy"] == "no-referrer"


METHODS = [
    ("/v1/machines", {"GET", "HEAD", "OPTIONS", "POST"}),
    (ROOM, {"GET", "HEAD", "OPTIONS", "PATCH", "DELETE"}),
    (f"{ROOM}/compensation", {"GET", "HEAD", "OPTIONS", "POST"}),
    (f"{ROOM}/sensor-assignment", {"GET", "HEAD", "OPTIONS", "PUT"}),
    (f"{ROOM}/models/1/activate", {"OPTIONS", "POST"}),
    ("/healthz", {"GET", "HEAD", "OPTIONS"}),
    ("/docs", {"GET", "HEAD", "OPTIONS"}),
]


async def test_all_methods_of_a_path_are_named(client):
    for path, methods in METHODS:
        options = await client.options(path)
        refused = await client.request("LOCK", path)
        assert options.status_code == 204
        assert options.content == b""
        problem(refused, 405)
        for answer in (options, refused):
            assert set(answer.headers["allow"].split(", ")) == methods, path
    problem(await client.options("/v1/nowhere"), 404)


@pytest.mark.slow
async def test_head_says_what_get_says_but_for_the_body(client):
    paths = ["/v1/machines", ROOM, f"{ROOM}/models", "/healthz", "/docs", "/openapi.json", "/"]
    for path in paths:
        same = {"X-Request-ID": "one"}  # else each has a number of its own
        get, head = await client.get(path, headers=same), await client.head(path, headers=same)
        assert head.status_code == get.status_code
        assert head.headers == get.headers
        assert head.content == b""


async def test_head_where_there_is_nothing_to_get(client):
    answer = await client.head(f"{ROOM}/models/1/activate")
    assert answer.status_code == 405
    assert answer.content == b""
    assert (await client.head("/v1/nowhere")).status_code == 404


MES = "https://mes.example.org"


async def test_a_site_that_is_named_may_read_and_write_and_no_other(new_app, furnished_url):
    async with client_of(new_app(furnished_url, cors_origins=MES)) as client:
        asked = {"Access-Control-Request-Method": "POST", "Origin": MES}
        asked |= {"Access-Control-Request-Headers": "authorization, content-type"}
        preflight = await client.options(f"{ROOM}/compensation", headers=asked)
        assert preflight.status_code == 200
        assert preflight.headers["Access-Control-Allow-Origin"] == MES
        sent = {"Origin": MES, "Sec-Fetch-Site": "cross-site"}
        body = {"temperatures_c": {"x-middle": 21.0, "z-column": 23.0}}
        answer = await client.post(f"{ROOM}/compensation", json=body, headers=sent)
        assert answer.status_code == 200
        assert answer.headers["Access-Control-Allow-Origin"] == MES
        assert "Access-Control-Allow-Credentials" not in answer.headers
        assert (await client.patch(ROOM, json={"name": "n"}, headers=sent)).status_code == 200
        other = sent | {"Origin": "https://evil.example"}
        read = await client.get(ROOM, headers=other)
        assert "Access-Control-Allow-Origin" not in read.headers
        problem(await client.patch(ROOM, json={"name": "n"}, headers=other), 403)
    async with client_of(new_app(furnished_url)) as client:
        read = await client.get(ROOM, headers={"Origin": MES})
        assert "Access-Control-Allow-Origin" not in read.headers


@pytest.mark.parametrize("origin", ["*", "mes.example.org", "https://a/b", "https://", "null"])
def test_origins_are_stated_exactly(origin):
    with pytest.raises(ValueError, match="https://NAME"):
        Settings(cors_origins=origin)
