"""The temperature between two readings."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.thermal.temperature_history import TemperatureHistory


def history(*readings, sensors=("a", "b")):
    return TemperatureHistory.of_readings(sensors, readings)


WARMING = history((0.0, {"a": 20.0}), (60.0, {"a": 23.0, "b": 40.0}), (90.0, {"a": 23.0}))


@pytest.mark.parametrize(
    ("time_s", "expected_c"),
    [(0.0, 20.0), (20.0, 21.0), (59.0, 22.95), (60.0, 23.0), (75.0, 23.0), (90.0, 23.0)],
)
def test_between_readings_it_is_linear_in_time(time_s, expected_c):
    assert WARMING.at("a", [time_s], max_gap_s=120.0)[0] == pytest.approx(expected_c)


def test_known_leaves_out_readings_without_the_sensor():
    times, values = WARMING.series("b")
    assert (times.tolist(), values.tolist()) == ([60.0], [40.0])
    assert np.isnan(WARMING.temperatures_c["b"][[0, 2]]).all()


def test_readings_without_the_sensor_do_not_stand_between_its_neighbours():
    gappy = history((0.0, {"a": 20.0}), (30.0, {"b": 9.0}), (60.0, {"a": 26.0}))
    assert gappy.at("a", [30.0], 60.0).tolist() == [23.0]


def test_a_gap_wider_than_allowed_is_not_bridged_but_its_ends_are_readings():
    wide = history((0.0, {"a": 20.0}), (100.0, {"a": 30.0}))
    assert wide.at("a", [50.0], max_gap_s=100.0).tolist() == [25.0]
    found = wide.at("a", [0.0, 1.0, 50.0, 99.0, 100.0], max_gap_s=99.9)
    np.testing.assert_array_equal(found, [20.0, np.nan, np.nan, np.nan, 30.0])


def test_the_last_reading_serves_for_as_long_and_the_first_not_before_its_time():
    found = WARMING.at("a", [-1e-6, 90.0 + 120.0, 90.0 + 120.1], max_gap_s=120.0)
    np.testing.assert_array_equal(found, [np.nan, 23.0, np.nan])
    np.testing.assert_array_equal(WARMING.at("b", [59.0, 61.0], 120.0), [np.nan, 40.0])


def test_without_readings_there_is_no_temperature():
    assert np.isnan(history().at("a", [0.0, 1.0], 60.0)).all()
    assert np.isnan(history((0.0, {"a": 1.0})).at("b", [0.0], 60.0)).all()
    assert history().times_s.size == 0


@given(
    st.lists(st.integers(0, 10**6), min_size=1, max_size=20, unique=True).map(sorted),
    st.data(),
)
def test_at_its_own_times_each_reading_is_itself(times_s, data):
    values = data.draw(
        st.lists(st.floats(-50.0, 150.0), min_size=len(times_s), max_size=len(times_s))
    )
    made = history(*((float(t), {"a": v}) for t, v in zip(times_s, values, strict=True)))
    for gap_s in (0.5, 1e7):
        np.testing.assert_array_equal(made.at("a", times_s, gap_s), values)


@given(st.lists(st.floats(-100.0, 1200.0), min_size=1, max_size=10))
def test_many_times_are_as_each_alone(times_s):
    together = WARMING.at("a", times_s, 600.0)
    alone = [WARMING.at("a", t, 600.0)[0] for t in times_s]
    np.testing.assert_array_equal(together, alone)
