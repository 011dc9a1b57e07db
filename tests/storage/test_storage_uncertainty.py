"""Uncertainty in the database: bit for bit."""

import numpy as np
import pytest
from sqlalchemy import func, select

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.storage.database import Database
from app.storage.error_maps import insert_error_map, list_error_maps, same_content
from app.storage.machines import insert_machine
from app.storage.tables import ComponentRow
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine
from tests.service_examples import START

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
