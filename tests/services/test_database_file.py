"""A SQLite file that is deleted or replaced under the running service."""

import shutil
from pathlib import Path

import pytest
from sqlalchemy import make_url

from app.errors import StorageUnavailable
from app.services.follow_database import DatabaseFollower
from app.storage.database import Database
from app.storage.machines import list_machines
from tests.service_examples import (
    ROOM,
    START,
    client_of,
    furnish_database,
    problem,
    reading,
    temperatures,
)

pytestmark = pytest.mark.anyio


@pytest.fixture
def url(databases):
    url = databases.prepared("sqlite", furnish_database)
    yield url
    databases.give_back(url)


@pytest.fixture
def file(url):
    return Path(make_url(url).database)


@pytest.mark.slow
@pytest.mark.parametrize("replaced", [False, True], ids=["deleted", "replaced"])
async def test_nothing_is_answered_with_201_that_nobody_will_find(new_app, url, file, replaced):
    service = new_app(url)
    follower = DatabaseFollower(service.state.context, every_s=1.0)
    follower.look()
    async with client_of(service) as client:
        assert (await client.post(f"{ROOM}/readings", json=reading(START, 25))).status_code == 201
        away = file.with_name("elsewhere.db")
        file.rename(away)
        if replaced:
            shutil.copyfile(away, file)
        refused = problem(await client.post(f"{ROOM}/readings", json=reading(START, 25.0)), 503)
        assert str(file) in refused["detail"]
        expected = "start the service again" if replaced else "was deleted or moved"
        assert expected in refused["detail"]
        problem(await client.get("/v1/machines"), 503)
        assert (await client.get("/readyz")).status_code == 503
        follower.look()
        stated = {"temperatures_c": temperatures(25.0)}
        table = (await client.post(f"{ROOM}/compensation", json=stated)).json()
        assert "the database has been away" in table["warnings"][0]
        assert len(table["components"]) > 0
        if not replaced:
            assert not file.exists(), "an empty one took its place"
        away.rename(file)
        follower.look()
        assert (await client.get("/readyz")).status_code == 200
        table = (await client.post(f"{ROOM}/compensation", json=stated)).json()
        assert table["warnings"] == []


def test_a_file_that_goes_during_the_transaction_is_noticed_after_it(url, file):
    database = Database(url)

    def write():
        with database.writing() as session:
            list_machines(session)
            file.unlink()

    with pytest.raises(StorageUnavailable, match="deleted"):
        write()
    database.close()
