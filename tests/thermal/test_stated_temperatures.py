"""Temperatures that a map states, held against those that were recorded at its time."""

import pytest

from app.thermal.stated_temperatures import doubted_temperatures

RECORDED = {"bed": 24.0, "column": 26.0, "head": 31.0}


@pytest.mark.parametrize(
    "stated",
    [
        {"bed": 24.0, "column": 26.0, "head": 31.0},
        {"bed": 25.5, "column": 27.5, "head": 33.5},  # it warmed up while it was measured
        {"bed": 24.3, "column": 24.9},
        {"other": 90.0},
    ],
)
def test_what_fits_and_what_nobody_recorded(stated):
    assert doubted_temperatures(stated, RECORDED) == []


def test_two_that_were_exchanged():
    (said,) = doubted_temperatures(RECORDED | {"bed": 26.1, "column": 24.0}, RECORDED)
    assert said == (
        "readings of its time say bed 24.0 °C, column 26.0 °C, where it states 26.1 and 24.0 °C: "
        "are the two exchanged?"
    )


def test_one_that_is_far_off():
    (said,) = doubted_temperatures(RECORDED | {"bed": 28.0}, RECORDED)
    assert said.endswith("is the sensor, the temperature or the time mistaken?")
