"""The database goes away and comes back: PostgreSQL behind a wire that is cut and mended."""

import asyncio
from datetime import timedelta
from time import monotonic

import pytest
from sqlalchemy import make_url

from app.errors import StorageUnavailable
from app.main import create_app
from app.settings import Settings
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    error_map,
    problem,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio

PATIENCE_S = 60.0
"""A machine may be slow, but nothing hangs."""

STATED = {"temperatures_c": temperatures(25.5)}


@pytest.fixture
async def client(wired):
    async with client_of(wired) as client:
        await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
        yield client


async def in_time(request):
    started = monotonic()
    answer = await request
    assert monotonic() - started < PATIENCE_S
    return answer


async def test_the_live_table_goes_on_from_memory_and_says_so(wired, wire, client, clock):
    before = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    assert before["warnings"] == []
    clock.advance(5)
    wire.cut()
    wired.follower.look()
    clock.advance(40)
    answer = await in_time(client.post(f"{ROOM}/compensation", json=STATED))
    assert answer.status_code == 200
    during = answer.json()
    assert during["components"] == before["components"]
    (warning,) = during["warnings"]
    assert "away for 40 s" in warning
    assert "model version 3" in warning
    assert "for 45 s" in warning  # how long the model has been in memory

    answer = await in_time(client.get(f"{ROOM}/compensation"))
    assert answer.status_code == 200
    assert any("away for 40 s" in w for w in answer.json()["warnings"])

    wire.mend()
    wired.follower.look()
    after = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    assert after["warnings"] == []


async def test_the_etag_changes_when_the_database_goes_and_comes(wired, wire, client):
    tags = [(await client.get(f"{ROOM}/compensation")).headers["etag"]]
    for change in (wire.cut, wire.mend):
        change()
        wired.follower.look()
        answer = await client.get(f"{ROOM}/compensation", headers={"If-None-Match": tags[-1]})
        assert answer.status_code == 200
        tags.append(answer.headers["etag"])
    assert tags[0] == tags[2]


REQUESTS = {
    "reading": ("POST", f"{ROOM}/readings", reading(START - timedelta(seconds=60), 25.0)),
    "map": ("POST", f"{ROOM}/error-maps", error_map("Run #9", 40.0)),
    "machine": ("POST", "/v1/machines", MACHINE | {"id": "new"}),
    "patch": ("PATCH", ROOM, {"name": "new"}),
    "assignment": ("PUT", f"{ROOM}/sensor-assignment", {"EXX": "spindle"}),
    "activate": ("POST", f"{ROOM}/models/2/activate", None),
    "delete": ("DELETE", ROOM, None),
    "machines": ("GET", "/v1/machines", None),
    "readings": ("GET", f"{ROOM}/readings", None),
    "models": ("GET", f"{ROOM}/models", None),
    "unknown machine": ("GET", "/v1/machines/nobody/compensation", None),
    "predictions": (
        "POST",
        f"{ROOM}/predictions",
        {"observations": [{"time": "2026-03-01T06:00:00Z", "component": "SXY"}]},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("look_first", [True, False], ids=["noticed", "not noticed yet"])
async def test_what_needs_the_database_is_503_until_it_is_back(wired, wire, client, look_first):
    table = (await client.post(f"{ROOM}/compensation", json=STATED)).json()
    wire.cut()
    if look_first:
        wired.follower.look()
    answers = await asyncio.gather(
        *(in_time(client.request(m, path, json=body)) for m, path, body in REQUESTS.values())
    )
    for name, answer in zip(REQUESTS, answers, strict=True):
        found = problem(answer, 503)
        assert found["title"] == "The database is away", name
        assert "database is away" in found["detail"]
        assert int(answer.headers["retry-after"]) > 0
    assert (await client.get("/healthz")).status_code == 200

    wire.mend()
    listed = await in_time(client.get("/v1/machines"))
    assert [m["id"] for m in listed.json()] == ["mcfv5050"]  # nothing was half done
    assert listed.json()[0]["active_model"] == 3
    wired.follower.look()
    assert (await client.post(f"{ROOM}/compensation", json=STATED)).json() == table
    expected = {"machine": 201, "map": 201, "reading": 201, "unknown machine": 404, "delete": 204}
    for name, (method, path, body) in sorted(REQUESTS.items(), key=lambda r: r[0] == "delete"):
        answer = await in_time(client.request(method, path, json=body))
        assert answer.status_code == expected.get(name, 200), (name, answer.text)


async def test_readiness_follows_the_database(wired, wire, client):
    assert (await client.get("/readyz")).status_code == 200
    wire.cut()
    answer = await in_time(client.get("/readyz"))
    assert answer.status_code == 503
    assert answer.json()["status"] == "not-ready"
    assert "away" in answer.json()["database"]
    wired.follower.look()
    assert "thermap_database_away 1.0" in (await client.get("/metrics")).text
    wire.mend()
    assert (await in_time(client.get("/readyz"))).status_code == 200
    wired.follower.look()
    assert "thermap_database_away 0.0" in (await client.get("/metrics")).text


async def test_what_others_stored_meanwhile_is_there_when_the_database_is_back(
    wired, wire, client, new_app, clock
):
    direct = make_url(wire.url).set(port=wire._target[1]).render_as_string(False)
    wire.cut()
    wired.follower.look()
    clock.advance(10)
    async with client_of(new_app(direct)) as other:
        await other.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
        await other.post(f"{ROOM}/readings", json=reading(clock.time, 26.0))
    assert (await client.post(f"{ROOM}/compensation", json=STATED)).json()["model_version"] == 3
    wire.mend()
    wired.follower.look()
    document = (await client.get(f"{ROOM}/compensation")).json()
    assert document["model_version"] == 4
    assert document["reading_age_s"] == 0
    assert document["warnings"] == []


@pytest.mark.slow
async def test_the_service_itself_notices_and_recovers_without_a_restart(wired, wire, clock):
    """With the follower's own thread, as the service runs it."""
    async with client_of(wired) as client, wired.router.lifespan_context(wired):
        await _until(client, "thermap_machines_in_memory 1.0")
        wire.cut()
        await _until(client, "thermap_database_away 1.0")
        assert (await client.post(f"{ROOM}/compensation", json=STATED)).json()["warnings"]
        wire.mend()
        await _until(client, "thermap_database_away 0.0")
        assert (await client.post(f"{ROOM}/compensation", json=STATED)).json()["warnings"] == []


async def _until(client, line):
    deadline = monotonic() + PATIENCE_S
    while line not in (await client.get("/metrics")).text:
        assert monotonic() < deadline, f"{line} does not come"
        await asyncio.sleep(0.05)


def test_a_service_does_not_start_without_its_database(wire):
    wire.cut()
    started = monotonic()
    with pytest.raises(StorageUnavailable, match="away"):
        create_app(Settings(database_url=wire.url))
    assert monotonic() - started < PATIENCE_S
