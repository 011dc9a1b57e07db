"""Bodies over the limit: refused before they fill the memory, on every path."""

import pytest

from app.api.bodies import USUAL_LIMIT
from tests.service_examples import ROOM, client_of, contents, problem

pytestmark = pytest.mark.anyio

LIMIT = 8192
JSON = {"content-type": "application/json"}
TEMPERATURES = b'{"temperatures_c": {"x-middle": 25.0, "z-column": 27.0}}'


@pytest.fixture
def small_app(new_app, furnished_url):
    return new_app(furnished_url, max_body_bytes=LIMIT)


@pytest.fixture
async def small(small_app):
    async with client_of(small_app) as client:
        yield client


PATHS = [
    ("POST", "/v1/machines"),
    ("PATCH", ROOM),
    ("POST", f"{ROOM}/error-maps"),
    ("POST", f"{ROOM}/readings"),
    ("PUT", f"{ROOM}/sensor-assignment"),
    ("POST", f"{ROOM}/compensation"),
    ("POST", f"{ROOM}/predictions"),
]


FILES = [f"{ROOM}/files?kind=map", f"{ROOM}/files?kind=check"]


@pytest.mark.parametrize("path", FILES)
async def test_files_over_the_limit_and_of_other_kinds(small, small_app, path):
    before = contents(small_app)
    sent = 0

    async def pieces():
        nonlocal sent
        for _ in range(1000):
            sent += 1024
            yield b" " * 1024

    csv = {"content-type": "text/csv"}
    found = problem(await small.post(path, content=pieces(), headers=csv), 413)
    assert f"{LIMIT} bytes" in found["detail"]
    assert sent <= 2 * LIMIT
    found = problem(await small.post(path, content=b"1", headers=JSON), 415)
    assert "text/csv" in found["detail"]
    assert contents(small_app) == before


@pytest.mark.parametrize(("method", "path"), PATHS)
async def test_a_stated_length_over_the_limit(small, small_app, method, path):
    before = contents(small_app)
    body = TEMPERATURES + b" " * LIMIT
    found = problem(await small.request(method, path, content=body, headers=JSON), 413)
    assert f"{LIMIT} bytes" in found["detail"]
    assert contents(small_app) == before


@pytest.mark.parametrize(("method", "path"), PATHS)
async def test_pieces_without_a_stated_length_over_the_limit(small, small_app, method, path):
    before = contents(small_app)
    sent = 0

    async def pieces():
        nonlocal sent
        yield TEMPERATURES
        for _ in range(1000):
            sent += 1024
            yield b" " * 1024

    found = problem(await small.request(method, path, content=pieces(), headers=JSON), 413)
    assert f"{LIMIT} bytes" in found["detail"]
    assert contents(small_app) == before


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("POST", "/v1/nowhere", 404),
        ("POST", "/v1/machines/nobody/compensation", 413),
        ("DELETE", "/v1/machines", 405),
        ("GET", ROOM, 422),
        ("DELETE", ROOM, 422),
        ("POST", f"{ROOM}/models/1/activate", 422),
        ("POST", f"{ROOM}/sensor-assignment/correlate", 422),
    ],
)
async def test_where_nobody_reads_a_body_it_is_refused(small, small_app, method, path, status):
    before = contents(small_app)
    sent = 0

    async def pieces():
        nonlocal sent
        for _ in range(100):
            sent += 1024
            yield b" " * 1024

    problem(await small.request(method, path, content=b" " * (LIMIT + 1), headers=JSON), status)
    problem(await small.request(method, path, content=pieces(), headers=JSON), status)
    assert sent <= LIMIT + 1024 if status == 413 else sent == 0
    assert contents(small_app) == before


@pytest.mark.parametrize("path", [f"{ROOM}/models/1/activate"])
async def test_an_empty_body_is_none(client, path):
    for headers in ({}, {"content-length": "0"}, JSON):
        assert (await client.post(path, content=b"", headers=headers)).status_code == 200


@pytest.mark.slow
async def test_each_route_has_a_limit_of_its_own(client):
    """The usual one is published as what it is by those that have another."""
    document = (await client.get("/openapi.json")).json()
    for path, method in [("/compensation", "post"), ("/readings", "post")]:
        operation = document["paths"]["/v1/machines/{machine}" + path][method]
        limit = operation.get("x-largest-body-bytes", USUAL_LIMIT)
        headers = JSON | {"content-length": str(limit + 1)}
        found = problem(await client.post(ROOM + path, content=b"{}", headers=headers), 413)
        assert f"{limit} bytes" in found["detail"]


@pytest.mark.parametrize("length", ["-1", "many", "", "1e3", str(10**30)])
async def test_a_length_that_is_none_does_not_get_a_body_past_the_limit(small, length):
    body = TEMPERATURES + b" " * LIMIT
    headers = JSON | {"content-length": length}
    answer = await small.post(f"{ROOM}/compensation", content=body, headers=headers)
    problem(answer, 413)


async def test_a_body_at_the_limit_is_taken(small):
    body = TEMPERATURES + b" " * (LIMIT - len(TEMPERATURES))

    async def pieces():
        yield body[: LIMIT // 2]
        yield body[LIMIT // 2 :]

    for content in (body, pieces()):
        answer = await small.post(f"{ROOM}/compensation", content=content, headers=JSON)
        assert answer.status_code == 200


async def test_refusals_are_counted(small):
    await small.post(f"{ROOM}/compensation", content=b" " * (LIMIT + 1), headers=JSON)
    text = (await small.get("/metrics")).text
    assert 'status="413"' in text
