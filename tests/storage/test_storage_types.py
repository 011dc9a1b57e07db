"""What goes into a database comes out of it: arrays bit for bit, times as UTC, exact numbers."""

import math
import struct
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import insert, make_url, select
from sqlalchemy.exc import StatementError

from app.arrays import frozen
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLine
from app.storage.database import Database
from app.storage.error_maps import insert_error_map, list_error_maps
from app.storage.machines import find_machine, insert_machine, stored_machine
from app.storage.readings import find_readings, insert_readings, list_readings
from app.storage.tables import ComponentRow, ErrorMapRow, ReadingRow
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, Sensor, Travel
from app.thermal.reading import Reading
from tests.service_examples import START

ANY_BITS = st.integers(0, 2**64 - 1).map(lambda i: struct.unpack("<d", struct.pack("<Q", i))[0])
FINITE = st.floats(allow_nan=False, allow_infinity=False)
EDGES = [-0.0, 0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1e-308, 1.7976931348623157e308]
SOME_EXAMPLES = settings(
    max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


class Undone(Exception):
    """Ends a transaction that is not to be kept."""


@pytest.fixture
def database(database_url):
    database = Database(database_url)
    with database.writing() as session:
        insert_machine(session, Machine("m", "M", Chain.parse("XYFZ")), START)
    yield database
    database.close()


def bits(values):
    return np.asarray(values, dtype="<f8").tobytes()


@contextmanager
def undone(database):
    """A transaction that leaves no trace."""
    with suppress(Undone), database.writing() as session:
        yield session
        raise Undone


def stored_array(database, array):
    """Write an array into a component's row and read it back through another query."""
    with undone(database) as session:
        row = ErrorMapRow(
            machine_id="m",
            label="array",
            measured_at=START,
            temperatures_c={},
            measuring_lines_mm={},
            stored_at=START,
        )
        session.add(row)
        session.flush()
        session.execute(
            insert(ComponentRow).values(
                error_map_id=row.id, component="EXX", place=0, positions_mm=array, errors=array
            )
        )
        found = session.execute(select(ComponentRow.errors, ComponentRow.backward_errors)).one()
    assert found.backward_errors is None
    return found.errors


def test_arrays_of_edges_come_back_bit_for_bit(database):
    array = np.array([*EDGES, math.inf, -math.inf, math.nan])
    assert bits(stored_array(database, array)) == bits(array)


@pytest.mark.slow
@SOME_EXAMPLES
@given(st.lists(ANY_BITS, max_size=200))
def test_arrays_of_any_bits_come_back_bit_for_bit(database, values):
    found = stored_array(database, np.array(values, dtype=float))
    assert bits(found) == bits(values)
    assert found.dtype == np.float64


def test_long_arrays_come_back_bit_for_bit(database):
    array = np.random.default_rng(1).standard_normal(100_000)
    assert bits(stored_array(database, array)) == bits(array)


@pytest.mark.parametrize(
    "array",
    [np.arange(6.0)[::2], np.arange(3.0).astype(">f8"), np.arange(3), np.float32([0.5, 1.5])],
    ids=["strided", "big-endian", "integers", "single precision"],
)
def test_arrays_of_another_layout_are_stored_by_value(database, array):
    assert stored_array(database, array).tolist() == array.tolist()


def test_stored_arrays_cannot_be_changed(database):
    with pytest.raises(ValueError, match="read-only"):
        stored_array(database, np.array([1.0]))[0] = 2.0


def test_a_map_comes_back_bit_for_bit(database):
    random = np.random.default_rng(2)
    errors = np.concatenate([random.uniform(-1e6, 1e6, 500), EDGES[:6]])
    positions = np.sort(random.uniform(-1e3, 1e3, errors.size))
    tables = [
        ComponentTable.make(COMPONENTS["EZZ"], errors, positions, errors[::-1]),
        ComponentTable.make(COMPONENTS["SXY"], [-0.0]),
        ComponentTable.make(COMPONENTS["EXX"], [1e-308], [5e-324]),
    ]
    stated = ErrorMap(
        "Run #1 🌡",
        START + timedelta(microseconds=1),
        {"a": 20.1, "b": -0.0},
        {t.component.code: t for t in tables},
        {
            "x": MeasuringLine((0.1, 0.2, 1e-300)),
            "y": MeasuringLine((0.1, 0.2, 0.3), (0.0, 0.0, 1 / 3)),
        },
        0.1,
        "laser",
    )
    with database.writing() as session:
        insert_error_map(session, "m", stated, START)
    with database.reading() as session:
        (found,) = list_error_maps(session, "m")
    kept = found.error_map
    assert list(kept.tables) == ["EZZ", "SXY", "EXX"]
    for code, table in stated.tables.items():
        assert bits(kept.tables[code].positions_mm) == bits(table.positions_mm)
        assert bits(kept.tables[code].errors) == bits(table.errors)
    assert bits(kept.tables["EZZ"].backward_errors) == bits(errors[::-1])
    assert kept.tables["EXX"].backward_errors is None
    for field in ("label", "measured_at", "measuring_lines", "repeatability_um", "instrument"):
        assert getattr(kept, field) == getattr(stated, field)
    assert {k: bits([v]) for k, v in kept.temperatures_c.items()} == {
        k: bits([v]) for k, v in stated.temperatures_c.items()
    }
    assert found.stored_at == START


@SOME_EXAMPLES
@given(st.dictionaries(st.sampled_from("abcdef"), FINITE, min_size=1))
def test_numbers_of_readings_come_back_exactly(database, numbers):
    with undone(database) as session:
        insert_readings(session, {"m": [Reading(START, numbers, numbers)]})
        session.expire_all()
        (found,) = list_readings(session, "m")
    expected = {name: bits([number]) for name, number in numbers.items()}
    for kept in (found.temperatures_c, found.state):
        assert {name: bits([number]) for name, number in kept.items()} == expected


def test_numbers_of_a_machine_come_back_exactly(database):
    numbers = np.random.default_rng(3).uniform(0.0, 1.0, 8).tolist()
    sensor = Sensor("a", None, -numbers[0], *numbers[1:6])
    machine = Machine(
        "n",
        "N",
        Chain.parse("FZX"),
        {"x": Travel(-numbers[6], numbers[7])},
        {"a": sensor},
        extrapolation_margin_c=0.1 + 0.2,
    )
    with database.writing() as session:
        insert_machine(session, machine, START)
    with database.reading() as session:
        assert stored_machine(find_machine(session, "n")).machine == machine


TIMES = [
    START,
    START.astimezone(timezone(timedelta(hours=2))),
    START.astimezone(timezone(timedelta(hours=-9, minutes=-30))),
    START + timedelta(microseconds=1),
    datetime(2026, 3, 29, 1, 30, tzinfo=UTC),  # the hour that summer time leaves out in Europe
    datetime(2026, 10, 25, 0, 30, tzinfo=UTC),
    datetime(2026, 10, 25, 1, 30, tzinfo=UTC),  # the hour that comes twice
    datetime(1900, 1, 1, tzinfo=UTC),
    datetime(2999, 12, 31, 23, 59, 59, 999999, tzinfo=UTC),
]


@pytest.mark.parametrize("zone", ["UTC", "Europe/Berlin", "America/St_Johns", "Asia/Kathmandu"])
def test_times_are_utc_whatever_postgresqls_zone(postgresql_url, zone):
    url = make_url(postgresql_url).update_query_dict({"options": f"-c TimeZone={zone}"})
    times_come_back_as_utc(url.render_as_string(hide_password=False))


def test_times_are_utc_in_sqlite(sqlite_url):
    times_come_back_as_utc(sqlite_url)


def times_come_back_as_utc(url):
    database = Database(url)
    with database.writing() as session:
        insert_machine(session, Machine("m", "M", Chain.parse("XYFZ")), START)
        once = {time.astimezone(UTC): time for time in TIMES}
        insert_readings(session, {"m": [Reading(t, {"a": 1.0}, {}) for t in once.values()]})
    with database.reading() as session:
        found = [reading.time for reading in list_readings(session, "m")]
        assert set(find_readings(session, "m", TIMES)) == set(found)
    database.close()
    assert found == sorted(once)
    assert all(time.tzinfo is UTC for time in found)


def test_a_time_without_a_zone_is_never_stored(database):
    naive = START.replace(tzinfo=None)
    row = {"machine_id": "m", "time": naive, "temperatures_c": {}, "state": {}}
    with pytest.raises(StatementError, match="without a zone"), database.writing() as session:
        session.execute(insert(ReadingRow).values(row))
    with database.reading() as session:
        assert list(list_readings(session, "m")) == []


def test_arrays_of_the_service_are_stored_without_being_changed(database):
    array = frozen([1.0, 2.0])
    stored_array(database, array)
    assert array.tolist() == [1.0, 2.0]
