"""What the database itself refuses, and what it deletes together."""

from datetime import timedelta

import pytest
from sqlalchemy import delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from app.arrays import frozen
from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.identification.watch.watching import WatchState, not_judged
from app.storage.analyses import insert_analysis
from app.storage.database import Database
from app.storage.error_maps import find_error_map, insert_error_map, withdraw_error_map
from app.storage.machines import RowLock, find_machine, insert_machine
from app.storage.model_versions import insert_version
from app.storage.readings import insert_readings, newest_id, withdraw_stored
from app.storage.records import AnalysisTask
from app.storage.tables import (
    Base,
    ComponentRow,
    ErrorMapRow,
    MachineRow,
    ModelVersionMapRow,
    ModelVersionRow,
    ReadingRow,
    TemperatureHourRow,
)
from app.storage.verifications import insert_verification
from app.storage.watches import write_watch
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from tests.service_examples import START


@pytest.fixture
def database(database_url):
    database = Database(database_url)
    with database.writing() as session:
        for name in ("m", "n"):
            insert_machine(session, Machine(name, name, Chain.parse("XYFZ")), START)
    yield database
    database.close()


def error_map(label):
    tables = {"EXX": ComponentTable.make(COMPONENTS["EXX"], [0.0], [0.0])}
    return ErrorMap(label, START, {"a": 20.0}, tables)


def count(database, table):
    with database.reading() as session:
        return session.scalar(select(func.count()).select_from(table))


def test_a_label_names_one_map_in_use(database):
    with database.writing() as session:
        first = insert_error_map(session, "m", error_map("Run #1"), START)
        insert_error_map(session, "m", error_map("Run #2"), START)
        insert_error_map(session, "n", error_map("Run #1"), START)
    with pytest.raises(IntegrityError), database.writing() as session:
        insert_error_map(session, "m", error_map("Run #1"), START)
    with database.writing() as session:
        withdraw_error_map(find_error_map(session, "m", first.id), START)
    for _ in range(2):
        with database.writing() as session:
            again = insert_error_map(session, "m", error_map("Run #1"), START)
            withdraw_error_map(find_error_map(session, "m", again.id), START)
    with database.writing() as session:
        insert_error_map(session, "m", error_map("Run #1"), START)
    with pytest.raises(IntegrityError), database.writing() as session:
        session.execute(update(ErrorMapRow).values(withdrawn_at=None))


@pytest.mark.parametrize(
    ("table", "values"),
    [
        (ReadingRow, {"time": START, "temperatures_c": {}, "state": {}}),
        (ModelVersionRow, {"version": 1, "created_at": START, "reason": "", "assignment": {}}),
        (
            ErrorMapRow,
            {
                "label": "x",
                "measured_at": START,
                "temperatures_c": {},
                "measuring_lines_mm": {},
                "stored_at": START,
            },
        ),
        (ModelVersionMapRow, {"version": 1, "error_map_id": 1}),
    ],
    ids=lambda v: getattr(v, "__tablename__", ""),
)
def test_nothing_belongs_to_a_machine_that_does_not_exist(database, table, values):
    if table is ModelVersionRow:
        values = values | {"effects": []}
    with pytest.raises(IntegrityError), database.writing() as session:
        session.execute(insert(table).values(machine_id="nobody", **values))
    assert count(database, table) == 0


def test_no_component_belongs_to_a_map_that_does_not_exist(database):
    array = frozen([0.0])
    row = {"error_map_id": 77, "component": "EXX", "place": 0}
    with pytest.raises(IntegrityError), database.writing() as session:
        session.execute(insert(ComponentRow).values(**row, positions_mm=array, errors=array))
    assert count(database, ComponentRow) == 0


def fill(database, machine_id):
    with database.writing() as session:
        maps = [insert_error_map(session, machine_id, error_map(x), START) for x in "AB"]
        row = find_machine(session, machine_id, RowLock.CHANGED)
        insert_version(session, row, [m.id for m in maps], {"EXX": "a"}, [], "test", START)
        readings = [Reading(START + timedelta(seconds=s), {"a": 1.0}, {}) for s in range(3)]
        insert_readings(session, {machine_id: readings})
        withdraw_stored(session, row, START, START, START)
        seen = Verification("seen", [Observation(START.timestamp(), (1.0,), "EXX", 5.0)])
        stored = insert_verification(session, machine_id, seen, not_judged(None, "no maps"), START)
        write_watch(session, machine_id, 1, WatchState(), START)
        insert_analysis(session, machine_id, AnalysisTask(1, [stored.id], 0.3, None, 0), START)
        bins = {"whole": frozen([20.0]), "bins": frozen([20.0]), "minutes": {"a": 1}}
        hour = {"machine_id": machine_id, "hour": START, "is_stale": False, **bins}
        session.execute(insert(TemperatureHourRow).values(**hour))
        return maps


OF_THE_SERVICE = {
    *("access_key", "browser_session", "event", "connection_report"),
    *("receiver", "temperature_hours_done"),
}
TABLES_OF_MACHINES = [t for t in Base.metadata.sorted_tables if t.name not in OF_THE_SERVICE]
"""Keys are not a machine's, and what happened to one stays in the log."""


def test_with_a_machine_goes_all_that_belongs_to_it(database):
    fill(database, "m")
    fill(database, "n")
    before = {table: count(database, table) for table in TABLES_OF_MACHINES}
    assert all(before.values())
    with database.writing() as session:
        session.execute(delete(MachineRow).where(MachineRow.id == "m"))
    after = {table: count(database, table) for table in TABLES_OF_MACHINES}
    assert after == {table: rows / 2 for table, rows in before.items()}


def test_a_version_is_written_once(database):
    fill(database, "m")
    with pytest.raises(IntegrityError), database.writing() as session:
        session.execute(
            insert(ModelVersionRow).values(
                machine_id="m",
                version=1,
                created_at=START,
                reason="",
                assignment={},
                effects=[],
            )
        )


def test_a_time_has_one_reading(database):
    first = Reading(START, {"a": 1.0}, {})
    with database.writing() as session:
        assert insert_readings(session, {"m": [first]})["m"].times == {START}
        assert insert_readings(session, {"m": [Reading(START, {"a": 2.0}, {})]})["m"].times == set()
        assert insert_readings(session, {"n": [first]})["n"].times == {START}
    with pytest.raises(IntegrityError), database.writing() as session:
        session.execute(
            insert(ReadingRow).values(machine_id="m", time=START, temperatures_c={}, state={})
        )


def test_a_readings_number_is_never_used_again(database):
    """Other processes take a number up to which they have seen all for just that."""
    fill(database, "m")
    with database.reading() as session:
        newest = newest_id(session)
    with database.writing() as session:
        session.execute(delete(MachineRow).where(MachineRow.id == "m"))
    with database.writing() as session:
        insert_readings(session, {"n": [Reading(START, {"a": 1.0}, {})]})
    with database.reading() as session:
        assert newest_id(session) > newest
