"""Memory follows the database: several processes write to one."""

import logging
from datetime import timedelta

import pytest
from sqlalchemy import text, update

from app.errors import StorageUnavailable
from app.services import follow_database
from app.services.follow_database import DatabaseFollower
from app.storage.readings import insert_readings
from app.storage.tables import MachineRow
from app.thermal.reading import Reading
from tests.service_examples import (
    MACHINE,
    ROOM,
    START,
    client_of,
    error_map,
    iso,
    problem,
    reading,
    temperatures,
)

pytestmark = [pytest.mark.anyio, pytest.mark.slow]

on_postgresql = pytest.mark.parametrize("furnished_url", ["postgresql"], indirect=True)
"""SQLite has one writer at a time."""

STATED = {"temperatures_c": temperatures(25.5)}


@pytest.fixture
def other_app(new_app, furnished_url, app):
    """A second service on the same database, that follows it when it is told to."""
    service = new_app(furnished_url)
    service.follower = DatabaseFollower(service.state.context, every_s=1.0)
    service.follower.look()
    return service


@pytest.fixture
def look(other_app):
    return other_app.follower.look


@pytest.fixture
async def other(other_app):
    async with client_of(other_app) as other:
        yield other


async def version_at(client):
    return (await client.post(f"{ROOM}/compensation", json=STATED)).json()["model_version"]


async def test_a_map_stored_by_one_is_in_the_others_table(client, other, look):
    assert await version_at(other) == 3
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    assert await version_at(client) == 4
    assert await version_at(other) == 3
    look()
    assert await version_at(other) == 4
    ours = await client.post(f"{ROOM}/compensation", json=STATED)
    theirs = await other.post(f"{ROOM}/compensation", json=STATED)
    assert ours.json() == theirs.json()


async def test_every_change_of_a_model_reaches_the_other(client, other, look):
    await client.put(f"{ROOM}/sensor-assignment", json={"EXX": "spindle"})
    look()
    assert await version_at(other) == 4
    await client.post(f"{ROOM}/models/2/activate")
    look()
    assert await version_at(other) == 2
    run_1 = (await client.get(f"{ROOM}/error-maps")).json()[0]["id"]
    await client.delete(f"{ROOM}/error-maps/{run_1}")
    look()
    problem(await other.post(f"{ROOM}/compensation", json=STATED), 422)
    await client.post(f"{ROOM}/models/3/activate")
    await client.patch(ROOM, json={"out_of_range": "reject"})
    look()
    hot = {"temperatures_c": temperatures(45.0)}
    problem(await other.post(f"{ROOM}/compensation", json=hot), 422)


async def test_a_reading_posted_to_one_reaches_the_other(client, other, look, clock):
    problem(await other.get(f"{ROOM}/compensation"), 409)
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    look()
    document = (await other.get(f"{ROOM}/compensation")).json()
    assert document["reading_time"] == iso(START)
    assert document["components"] == (await client.get(f"{ROOM}/compensation")).json()["components"]
    clock.advance(10)
    await other.post(f"{ROOM}/readings", json=reading(clock.time, 26.0))
    assert (await client.get(f"{ROOM}/compensation")).json()["reading_age_s"] == 10
    look()
    assert (await other.get(f"{ROOM}/compensation")).json()["reading_age_s"] == 0


async def test_a_machine_made_by_one_is_there_at_the_other(client, other, look):
    await client.post("/v1/machines", json=MACHINE | {"id": "new"})
    look()
    assert (await other.get("/readyz")).json()["machines_in_memory"] == 2
    problem(await other.get("/v1/machines/new/compensation"), 409)


async def test_a_machine_deleted_by_one_is_gone_at_the_other(client, other, look):
    assert await version_at(other) == 3
    await client.delete(ROOM)
    look()
    problem(await other.post(f"{ROOM}/compensation", json=STATED), 404)
    problem(await other.get(f"{ROOM}/compensation"), 404)
    assert (await other.get("/readyz")).json()["machines_in_memory"] == 0


@pytest.mark.parametrize("ahead_s", [1, 0.000001, -5], ids=["later", "just later", "slow clock"])
async def test_a_machine_deleted_and_made_again_between_two_looks_is_a_new_one(
    client, other, look, clock, ahead_s
):
    """It counts for as much as before; and the clock of who made it may be slow."""
    await client.post("/v1/machines", json=MACHINE | {"id": "plain", "name": "old"})
    await client.post("/v1/machines/plain/readings", json=reading(START, 25.5))
    look()
    clock.advance(ahead_s)
    await client.delete("/v1/machines/plain")
    await client.post("/v1/machines", json=MACHINE | {"id": "plain", "name": "new"})
    for label, t_c in (("A", 20.0), ("B", 30.0)):
        await client.post("/v1/machines/plain/error-maps", json=error_map(label, t_c))
    look()
    problem(await other.get("/v1/machines/plain/compensation"), 409)  # it has no reading
    table = await other.post("/v1/machines/plain/compensation", json=STATED)
    assert table.json()["model_version"] == 2


async def test_a_machine_without_maps_made_again_is_a_new_one(client, other, look, clock):
    await client.post("/v1/machines", json=MACHINE | {"id": "plain"})
    look()
    clock.advance(1)
    await client.delete("/v1/machines/plain")
    sensors = [{"name": "only"}]
    await client.post("/v1/machines", json=MACHINE | {"id": "plain", "sensors": sensors})
    look()
    found = problem(await other.post("/v1/machines/plain/compensation", json=STATED), 422)
    assert "it has only" in found["detail"]


@on_postgresql
async def test_readings_committed_late_under_lower_numbers_are_not_missed(client, app, other, look):
    """PostgreSQL gives numbers at once and shows rows at the commit: others overtake."""
    early = Reading(START, temperatures(25.5), {})
    with app.state.context.database.writing() as slow:
        insert_readings(slow, {"mcfv5050": [early]})
        await client.post(f"{ROOM}/readings", json=reading(START - timedelta(seconds=60), 25.0))
        look()
        document = (await other.get(f"{ROOM}/compensation")).json()
        assert document["reading_time"] == iso(START - timedelta(seconds=60))
    look()
    document = (await other.get(f"{ROOM}/compensation")).json()
    assert document["reading_time"] == iso(START)


@on_postgresql
async def test_readings_on_their_way_while_the_other_starts_are_not_missed(
    client, app, new_app, furnished_url
):
    with app.state.context.database.writing() as slow:
        insert_readings(slow, {"mcfv5050": [Reading(START, temperatures(25.5), {})]})
        await client.post(f"{ROOM}/readings", json=reading(START - timedelta(seconds=60), 25.0))
        late = new_app(furnished_url)
        follower = DatabaseFollower(late.state.context, every_s=1.0)
        follower.look()
    follower.look()
    assert late.state.context.live.get("mcfv5050").readings.latest.time == START


async def test_readings_stored_after_a_machine_with_newer_ones_was_deleted_are_not_missed(
    client, other, look
):
    await client.post("/v1/machines", json=MACHINE | {"id": "gone"})
    many = [reading(START - timedelta(seconds=s), 25.0) for s in range(20)]
    await client.post("/v1/machines/gone/readings", json=many)
    look()
    await client.delete("/v1/machines/gone")
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    look()
    assert (await other.get(f"{ROOM}/compensation")).status_code == 200


@pytest.mark.slow
async def test_a_large_batch_is_followed(client, other, look):
    batch = [reading(START - timedelta(seconds=s), 25.0) for s in range(10_000)]
    await client.post(f"{ROOM}/readings", json=batch)
    look()
    assert (await other.get(f"{ROOM}/compensation")).json()["reading_time"] == iso(START)


@pytest.mark.slow
async def test_one_machine_that_cannot_be_loaded_does_not_keep_the_others_from_it(
    client, app, other, look, caplog
):
    """Such as one that a newer service, or somebody with SQL, has written."""
    await client.post("/v1/machines", json=MACHINE | {"id": "broken"})
    with app.state.context.database.writing() as session:
        session.execute(
            update(MachineRow)
            .where(MachineRow.id == "broken")
            .values(configuration="QQQ", revision=MachineRow.revision + 1)
        )
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    with caplog.at_level(logging.ERROR):
        look()
        look()
    assert await version_at(other) == 4
    assert (await other.get(f"{ROOM}/compensation")).status_code == 200
    assert caplog.text.count("'broken' cannot be loaded") == 1


async def test_a_look_that_fails_halfway_is_repeated_whole(client, other, look, monkeypatch):
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    await client.post(f"{ROOM}/readings", json=reading(START, 25.5))
    with monkeypatch.context() as patched:

        def away(*_arguments):
            raise StorageUnavailable("the database is away: cut in the middle")

        patched.setattr(follow_database, "load_machine", away)
        look()
    assert await version_at(other) == 3
    look()
    assert await version_at(other) == 4
    assert (await other.get(f"{ROOM}/compensation")).status_code == 200


async def test_following_an_unchanged_database_loads_nothing(other_app, look, monkeypatch):
    loaded = []
    monkeypatch.setattr(follow_database, "load_machine", lambda *a: loaded.append(a))
    look()
    look()
    assert loaded == []


async def test_a_change_of_ones_own_is_not_loaded_again(client, app, monkeypatch):
    follower = DatabaseFollower(app.state.context, every_s=1.0)
    follower.look()
    await client.post(f"{ROOM}/error-maps", json=error_map("Run #9", 40.0))
    loaded = []
    monkeypatch.setattr(follow_database, "load_machine", lambda *a: loaded.append(a))
    follower.look()
    assert loaded == []


def test_the_follower_ends_when_it_is_told_to(app):
    follower = DatabaseFollower(app.state.context, every_s=60.0)
    follower.start()
    follower.stop()
    assert not follower._thread.is_alive()


async def test_a_database_that_somebody_emptied_empties_memory(client, app, other, look):
    assert await version_at(other) == 3
    with app.state.context.database.writing() as session:
        session.execute(text("DELETE FROM machine"))
    look()
    problem(await other.post(f"{ROOM}/compensation", json=STATED), 404)
