"""How fast a temperature changes at its last reading: courses whose slope is known."""

import numpy as np
import pytest

from app.simulation.example.warm_up import PERIOD_S, temperatures_at
from app.status.sensor_rate import rate_k_per_h

EVERY_MIN_S = np.arange(-1800.0, 1.0, 60.0)


def test_a_noisy_straight_course_is_taken_over_all_of_the_half_hour():
    noise = np.random.default_rng(3).normal(0.0, 0.3, EVERY_MIN_S.size)
    found = rate_k_per_h(EVERY_MIN_S, 20.0 + EVERY_MIN_S / 3600.0 + noise, 0.1)
    # Standard error of the line: 0.3 K / (√31 · 0.149 h) = 0.36 K/h; of 4 min alone it were 8 K/h.
    assert found == pytest.approx(1.0, abs=1.1)


def test_steps_of_a_coarse_sensor_are_no_bend():
    steps = np.round(20.0 + 2.0 * EVERY_MIN_S / 3600.0)
    assert rate_k_per_h(EVERY_MIN_S, steps, 1.0) == pytest.approx(
        rate_k_per_h(EVERY_MIN_S, steps, 100.0)
    )


def test_what_turned_is_told_by_what_it_does_since():
    fell_then_rose = 20.0 + np.abs(EVERY_MIN_S + 600.0) / 60.0
    assert rate_k_per_h(EVERY_MIN_S, fell_then_rose, 0.1) == pytest.approx(60.0)


def test_of_a_few_readings_far_apart_a_bend_leaves_the_line_that_there_is():
    times = np.array([-1800.0, -900.0, 0.0])
    assert rate_k_per_h(times, np.array([20.0, 30.0, 20.0]), 0.1) == 0.0


@pytest.mark.parametrize(("n", "over_s"), [(0, 0.0), (2, 600.0), (100, 179.0)])
def test_too_little_gives_no_rate(n, over_s):
    times = np.linspace(-over_s, 0.0, n)
    assert rate_k_per_h(times, np.full(n, 20.0), 0.1) is None


@pytest.mark.parametrize("phase", [0.03, 0.33, 0.53, 0.83])
def test_the_demonstration_s_figure_is_the_slope_of_the_curve_beside_it(phase):
    """Its 20 minutes are shorter than the half hour, and one line through all of them says nothing.

    The line of the last minutes is as steep as the curve was in their middle.
    """
    now = phase * PERIOD_S
    times = now + np.arange(-1800.0, 1.0)
    temperatures = [temperatures_at(t) for t in times]
    for sensor in ("spindle", "z-column", "x-middle"):
        values = np.array([one[sensor] for one in temperatures])
        slopes = np.gradient(values[-226:], 1.0 / 3600.0)
        found = rate_k_per_h(times, values, 0.1)
        assert slopes.min() - 1.0 <= found <= slopes.max() + 1.0, sensor
