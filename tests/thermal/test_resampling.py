"""Tables of different positions brought together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import Conflict
from app.thermal.resampling import common_positions, sample_table
from tests.thermal.example_maps import table


def zeros(*positions_mm):
    return table("EXX", np.zeros(len(positions_mm)), positions_mm)


@pytest.mark.parametrize(
    ("grids", "expected"),
    [
        ([(0, 50, 100), (0, 50, 100)], [0, 50, 100]),
        # The union, inside what both cover.
        ([(0, 100, 200), (50, 150)], [50, 100, 150]),
        ([(0, 400), (-100, 30, 350), (10, 500)], [10, 30, 350]),
        # Not equidistant, and one inside the other.
        ([(0, 1, 3, 7, 100), (2, 50)], [2, 3, 7, 50]),
        # One position limits nothing; inside the range it is a position like any other.
        ([(0, 100), (250,)], [0, 100]),
        ([(0, 100), (25,)], [0, 25, 100]),
        ([(250,), (100,)], [100, 250]),
        ([(250,)], [250]),
    ],
)
def test_common_positions_by_hand(grids, expected):
    assert common_positions([zeros(*g) for g in grids]).tolist() == expected
    assert common_positions([zeros(*g) for g in reversed(grids)]).tolist() == expected


def test_without_argument_there_are_no_positions():
    assert common_positions([table("SXY", [1.0]), table("SXY", [2.0])]).size == 0


@pytest.mark.parametrize("second", [(150.0, 250.0), (100.0, 250.0)])
def test_tables_that_only_touch_or_miss_each_other_are_refused(second):
    """One shared point would pass for an error that does not depend on position."""
    with pytest.raises(Conflict) as refusal:
        common_positions([zeros(0.0, 100.0), zeros(*second)])
    assert refusal.value.detail == (
        "expected the maps' tables of EXX to share a range of positions, got a highest start "
        f"of {second[0]:g} mm and a lowest end of 100 mm"
    )


def test_samples_by_hand():
    exx = table("EXX", [0.0, 10.0, 4.0], [0.0, 100.0, 400.0], [1.0, 11.0, 5.0])
    at = np.array([50.0, 100.0, 250.0])
    assert sample_table(exx, at).tolist() == [5.0, 10.0, 7.0]
    assert sample_table(exx, at, backward=True).tolist() == [6.0, 11.0, 8.0]


def test_a_table_of_one_direction_serves_both():
    exx = table("EXX", [0.0, 10.0], [0.0, 100.0])
    assert sample_table(exx, np.array([50.0]), backward=True).tolist() == [5.0]


def test_one_position_and_one_value_hold_everywhere():
    assert sample_table(table("EXX", [3.5], [250.0]), np.array([0.0, 999.0])).tolist() == [3.5, 3.5]
    assert sample_table(table("SXY", [3.5]), np.empty(0)).tolist() == [3.5]


positions = st.lists(
    st.integers(-(10**6), 10**6).map(lambda um: um / 1000), min_size=2, max_size=30, unique=True
).map(sorted)


@given(positions, st.data())
def test_a_tables_own_positions_are_reproduced_to_the_last_bit(positions_mm, data):
    errors = data.draw(
        st.lists(st.floats(-1e6, 1e6), min_size=len(positions_mm), max_size=len(positions_mm))
    )
    made = table("EXX", errors, positions_mm)
    np.testing.assert_array_equal(sample_table(made, made.positions_mm), errors)
