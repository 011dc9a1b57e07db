"""Readings by months on PostgreSQL, and what is let go of when it is old."""

from datetime import UTC, datetime, timedelta

import pytest
from alembic import command
from sqlalchemy import text

from app.effects.driver import Behind
from app.effects.effect import Effect
from app.effects.shape import Sensitivity
from app.effects.term import Term
from app.services.events import ALARM_DUTY
from app.services.keep_readings import KEEPER_DUTY, ReadingKeeper
from app.storage import partitions
from app.storage.database import Database
from app.storage.migrate import UPGRADE_LOCK, alembic_config, upgrade
from app.storage.readings import find_readings, insert_readings, list_readings
from app.thermal.reading import Reading
from tests.databases import reachable
from tests.effect_examples import adopt, learnt
from tests.service_examples import MACHINE, ROOM, START, error_map, furnish_database, iso

pytestmark = pytest.mark.anyio

BEFORE_PARTITIONS = "9c41e7d25ab8"
MONTHS = [datetime(2026, month, 1, tzinfo=UTC) for month in (3, 4, 5)]


@pytest.fixture
def empty_postgresql(databases):
    url = reachable(databases.empty, "postgresql")
    database = Database(url)
    yield database
    database.close()
    databases.give_back(url)


@pytest.fixture
def postgresql(new_app, databases):
    url = reachable(lambda kind: databases.prepared(kind, furnish_database), "postgresql")
    yield new_app(url).state.context
    databases.give_back(url)


def migrated(database, step, revision):
    with database.migrating() as connection:
        step(alembic_config(connection), revision)


def rows(database):
    """Everything of all readings, as the driver gives it."""
    with database.reading() as session:
        found = session.execute(text("SELECT * FROM reading ORDER BY id"))
        return [tuple(row) for row in found]


def readings_at(times):
    return [Reading(time, {"spindle": 20.0}, {}) for time in times]


def parts(database):
    """The partitions with how many readings each has."""
    with database.reading() as session:
        found = session.execute(
            text("SELECT tableoid::regclass::text, count(*) FROM reading GROUP BY 1 ORDER BY 1")
        )
        return dict(found.all())


def test_what_is_stored_is_moved_there_and_back(empty_postgresql):
    database = empty_postgresql
    migrated(database, command.upgrade, BEFORE_PARTITIONS)
    with database.writing() as session:
        session.execute(
            text(
                "INSERT INTO machine (id, name, configuration, axes, sensors, out_of_range, "
                "extrapolation_margin_c, same_temperature, revision, created_at) VALUES "
                "('m', 'M', 'XYFZ', '{}', '[]', 'clamp', 5, 'newest', 1, now())"
            )
        )
        for number, time in (
            (7, "2026-02-28T23:59:59.999999Z"),
            (8, "2026-03-01T00:00:00Z"),
            (9, "2026-02-01T00:00:00Z"),
            (40, "2019-12-31T23:59:59Z"),
        ):
            session.execute(
                text(
                    "INSERT INTO reading (id, machine_id, time, temperatures_c, state, early_s) "
                    "VALUES (:id, 'm', :time, CAST(:content AS json), '{\"rpm\": 1e-5}', 0.25)"
                ),
                {"id": number, "time": time, "content": f'{{"a": 20.{number}, "ü": -0.0}}'},
            )
        session.execute(text("SELECT setval('reading_id_seq', 50)"))
    before = rows(database)
    assert len(before) == 4
    upgrade(database)
    assert rows(database) == before
    assert parts(database) == {"reading_2019m12": 1, "reading_2026m02": 2, "reading_2026m03": 1}
    with database.writing() as session:
        assert insert_readings(session, {"m": [Reading(START, {"a": 1.0}, {})]})["m"].times == {
            START
        }
        assert insert_readings(session, {"m": [Reading(START, {"a": 2.0}, {})]})["m"].times == set()
    assert rows(database)[-1][0] == 51
    migrated(database, command.downgrade, BEFORE_PARTITIONS)
    assert rows(database)[:-1] == before
    with database.writing() as session:
        session.execute(text("DELETE FROM machine"))
    assert rows(database) == []


async def test_months_are_made_ahead_and_take_what_is_theirs(postgresql):
    database = postgresql.database
    times = [START, START - timedelta(days=9000), START + timedelta(days=40)]
    with database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at(times)})
    before = rows(database)
    assert parts(database) == {"reading_default": 3}
    with database.writing() as session:
        assert partitions.make_months(session.connection(), START) == MONTHS
        assert partitions.make_months(session.connection(), START) == []
    assert rows(database) == before
    assert parts(database) == {
        "reading_2026m03": 1,
        "reading_2026m04": 1,
        "reading_default": 1,
    }
    with database.reading() as session:
        assert set(find_readings(session, MACHINE["id"], times)) == set(times)
        assert [r.time for r in list_readings(session, MACHINE["id"])] == sorted(times)
        plan = session.scalars(
            text(f"EXPLAIN SELECT * FROM reading WHERE machine_id = 'm' AND time > '{iso(START)}'")
        ).all()
    assert "reading_2026m04" in "".join(plan)
    ReadingKeeper(postgresql, None).look()
    assert parts(database)["reading_default"] == 1


async def test_old_months_go_whole(postgresql, monkeypatch):
    database = postgresql.database
    now = START + timedelta(days=100)
    times = [START, now]
    with database.writing() as session:
        partitions.make_months(session.connection(), START)
        insert_readings(session, {MACHINE["id"]: readings_at(times)})
    postgresql.now.time = now
    assert ReadingKeeper(postgresql, 40).look() == 0
    assert [row[2] for row in rows(database)] == [now]
    with database.reading() as session:
        made = partitions.months_made(session.connection())
    assert made[0] == datetime(2026, 4, 1, tzinfo=UTC)


@pytest.mark.parametrize("checked", [False, True], ids=["unchecked", "checked"])
async def test_what_a_verification_needs_stays(app, client, clock, checked):
    context = app.state.context
    days = [400, 331, 329, 301, 299, 60, 41, 39, 0]
    times = [START - timedelta(days=d) for d in days]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at(times)})
    if checked:
        seen = {"time": iso(START - timedelta(days=300)), "component": "EXX"}
        answer = await client.post(
            f"{ROOM}/verifications",
            json={
                "label": "visit",
                "datum": "absolute",
                "repeatability_um": 0.5,
                "observations": [seen | {"position_mm": 100.0, "measured_um": 1.0}],
            },
        )
        assert answer.status_code == 201, answer.text
    assert ReadingKeeper(context, None).look() == 0
    keeper = ReadingKeeper(context, 40)
    assert keeper.look() == (1 if checked else 7)
    assert keeper.look() == 0
    with context.database.reading() as session:
        left = [(START - r.time).days for r in list_readings(session, MACHINE["id"])]
    assert left == ([331, 329, 301, 299, 60, 41, 39, 0] if checked else [39, 0])


async def test_many_old_readings_go_in_slices(app, monkeypatch):
    context = app.state.context
    monkeypatch.setattr("app.services.keep_readings.SLICE", 7)
    monkeypatch.setattr("app.services.keep_readings.PAUSE_S", 0.0)
    old = START - timedelta(days=100)
    times = [old + timedelta(seconds=s) for s in range(30)]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at(times)})
    assert ReadingKeeper(context, 40).look() == 30


def test_every_duty_has_a_number_of_its_own():
    assert len({ALARM_DUTY, KEEPER_DUTY, UPGRADE_LOCK}) == 3


OLD = START - timedelta(days=100)


@pytest.mark.parametrize("slice_", [3, 2000])
async def test_of_what_is_old_one_value_of_each_sensor_a_minute_is_left(app, monkeypatch, slice_):
    context = app.state.context
    monkeypatch.setattr("app.services.keep_readings.SLICE", slice_)
    monkeypatch.setattr("app.services.keep_readings.PAUSE_S", 0.0)
    stated = [(s, {"spindle": 20.0 + s}) for s in (0, 1, 30, 59, 60, 61, 185)]
    stated += [(s, {"x-middle": 21.0}) for s in (20, 21, 70)]
    stated += [(62, {"spindle": 20.0, "x-middle": 21.0}), (71, {"spindle": 20.0, "x-middle": 2.0})]
    kept = [OLD + timedelta(seconds=s) for s in (0, 20, 60, 62, 185)]
    young = [START - timedelta(days=39, seconds=s) for s in (2, 1, 0)]
    content = [Reading(OLD + timedelta(seconds=s), t, {}) for s, t in stated]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: [*content, *readings_at(young)]})
    keeper = ReadingKeeper(context, None, 40, 60.0)
    assert keeper.look() == len(stated) - len(kept)
    assert keeper.look() == 0
    with context.database.reading() as session:
        assert [r.time for r in list_readings(session, MACHINE["id"])] == [*kept, *young]
    # Another service, or this one after a start, finds nothing more.
    assert ReadingKeeper(context, None, 40, 60.0).look() == 0


async def test_what_has_grown_old_is_thinned_where_it_was_left(app, clock):
    context = app.state.context
    clock.time = START
    times = [START - timedelta(days=40) + timedelta(seconds=s) for s in range(-30, 30)]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at(times)})
    keeper = ReadingKeeper(context, None, 40, 3600.0)
    first = keeper.look()
    clock.time += timedelta(days=1)
    assert first > 0
    assert first + keeper.look() == 60 - len({t.timestamp() // 60.0 for t in times})


@pytest.mark.parametrize("spared", ["map", "verification"])
async def test_what_a_map_or_a_verification_needs_is_not_thinned(app, client, spared):
    context = app.state.context
    at = START - timedelta(days=200)
    if spared == "map":
        answer = await client.post(
            f"{ROOM}/error-maps", json=error_map("Old", 35.0) | {"measured_at": iso(at)}
        )
    else:
        seen = {"time": iso(at), "component": "EXX"}
        body = {"label": "visit", "datum": "absolute", "repeatability_um": 0.5}
        observations = [seen | {"position_mm": 100.0, "measured_um": 1.0}]
        answer = await client.post(
            f"{ROOM}/verifications", json=body | {"observations": observations}
        )
    assert answer.status_code == 201, answer.text
    pairs = [
        (at - timedelta(days=d), at - timedelta(days=d) + timedelta(seconds=1))
        for d in (32, 30, 1, -2)
    ]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at([t for pair in pairs for t in pair])})
    assert ReadingKeeper(context, None, 40).look() == 2
    with context.database.reading() as session:
        left = [r.time for r in list_readings(session, MACHINE["id"])]
    assert left == sorted([pairs[0][0], *pairs[1], *pairs[2], pairs[3][0]])


async def test_what_an_adopted_lag_reads_again_is_not_thinned(app):
    """A filter of two days is known to the last digit from the sixty days before."""
    context = app.state.context
    adopt(app, slow_lag(timedelta(days=2)))
    pairs = [
        (START - timedelta(days=d), START - timedelta(days=d) + timedelta(seconds=1))
        for d in (70, 50, 35)
    ]
    with context.database.writing() as session:
        insert_readings(session, {MACHINE["id"]: readings_at([t for pair in pairs for t in pair])})
    assert ReadingKeeper(context, None, 31).look() == 1
    with context.database.reading() as session:
        left = [r.time for r in list_readings(session, MACHINE["id"])]
    assert left == [pairs[0][0], *pairs[1], *pairs[2]]


def slow_lag(time_constant):
    tau_s = time_constant.total_seconds()
    term = Term("EZZ", Behind("z-column", tau_s), Sensitivity(is_local=False))
    parameters = {"time_constant_min": tau_s / 60.0, "share": 1.0}
    return learnt(
        Effect("thermal-lag", ("EZZ",), ("z-column",), parameters=parameters, terms=(term,))
    )
