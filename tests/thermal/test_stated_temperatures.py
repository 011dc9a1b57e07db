"""Temperatures that a map states, held against those that were recorded at its time."""

import pytest

from app.thermal.stated_temperatures import doubted_temperatures, exchanged_temperatures

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


OTHERS = [
    {"bed": 20.0, "column": 20.3, "head": 20.8},
    {"bed": 22.5, "column": 24.7, "head": 26.8},
    {"bed": 25.5, "column": 28.7, "head": 35.0},
]


def test_two_that_lie_the_other_way_round_in_all_other_maps():
    right = {"bed": 24.6, "column": 25.8, "head": 28.6}
    assert exchanged_temperatures(right, OTHERS) == []
    (said,) = exchanged_temperatures(right | {"bed": 28.6, "head": 24.6}, OTHERS)
    assert said == (
        "head is 4.0 K below bed, where the other maps have it 0.8 to 9.5 K above: "
        "are the two exchanged?"
    )


@pytest.mark.parametrize(
    ("stated", "others"),
    [
        ({"bed": 28.6, "column": 25.8, "head": 24.6}, OTHERS[:1]),  # which is the exception?
        ({"bed": 20.4, "head": 20.2}, OTHERS),  # by chance
        ({"bed": 24.0, "column": 21.0}, [*OTHERS, {"bed": 24.0, "column": 23.0}]),  # both ways
        ({"bed": 45.0, "head": 21.0}, OTHERS),  # exchanged they would not fit either
        ({"bed": 24.0}, OTHERS),
    ],
)
def test_what_nobody_can_say_of_two_sensors(stated, others):
    assert exchanged_temperatures(stated, others) == []
