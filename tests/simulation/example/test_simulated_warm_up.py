"""The runs warm up as in 8.2.7; the live temperatures repeat, lag, and stay between the maps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import UnknownThing
from app.simulation.example.machine import SENSORS, example_machine
from app.simulation.example.warm_up import PERIOD_S, RUNS, run_temperatures, temperatures_at
from app.thermal.sensor_health import Health, judged_record
from app.thermal.temperature_history import TemperatureHistory

COLD, HOT = run_temperatures(1), run_temperatures(6)


@pytest.fixture(scope="module")
def cycle():
    """One period, second by second: sensor to temperatures [°C]."""
    states = [temperatures_at(second) for second in np.arange(PERIOD_S)]
    return {sensor: np.array([state[sensor] for state in states]) for sensor in SENSORS}


def test_every_sensor_is_warmer_in_every_later_run():
    example = example_machine()
    for sensor in SENSORS:
        steps = np.diff([run_temperatures(n)[sensor] for n in RUNS])
        assert steps.min() > example.sensor(sensor).resolution_c


def test_the_main_heating_is_near_the_spindle():
    # 8.2.7: "the main heating occurs in parts close to the spindle".
    rise = {sensor: HOT[sensor] - COLD[sensor] for sensor in SENSORS}
    assert rise["spindle"] > rise["z-column"] > rise["x-middle"]


def test_y_front_is_the_same_as_x_middle(cycle):
    # 8.2.9: "x-middle (same as the y-front)".
    for n in RUNS:
        state = run_temperatures(n)
        assert abs(state["x-middle"] - state["y-front"]) <= 0.2
    assert np.abs(cycle["x-middle"] - cycle["y-front"]).max() <= 0.2


@pytest.mark.parametrize("number", [0, 7, -1])
def test_other_runs_are_refused_with_what_exists(number):
    with pytest.raises(UnknownThing, match=r"1, 2, 3, 4, 5, 6"):
        run_temperatures(number)


@given(st.floats(0.0, 4e9))
def test_live_temperatures_stay_between_run_1_and_run_6(time_s):
    for sensor, temperature in temperatures_at(time_s).items():
        assert COLD[sensor] < temperature < HOT[sensor]


def test_the_bed_is_colder_on_the_way_up_than_on_the_way_down(cycle):
    middle = (COLD["spindle"] + HOT["spindle"]) / 2
    warmer = cycle["spindle"] > middle
    up = np.flatnonzero(warmer & ~np.roll(warmer, 1)).item()
    down = np.flatnonzero(~warmer & np.roll(warmer, 1)).item()
    assert cycle["x-middle"][down] - cycle["x-middle"][up] > 1.0
    assert cycle["z-column"][down] - cycle["z-column"][up] > 1.0


def test_two_periods_of_readings_look_healthy():
    times = np.arange(0.0, 2 * PERIOD_S, 10.0)
    history = TemperatureHistory.of_readings(SENSORS, [(t, temperatures_at(t)) for t in times])
    example = example_machine()
    strict = {n: replace(s, max_rate_c_per_min=3.0) for n, s in example.sensors.items()}
    states = judged_record(replace(example, sensors=strict), history).states
    assert {state.health for state in states} == {Health.OK}
