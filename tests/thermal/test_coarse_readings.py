"""What a sensor that reads in whole steps says, looking back."""

import numpy as np
import pytest

from app.thermal.coarse_readings import looking_back, step_k

EVERY_S = 240.0
TIMES_S = np.arange(0.0, 3 * 86400.0, EVERY_S)


def warming(times_s):
    """A body that a day and a cycle of four hours warm [°C]."""
    return (
        22.0
        + 3.0 * np.sin(2 * np.pi * times_s / 86400.0)
        + 1.2 * np.sin(2 * np.pi * times_s / 14000.0 + 1.0)
    )


def rounded(temperatures_c, step):
    return np.round(temperatures_c / step) * step


@pytest.mark.parametrize(("step", "share"), [(0.5, 0.7), (1.0, 0.7), (2.0, 0.9)])
def test_a_record_is_known_better_than_its_readings_and_as_well_as_is_said(step, share):
    true = warming(TIMES_S)
    read = rounded(true, step)
    found = looking_back(TIMES_S, read, 900.0)
    assert found.step_k == step
    off, raw = found.temperatures_c - true, read - true
    assert np.sqrt(np.mean(off**2)) < share * np.sqrt(np.mean(raw**2))
    assert np.abs(found.temperatures_c - read).max() <= step / 2 + 1e-9
    assert np.sqrt(np.mean(off**2)) < found.error_k
    # One stay for each time that the reading stays.
    assert found.stay[0] == 0
    assert (np.diff(found.stay) == (np.diff(read) != 0.0)).all()


def test_where_the_reading_changes_the_temperature_is_the_middle_between_the_two():
    read = np.repeat([20.0, 21.0, 22.0, 23.0], 20)
    found = looking_back(np.arange(80) * 60.0, read, 900.0).temperatures_c
    changes = np.array([20, 40, 60])
    middles = (found[changes] + found[changes - 1]) / 2
    assert middles == pytest.approx([20.5, 21.5, 22.5], abs=0.03)
    assert (np.diff(found) >= 0.0).all()


def test_a_change_that_nobody_saw_come_says_nothing_of_when_it_came():
    times_s = np.arange(80) * 60.0
    times_s[40:] += 6 * 3600.0
    read = np.repeat([20.0, 21.0, 22.0, 23.0], 20)
    found, seen = (looking_back(at_s, read, 900.0) for at_s in (times_s, np.arange(80) * 60.0))
    assert seen.temperatures_c[39:41] == pytest.approx([21.5, 21.5], abs=0.03)
    # The one in the middle of the second stay, where nothing else is known of it.
    assert found.temperatures_c[39] == pytest.approx(21.0, abs=0.1)
    assert found.temperatures_c[40] == pytest.approx(22.0, abs=0.1)


@pytest.mark.parametrize(
    "read",
    [
        warming(TIMES_S),
        rounded(warming(TIMES_S), 0.1),
        np.full(100, 21.0),
        np.array([20.0, 21.0, 22.0, 23.0]),
        np.append(rounded(warming(TIMES_S), 1.0), 21.3),
    ],
    ids=["any", "tenths", "still", "four readings", "one between"],
)
def test_what_is_not_read_in_coarse_steps_stays_as_it_is(read):
    assert step_k(read) == 0.0
    assert looking_back(np.arange(len(read)) * EVERY_S, read, 900.0) is None
