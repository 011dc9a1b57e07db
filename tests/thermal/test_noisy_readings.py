"""What a sensor whose readings scatter says, looking back."""

import numpy as np
import pytest

from app.thermal.noisy_readings import scatter_k, without_noise

MAX_GAP_S = 900.0


def warming(times_s):
    """A body that a day and a cycle of four hours warm [°C]."""
    return (
        22.0
        + 3.0 * np.sin(2 * np.pi * times_s / 86400.0)
        + 1.2 * np.sin(2 * np.pi * times_s / 14000.0 + 1.0)
    )


def record(noise_k, every_s, seed=1, days=3.0):
    times_s = np.arange(0.0, days * 86400.0, every_s)
    true = warming(times_s)
    noise = np.random.default_rng(seed).normal(0.0, noise_k, len(times_s))
    return times_s, true, np.round(true + noise, 2)


@pytest.mark.parametrize("noise_k", [0.15, 0.3, 0.5])
@pytest.mark.parametrize("every_s", [60.0, 180.0, 600.0])
def test_a_record_is_known_better_than_its_readings_and_as_well_as_is_said(noise_k, every_s):
    times_s, true, read = record(noise_k, every_s)
    found = without_noise(times_s, read, MAX_GAP_S)
    assert found.scatter_k == pytest.approx(noise_k, rel=0.15)
    off = np.sqrt(np.mean((found.temperatures_c - true) ** 2))
    assert off < 0.6 * noise_k
    assert off == pytest.approx(found.error_k, rel=0.3)
    # Stretches follow each other, each of several readings.
    assert found.stay[0] == 0
    assert set(np.diff(found.stay)) == {0, 1}
    assert len(found.stay) > 2 * found.stay[-1]


def test_a_quiet_sensor_stays_as_it_is():
    times_s, _, read = record(0.03, 180.0)
    assert without_noise(times_s, read, MAX_GAP_S) is None


def test_what_a_temperature_does_between_rare_readings_is_no_scatter():
    times_s, _, read = record(0.0, 3600.0)
    assert scatter_k(times_s, read, 7200.0) == 0.0


def test_readings_that_follow_each_other_do_not_scatter():
    times_s, true, _ = record(0.0, 180.0)
    walk = np.cumsum(np.random.default_rng(2).normal(0.0, 0.3, len(times_s)))
    assert without_noise(times_s, true + walk, MAX_GAP_S) is None


def test_readings_beyond_a_gap_say_nothing():
    times_s, true, read = record(0.3, 180.0)
    late = times_s > 86400.0
    found = without_noise(times_s + 36000.0 * late, read + 15.0 * late, MAX_GAP_S)
    off = found.temperatures_c - true - 15.0 * late
    assert np.abs(off).max() < 1.0
    assert found.stay[late][0] > found.stay[~late][-1]


def test_few_readings_say_nothing_of_their_scatter():
    times_s, _, read = record(0.5, 180.0, days=0.05)
    assert without_noise(times_s, read, MAX_GAP_S) is None
