"""How connections fare is the same wherever it is asked: each process tells the others."""

from datetime import timedelta

import pytest

from app.connections import reports
from app.storage.connection_reports import write_report
from tests.connections.test_connections import file_of, until
from tests.service_examples import client_of

pytestmark = pytest.mark.anyio

# What is taken stays with the connections: the database has no such machine.
FILE = """
[intake]
collect_s = 60.0

[[mtconnect]]
name = "mill"
machine = "mcfv5050"
url = "http://127.0.0.1:9"
sensors = { x-middle = "X" }

[[mqtt]]
name = "shop broker"
host = "127.0.0.1"
port = 9
client_id = "thermap-test-reports"

[[mqtt.topics]]
topic = "shop/{machine}/{sensor}"
"""


async def asked(client):
    answer = await client.get("/v1/connections")
    assert answer.status_code == 200, answer.text
    return answer.json()


@pytest.fixture
def services(new_app, postgresql_url, tmp_path, monkeypatch):
    """Two services on one database: the first has connections, the second none."""
    monkeypatch.setattr(reports, "TELL_EVERY_S", 0.05)
    url = postgresql_url
    return new_app(url, config=file_of(tmp_path, FILE)), new_app(url)


async def test_all_services_say_what_the_one_with_connections_says(services):
    first, second = services
    async with client_of(first) as own, client_of(second) as other:
        assert (await asked(other))["connections"] == []
        async with first.state.connections.running(), first.state.connection_reports.running():
            intake = first.state.connections._intake
            now = first.state.context.now()
            intake.offer("mcfv5050", {"x-middle": 25.0}, now + timedelta(minutes=3))
            intake.refuse("topic 'a\x00b'", "expected a number")
            await until(lambda: asked(other), lambda found: found["refused"] == 1)
            found = await until(
                lambda: asked(other), lambda found: all(c["trouble"] for c in found["connections"])
            )
            assert [one["name"] for one in found["connections"]] == ["mill", "shop broker"]
            assert found["wrong_clocks"] == 1
            assert found["machines_with_wrong_clocks"] == ["mcfv5050"]
            await until(lambda: both(own, other), lambda two: two[0] == two[1])
        # Ended in order, it takes back what it told.
        assert (await asked(other))["connections"] == []


async def both(own, other):
    return [await asked(own), await asked(other)]


async def test_of_a_process_that_died_nothing_is_claimed(services, monkeypatch):
    first, second = services
    content = reports._SHAPE.dump_json(first.state.connections.now()).decode()
    with second.state.context.database.writing() as session:
        write_report(session, "elsewhere /thermap.toml", content, timedelta(hours=1))
        write_report(session, "newer /thermap.toml", '{"connections": "otherwise"}', timedelta(1))
    async with client_of(second) as client:
        assert len((await asked(client))["connections"]) == 2
        monkeypatch.setattr(reports, "SILENT_AFTER", timedelta(0))
        (mill, _) = (await asked(client))["connections"]
        assert (mill["connected"], mill["known"]) == (False, 0)
        assert mill["trouble"].startswith("the process that has it has said nothing for ")


async def test_without_a_database_the_own_connections_are_said(services, monkeypatch):
    first, second = services
    for service in services:
        monkeypatch.setattr(service.state.context.database, "reading", unavailable)
    async with client_of(first) as own, client_of(second) as other:
        assert len((await asked(own))["connections"]) == 2
        assert (await other.get("/v1/connections")).status_code == 503


def unavailable(*_asked):
    raise reports.StorageUnavailable("the database is away")
