"""Values that an instrument only repeats, and those that are rightly the same."""

import numpy as np

from app.effects.conditions import Conditions
from app.effects.observations import Observation, Verification, observation_rows
from app.identification.residuals.frozen_observations import frozen_rows
from app.search.rows import Datum

STEP_S = 60.0


def rows_of(x_um, z_um=None, positions_mm=None):
    """One verification, a value a minute in one or two channels."""
    observations = []
    for i, value in enumerate(x_um):
        at = 0.0 if positions_mm is None else positions_mm[i]
        observations.append(Observation(i * STEP_S, (float(value),), "EXX", at))
        if z_um is not None:
            observations.append(Observation(i * STEP_S, (float(z_um[i]),), "EZZ", 0.0))
    return observation_rows([Verification("warm-up", observations, Datum.FIRST)])


def conditions_of(rows, rise_k=5.0):
    span = rows.times_s / max(rows.times_s.max(), 1.0)
    return Conditions(rows.times_s, {"room": np.full(len(rows), 20.0), "bed": 20.0 + rise_k * span})


def moving(count, seed=0):
    return np.cumsum(np.random.default_rng(seed).normal(0.0, 1.0, count))


def stopped(values, first, last):
    held = values.copy()
    held[first : last + 1] = held[first]
    return held


def test_a_stopped_log_is_found_from_its_second_value_on():
    rows = rows_of(stopped(moving(60), 20, 40), stopped(moving(60, 1), 20, 40))
    minutes = rows.times_s[frozen_rows(rows, conditions_of(rows))] / STEP_S
    assert sorted(set(minutes)) == list(range(21, 41))
    assert minutes.size == 40


def test_one_channel_that_moves_says_that_the_log_goes_on():
    rows = rows_of(stopped(moving(60), 20, 40), moving(60, 1))
    assert not frozen_rows(rows, conditions_of(rows)).any()


def test_a_machine_at_rest_rightly_repeats_itself():
    rows = rows_of(stopped(moving(60), 20, 40))
    assert not frozen_rows(rows, conditions_of(rows, rise_k=0.5)).any()
    assert frozen_rows(rows, conditions_of(rows)).sum() == 20


def test_ten_minutes_of_one_coarse_value_are_nothing():
    rows = rows_of(stopped(moving(60), 20, 30))
    assert not frozen_rows(rows, conditions_of(rows)).any()


def test_another_place_is_another_measurement():
    rows = rows_of(np.zeros(60), positions_mm=np.linspace(0.0, 500.0, 60))
    assert not frozen_rows(rows, conditions_of(rows)).any()


def test_the_order_of_the_observations_does_not_matter():
    rows = rows_of(stopped(moving(60), 20, 40), stopped(moving(60, 1), 20, 40))
    shuffled = np.random.default_rng(2).permutation(len(rows.verifications[0].observations))
    again = observation_rows(
        [Verification("warm-up", [rows.verifications[0].observations[i] for i in shuffled])]
    )
    found = again.times_s[frozen_rows(again, conditions_of(again))]
    expected = rows.times_s[frozen_rows(rows, conditions_of(rows))]
    np.testing.assert_array_equal(np.sort(found), np.sort(expected))


def rare(minutes, x_um, z_um):
    """Observations as rare as these: a value each in two channels."""
    observations = [
        Observation(STEP_S * minute, (float(value),), code, 0.0)
        for minute, *values in zip(minutes, x_um, z_um, strict=True)
        for code, value in zip(("EXX", "EZZ"), values, strict=True)
    ]
    return observation_rows([Verification("warm-up", observations, Datum.FIRST)])


def test_of_rare_observations_the_first_repeated_value_is_of_nobody_knows_when():
    minutes = np.arange(0.0, 120.0, 10.0)
    rows = rare(minutes, stopped(moving(12), 5, 11), stopped(moving(12, 1), 5, 11))
    found = rows.times_s[frozen_rows(rows, conditions_of(rows, rise_k=20.0))] / STEP_S
    assert sorted(set(found)) == list(range(50, 120, 10))


def test_two_channels_that_repeat_once_for_more_than_ten_minutes_have_stopped():
    minutes = np.arange(0.0, 12 * 10.5, 10.5)
    rows = rare(minutes, stopped(moving(12), 10, 11), stopped(moving(12, 1), 10, 11))
    found = rows.times_s[frozen_rows(rows, conditions_of(rows, rise_k=20.0))] / STEP_S
    assert sorted(set(found)) == [105.0, 115.5]
    alone = rare(minutes, stopped(moving(12), 10, 11), moving(12, 1))
    assert not frozen_rows(alone, conditions_of(alone, rise_k=20.0)).any()


def test_one_tick_of_a_sensor_of_whole_degrees_is_no_movement():
    rows = rows_of(stopped(moving(60), 20, 40), stopped(moving(60, 1), 20, 40))
    ticks = {"motor": 20.0 + (rows.times_s > 30 * STEP_S)}
    assert not frozen_rows(rows, Conditions(rows.times_s, ticks)).any()


def test_the_zero_of_a_visit_stays():
    minutes = np.arange(0.0, 120.0, 10.0)
    rows = rare(minutes, stopped(moving(12), 0, 4), stopped(moving(12, 1), 0, 4))
    found = rows.times_s[frozen_rows(rows, conditions_of(rows, rise_k=20.0))] / STEP_S
    assert sorted(set(found)) == [10.0, 20.0, 30.0, 40.0]
