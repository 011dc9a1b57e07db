"""Uncertainty in the database: bit for bit, and for databases that were made before it."""

import numpy as np
import pytest
from alembic import command
from sqlalchemy import MetaData, func, insert, inspect, select, text

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.storage.database import Database
from app.storage.error_maps import insert_error_map, list_error_maps, same_content
from app.storage.machines import insert_machine
from app.storage.migrate import alembic_config, current_revision, upgrade
from app.storage.tables import ComponentRow
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine
from tests.databases import NUMBERED
from tests.service_examples import ROOM, START, client_of, furnish_database

FORMER = "869265db76ba"
"""The version before error maps had uncertainty."""

ADDED = {"covariance", "backward_covariance"}
NEW_SETTINGS = {
    "withdrawals": 0,
    "extrapolation_error_ratio": 3.0,
    "waiting_version": None,
    "entries_after": 0,
    "serial_number": None,
}
"""Columns of a machine that came after it, and what they hold then."""
LATER = (
    *("verification", "analysis", "watch", "withdrawn_reading"),
    *("access_key", "browser_session", "event", "connection_report"),
    *("receiver", "temperature_hour", "temperature_hours_done"),
)
"""Tables that came after it too."""

RNG = np.random.default_rng(4)
ROOT = RNG.normal(size=(5, 5))
FULL = ROOT @ ROOT.T


@pytest.fixture
def database(database_url):
    database = Database(database_url)
    with database.writing() as session:
        insert_machine(session, Machine("m", "M", Chain.parse("XYFZ")), START)
    yield database
    database.close()


def a_map(**covariances):
    n = 5
    errors = np.arange(n) * 0.1
    table = ComponentTable.make(COMPONENTS["EXX"], errors, range(n), errors, **covariances)
    return ErrorMap("Run #1", START, {"a": 20.0}, {"EXX": table})


def kept(database, error_map):
    with database.writing() as session:
        insert_error_map(session, "m", error_map, START)
    with database.reading() as session:
        (found,) = list_error_maps(session, "m")
        sizes = session.execute(
            select(func.length(ComponentRow.covariance), func.length(ComponentRow.errors))
        ).one()
    return found.error_map, sizes


def test_a_covariance_comes_back_bit_for_bit(database):
    stated = a_map(covariance=FULL, backward_covariance=RNG.uniform(0, 1, 5))
    found, _ = kept(database, stated)
    table = found.tables["EXX"]
    np.testing.assert_array_equal(table.covariance, FULL)
    np.testing.assert_array_equal(
        table.backward_covariance, stated.tables["EXX"].backward_covariance
    )
    assert same_content(found, stated)


def test_independent_errors_take_no_square_of_numbers(database):
    stated = a_map(covariance=np.diag(np.diagonal(FULL)))
    found, (of_covariance, of_errors) = kept(database, stated)
    assert of_covariance == of_errors
    assert found.tables["EXX"].covariance.tolist() == np.diagonal(FULL).tolist()
    assert found.tables["EXX"].backward_covariance is None
    assert same_content(found, stated)


def test_what_is_not_known_stays_unknown(database):
    found, (of_covariance, _) = kept(database, a_map())
    assert of_covariance is None
    assert found.tables["EXX"].covariance is None
    assert not same_content(found, a_map(covariance=np.zeros(5)))


def test_one_value_has_one_variance(database):
    table = ComponentTable.make(COMPONENTS["SXY"], [1.0], covariance=[[0.1]])
    found, _ = kept(database, ErrorMap("Run #1", START, {"a": 20.0}, {"SXY": table}))
    assert found.tables["SXY"].covariance.tolist() == [0.1]


# --- databases of the former version -----------------------------------------------------


def rows_of(database, only=None):
    """Table to its rows as they are stored; of `only`, the columns that it has too."""
    metadata = MetaData()
    metadata.reflect(database.engine)
    with database.reading() as session:
        return {
            table.name: [
                dict(row)
                for row in session.execute(
                    select(
                        *(c for c in table.c if only is None or c.name in only.tables[table.name].c)
                    ).order_by(*table.primary_key.columns)
                ).mappings()
            ]
            for table in metadata.sorted_tables
            if table.name != "alembic_version"
            and (only is None or table.name in only.tables)
            and not table.name.startswith("reading_")  # a partition's rows are in `reading` too
        }


@pytest.fixture
def former(empty_database_url, databases):
    """A database as the former version left it: its own tables, filled by another's rows."""
    newest = databases.prepared("sqlite", furnish_database)
    database, source = Database(empty_database_url), Database(newest)
    with database.migrating() as connection:
        command.upgrade(alembic_config(connection), FORMER)
    metadata = MetaData()
    metadata.reflect(database.engine)
    rows = rows_of(source, metadata)
    with database.writing() as session:
        for table in metadata.sorted_tables:
            if rows.get(table.name):
                session.execute(insert(table), rows[table.name])
        if database.engine.dialect.name == "postgresql":
            for name in set(NUMBERED) & set(metadata.tables):
                session.execute(text(f"SELECT setval('{name}_id_seq', 1000)"))
    source.close()
    databases.give_back(newest)
    yield database
    database.close()


def test_the_former_version_had_no_uncertainty(former):
    columns = {c["name"] for c in inspect(former.engine).get_columns("error_map_component")}
    assert not ADDED & columns
    with former.reading() as session:
        assert current_revision(session.connection()) == FORMER


def test_a_database_of_the_former_version_is_upgraded_without_loss(former):
    before = rows_of(former)
    assert min(len(before[name]) for name in ("machine", "error_map", "error_map_component")) > 0
    upgrade(former)
    after = rows_of(former)
    for row in after["error_map_component"]:
        assert {name: row.pop(name) for name in ADDED} == dict.fromkeys(ADDED)
    for row in after["machine"]:
        assert {name: row.pop(name) for name in NEW_SETTINGS} == NEW_SETTINGS
    assert {table: after.pop(table) for table in LATER} == {table: [] for table in LATER}
    assert after == before


@pytest.mark.slow
@pytest.mark.anyio
async def test_and_serves_the_maps_that_it_had_and_takes_new_ones(former, new_app):
    url = former.engine.url.render_as_string(hide_password=False)
    async with client_of(new_app(url.replace("+psycopg", ""))) as client:
        maps = (await client.get(f"{ROOM}/error-maps")).json()
        assert [m["label"] for m in maps] == ["Run #1", "Run #3", "Run #6"]
        assert maps[1]["components"][0]["errors_um"] == [0.0, 4.0, 20.0]
        stated = {
            "label": "new",
            "measured_at": "2026-02-28T06:00:00Z",
            "temperatures_c": {"x-middle": 40.0, "z-column": 42.0},
            "components": [
                {"component": "SXY", "value_um_per_m": -40.0, "standard_error_um_per_m": 0.5}
            ],
        }
        answer = await client.post(f"{ROOM}/error-maps", json=stated)
        assert answer.status_code == 201, answer.text
        body = {"temperatures_c": {"x-middle": 40.0, "z-column": 32.0}}
        table = (await client.post(f"{ROOM}/compensation", json=body)).json()
        (sxy,) = (c for c in table["components"] if c["component"] == "SXY")
        assert sxy["standard_error_um_per_m"] == 0.5


def test_going_back_to_the_former_version_keeps_all_but_the_uncertainty(furnished_url):
    database = Database(furnished_url)
    before = rows_of(database)
    with database.migrating() as connection:
        command.downgrade(alembic_config(connection), FORMER)
    for table in LATER:
        del before[table]
    for row in before["machine"]:
        for name in NEW_SETTINGS:
            del row[name]
    for row in before["error_map_component"]:
        for name in ADDED:
            del row[name]
    assert rows_of(database) == before
    upgrade(database)
    database.close()
