"""What sensors said at a recorded moment, as far as they were believed then."""

from datetime import timedelta

from app.services.recorded_change import _temperatures
from app.thermal.reading import Reading
from tests.service_examples import START
from tests.thermal.example_maps import machine


def reading(seconds, x_middle):
    time = START + timedelta(seconds=seconds)
    return Reading(time, {"x-middle": x_middle, "z-column": 27.0}, {})


def test_a_value_that_jumped_is_no_temperature_of_a_moment():
    steady = [reading(10.0 * i, 25.0) for i in range(8)]
    model = machine()
    now = START + timedelta(seconds=80)
    assert _temperatures(model, steady, now) == {"x-middle": 25.0, "z-column": 27.0}
    assert _temperatures(model, [*steady, reading(80.0, 31.5)], now) == {"z-column": 27.0}
    assert _temperatures(model, [*steady, reading(80.0, 999.0)], now) == {"z-column": 27.0}
    assert _temperatures(model, [], now) == {}
