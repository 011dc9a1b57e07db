"""Databases with real content that 0.1.0 itself wrote: what it answered, this version answers.

`written_by_0_1_0/maps` is of its first tables: a machine with maps of every kind of component, one
taken out of use, an assignment, six versions, readings with gaps. `loop` is of its last: a campaign
of eight visits beside it, its analysis, and a version with the effect that was adopted. With each
stands what 0.1.0 answered then.
"""

import json
import lzma
import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from app.storage.backup import restore_backup, write_backup
from app.storage.database import Database
from app.storage.migrate import current_revision, newest_revision, upgrade
from tests.databases import reachable
from tests.service_examples import ROOM, START, Clock, client_of, error_map, running

pytestmark = pytest.mark.anyio

WRITTEN = Path(__file__).parent / "written_by_0_1_0"
ASKED_AT = {"campaign": datetime(2026, 6, 1, tzinfo=UTC)}
"""When a machine's answers were asked for; START of the others."""

CLOSE = 1e-4
"""0.1 nm or 0.1 nrad, the last digit that tables are written with since then; as a ratio 1e-5."""

NO_RANGE = "the range in which it was learnt is not known"
"""What 0.1.0 did not store of an adopted effect; a table with one is no longer called complete."""


def written(name):
    return json.loads(lzma.decompress((WRITTEN / f"{name}.json.xz").read_bytes()))


@pytest.fixture(params=["maps", "loop"])
def name(request):
    return request.param


@pytest.fixture
def url(tmp_path, name):
    """The file as it was left."""
    path = tmp_path / "thermap.db"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(
            lzma.decompress((WRITTEN / f"{name}.sql.xz").read_bytes()).decode()
        )
    return f"sqlite:///{path}"


def differences(old, new, at=""):
    """List what is no longer as it was; what is said beside it is no difference."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key, value in old.items():
            yield from differences(value, new.get(key, "nothing"), f"{at}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(one, other, f"{at}[{i}]")
    elif isinstance(old, float) and isinstance(new, float):
        if abs(old - new) > CLOSE * max(1.0, 0.1 * abs(old)):
            yield f"{at}: {old} is {new}"
    elif old != new:
        yield f"{at}: {old!r:.200} is {new!r:.200}"


async def expect_as_it_was(service, clock, said):
    async with client_of(service) as client:
        found = list(differences(said["machines"], (await client.get("/v1/machines")).json()))
        for path, old in said["answers"].items():
            machine = path.split("/")[3]
            clock.time = ASKED_AT.get(machine, START)
            answer = await client.get(path)
            new = answer.json() if answer.status_code == 200 else answer.status_code
            if path == "/v1/machines/campaign/compensation":
                assert any(NO_RANGE in warning for warning in new["warnings"])
                old, new = old["components"], new["components"]
            if isinstance(old, int) and isinstance(new, list):
                new = len(new)
            found += differences(old, new, path)
        for machine, tables in said["tables"].items():
            for table in tables:
                path = f"/v1/machines/{machine}/compensation"
                new = (await client.post(path, json=table["asked"])).json()
                found += differences(table["components"], new["components"], path)
                knows_range = not any(NO_RANGE in warning for warning in new["warnings"])
                assert knows_range == (machine != "campaign")
                assert new["complete"] == (table["complete"] and knows_range)
    assert found == []


@pytest.mark.slow
async def test_everything_is_as_it_was_and_the_live_table_is_the_same(url, name):
    clock = Clock()
    database = Database(url)
    with database.reading() as session:
        assert current_revision(session.connection()) != newest_revision()
    database.close()
    with running(url, clock) as service:
        await expect_as_it_was(service, clock, written(name))
        with service.state.context.database.reading() as session:
            assert current_revision(session.connection()) == newest_revision()


@pytest.mark.slow
async def test_work_goes_on_where_0_1_0_ended(url, name):
    with running(url, Clock(START)) as service:
        async with client_of(service) as client:
            before = (await client.get(f"{ROOM}/models")).json()
            stored = await client.post(f"{ROOM}/error-maps", json=error_map("Run #8", 36.0))
            assert stored.status_code == 201, stored.text
            after = (await client.get(f"{ROOM}/models")).json()
            assert len(after) == len(before) + 1
            assert len(after[-1]["maps"]) == len(before[-1]["maps"]) + 1
            again = await client.post(f"{ROOM}/models/{before[-1]['version']}/activate")
            assert again.status_code == 200, again.text
            if name == "loop":
                room = "/v1/machines/campaign"
                analysis = (await client.get(f"{room}/analyses/1")).json()
                assert analysis["result"]["verdict"] == "effects-found"
                (effect,) = analysis["result"]["effects"]
                assert (effect["kind"], effect["components"]) == ("backlash", ["EZX"])
                report = await client.get(f"{room}/analyses/1/report")
                assert report.status_code == 200
                watch = await client.get(f"{room}/watch")
                assert watch.status_code == 200, watch.text


@pytest.mark.slow
async def test_it_goes_on_to_postgresql_by_a_backup(url, name, databases, tmp_path):
    database = Database(url)
    upgrade(database)
    database.close()
    write_backup(url, tmp_path / "friday.thermap")
    other = reachable(databases.empty, "postgresql")
    restore_backup(other, tmp_path / "friday.thermap")
    clock = Clock()
    with running(other, clock) as service:
        await expect_as_it_was(service, clock, written(name))
    databases.give_back(other)
