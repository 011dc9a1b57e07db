"""Whether the service is well, over HTTP, and what it says of itself."""

import re

import pytest

import app as package
from app.services.follow_database import DatabaseFollower
from tests.service_examples import ROOM, client_of, problem

pytestmark = pytest.mark.anyio


async def test_the_process_lives(client):
    answer = await client.get("/healthz")
    assert answer.status_code == 200
    assert answer.json() == {"status": "ok", "version": package.__version__}


async def test_ready_when_every_machine_is_in_memory(app, client):
    answer = await client.get("/readyz")
    assert answer.status_code == 503
    expected = {"status": "not-ready", "database": "ok", "machines": 1, "machines_in_memory": 0}
    found = answer.json()
    free = found.pop("disk_free_bytes")
    assert (free is None) == (not app.state.context.database.is_sqlite)
    assert found == expected
    DatabaseFollower(app.state.context, every_s=1.0).look()
    answer = await client.get("/readyz")
    assert answer.status_code == 200
    assert answer.json().items() >= {"status": "ready", "machines_in_memory": 1}.items()


async def test_an_empty_service_is_ready(empty):
    assert (await empty.get("/readyz")).status_code == 200


async def test_starting_the_service_brings_the_machines_into_memory(app, client):
    async with app.router.lifespan_context(app):
        for _ in range(200):
            answer = await client.get("/readyz")
            if answer.status_code == 200:
                break
    assert answer.json()["machines_in_memory"] == 1


def counted(text, route, method, status):
    pattern = (
        rf'thermap_requests_total{{method="{method}",route="{re.escape(route)}",'
        rf'status="{status}"}} ([0-9.]+)'
    )
    found = re.search(pattern, text)
    return float(found[1]) if found else 0.0


async def test_requests_are_counted_by_their_routes_pattern(client):
    table = f"{ROOM}/compensation"
    for _ in range(3):
        await client.post(table, json={"temperatures_c": {"x-middle": 25, "z-column": 25}})
    await client.post(table, json={"temperatures_c": {"x-middle": None}})
    await client.get("/v1/machines/nobody/compensation")
    await client.get("/wp-admin.php")
    await client.get("/another/" + "x" * 100)
    answer = await client.get("/metrics")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/plain")
    text = answer.text
    pattern = "/v1/machines/{machine}/compensation"
    assert counted(text, pattern, "POST", 200) == 3
    assert counted(text, pattern, "POST", 422) == 1
    assert counted(text, pattern, "GET", 404) == 1
    assert counted(text, "unknown", "unknown", 404) == 2
    assert "wp-admin" not in text
    requests = [line for line in text.splitlines() if "thermap_request" in line]
    assert not [line for line in requests if "mcfv5050" in line]
    assert f'thermap_request_seconds_count{{method="POST",route="{pattern}"}} 4.0' in text
    assert "thermap_machines_in_memory 1.0" in text
    assert "thermap_database_away 0.0" in text


async def test_a_client_cannot_make_new_metrics_by_inventing_methods(client):
    for i in range(5):
        problem(await client.request(f"INVENTED{i}", "/v1/machines"), 405)
        problem(await client.request(f"INVENTED{i}", f"{ROOM}/compensation"), 405)
    assert "INVENTED" not in (await client.get("/metrics")).text


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("DELETE", f"{ROOM}/compensation", {"GET", "POST"}),
        ("PUT", ROOM, {"GET", "PATCH", "DELETE"}),
        ("POST", "/healthz", {"GET"}),
    ],
)
async def test_another_method_is_a_problem_that_names_those_that_exist(
    client, method, path, allowed
):
    answer = await client.request(method, path)
    problem(answer, 405)
    always = {"OPTIONS", "HEAD"} if "GET" in allowed else {"OPTIONS"}
    assert set(answer.headers["allow"].split(", ")) == allowed | always


@pytest.mark.parametrize(
    "path", ["/v1", "/v1/machine", f"{ROOM}/nothing", f"{ROOM}/error-maps/1/x"]
)
async def test_an_unknown_path_is_a_problem(client, path):
    assert path in problem(await client.get(path), 404)["detail"]


async def test_the_documentation_comes_from_the_service_itself(client):
    page = (await client.get("/docs")).text
    assert "http://" not in page
    assert "https://" not in page
    found = re.findall(r'(?:src|href)="(/[^"]+)"', page)
    assert found
    for path in found:
        assert (await client.get(path)).status_code == 200, path


async def test_an_unforeseen_error_is_a_problem_that_shows_no_inside(app, caplog, monkeypatch):
    def broken(*_arguments):
        raise RuntimeError("password=hunter2")

    monkeypatch.setattr("app.api.routes.machines.show_machine", broken)
    async with client_of(app) as client:
        answer = await client.get(ROOM)
    assert "hunter2" not in answer.text
    problem(answer, 500)
    assert "hunter2" in caplog.text
