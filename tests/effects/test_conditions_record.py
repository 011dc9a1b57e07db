"""Conditions read off a record, and carried along live."""

import tracemalloc

import numpy as np
import pytest

from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import (
    Conditions,
    RecordedLags,
    Signal,
    StatedStates,
    recorded_conditions,
)
from app.effects.valid import Valid
from app.thermal.machine import Sensor
from app.thermal.temperature_history import TemperatureHistory

SENSORS = {"a": Sensor("a", max_age_s=300.0), "b": Sensor("b", max_age_s=300.0)}


def record(times_s, wanted_s, states=(), own=None):
    a = 20.0 + np.sin(np.asarray(times_s) / 2000.0)
    history = TemperatureHistory(np.asarray(times_s, dtype=float), {"a": a})
    return recorded_conditions(SENSORS, history, states, np.asarray(wanted_s, dtype=float), own)


def test_temperatures_are_interpolated_and_states_are_held():
    found = record([0.0, 100.0], [50.0, 100.0], [(0.0, {"rpm": 1.0}), (100.0, {"rpm": 2.0})])
    assert found.temperature("a")[0] == pytest.approx(20.0 + np.sin(0.05) / 2)
    assert found.state("rpm").tolist() == [1.0, 2.0]
    assert np.isnan(found.temperature("b")).all()
    assert np.isnan(found.state("feed")).all()


def test_a_state_beside_an_observation_goes_before_the_readings():
    states = [(0.0, {"rpm": 1.0})]
    found = record([0.0, 100.0], [50.0, 60.0], states, {"rpm": np.array([np.nan, 9.0])})
    assert found.state("rpm").tolist() == [1.0, 9.0]


def test_a_name_of_its_own_in_each_row_does_not_fill_the_memory():
    n = 4000
    stated = StatedStates([{f"s{i}": 1.0} for i in range(n)])
    recorded = [(float(i), {f"r{i}": 2.0}) for i in range(n)]
    learnt = Valid(0.0, 1.0, state={"s7": (5.0, 9.0)})
    tracemalloc.start()
    try:
        found = learnt.held(record([0.0, n], np.arange(n), recorded, stated)).take(np.arange(10))
        assert (len(found.states), found.state("r3")[3], found.state("s7")[7]) == (2 * n, 2.0, 5.0)
        assert tracemalloc.get_traced_memory()[1] < 8 * n * n / 4  # all would be as much twice
    finally:
        tracemalloc.stop()


def test_an_old_state_is_not_known():
    found = record([0.0, 100.0], [299.0, 301.0], [(0.0, {"rpm": 1.0})])
    assert np.isnan(found.state("rpm")).tolist() == [False, True]


def test_rates_are_per_hour():
    times = np.arange(0.0, 3601.0, 60.0)
    history = TemperatureHistory(times, {"a": 20.0 + times / 3600.0 * 3.0})
    found = recorded_conditions(SENSORS, history, [], np.array([1800.0]))
    assert found.rates_c_per_h["a"].tolist() == pytest.approx([3.0])


def test_live_filters_give_what_the_record_gives():
    """At a reading both are the same number; a squared state is filtered squared."""
    times = np.arange(0.0, 40000.0, 100.0)
    rpm = [(t, {"rpm": 1000.0 * (t // 3000 % 3)}) for t in times.tolist()]
    recorded = record(times, times, rpm)
    signals = {(Signal("temperature", "a"), 1200.0), (Signal("state", "rpm", 2), 700.0)}
    live = LiveLags(dict.fromkeys(signals), {("temperature", "a"): 300.0, ("state", "rpm"): 300.0})
    a = 20.0 + np.sin(times / 2000.0)
    for t, value, (_, state) in zip(times.tolist(), a.tolist(), rpm, strict=True):
        live = live.update(t, {"a": value}, state)
    now = Conditions.of_moment(times[-1], {"a": a[-1]}, rpm[-1][1], live)
    for signal, tau in signals:
        expected = recorded.lagged(signal, tau)[-1]
        assert np.isfinite(expected)
        assert now.lagged(signal, tau).tolist() == pytest.approx([expected], rel=1e-12)


def test_what_follows_a_state_is_as_late_as_it_is_however_seldom_the_state_is_read():
    """The spindle starts at any moment between two readings, which are four minutes apart."""
    every_s, tau_s = 240.0, 2400.0
    times_s = np.arange(0.0, 60_000.0, every_s)
    wanted_s = np.arange(31_000.0, 40_000.0, 500.0)
    signal, found, true, live = Signal("state", "rpm"), [], [], []
    for began_s in 30_000.0 + every_s * (np.arange(24) + 0.5) / 24:
        states = [(t, {"rpm": 1.0 * (t >= began_s)}) for t in times_s.tolist()]
        found.append(record(times_s, wanted_s, states).lagged(signal, tau_s))
        true.append(1.0 - np.exp(-(wanted_s - began_s) / tau_s))
        lags = LiveLags({(signal, tau_s): None})
        for time_s, state in states:
            lags = lags.update(time_s, {}, state) if time_s <= wanted_s[0] else lags
        live.append(lags.lagged(signal, tau_s, wanted_s[:1]))
    np.testing.assert_allclose(np.mean(found, axis=0), np.mean(true, axis=0), atol=1e-3)
    np.testing.assert_allclose(np.mean(live), np.mean(true, axis=0)[0], atol=1e-3)


def test_what_a_sensor_read_at_another_time_is_free_of_single_readings_noise():
    times_s = np.arange(0.0, 3600.0, 60.0)
    noise = np.random.default_rng(1).normal(0.0, 0.1, times_s.size)

    def parabola_c(at_s):
        return 20.0 + at_s / 600.0 + (at_s / 1000.0) ** 2

    wanted_s = np.arange(600.0, 2000.0, 60.0)
    for off_c, close in ((0.0, 1e-12), (noise, 0.05)):
        history = TemperatureHistory(times_s, {"a": parabola_c(times_s) + off_c})
        later = recorded_conditions(SENSORS, history, (), wanted_s).temperature_later("a", 900.0)
        assert np.std(later - parabola_c(wanted_s + 900.0)) < close
    assert np.std(noise) > 0.08


def test_what_a_sensor_read_near_the_beginning_of_its_record_is_what_is_known_to_both_sides():
    times_s = np.arange(0.0, 3600.0, 60.0)
    read_c = np.random.default_rng(1).normal(20.0, 0.1, times_s.size)
    early = recorded_conditions(
        SENSORS, TemperatureHistory(times_s, {"a": read_c}), (), np.array([600.0, 720.0, 590.0])
    )
    found = early.temperature_later("a", -600.0)
    assert found[0] == pytest.approx(read_c[0])
    # Savitzky, Golay 1964, five readings.
    assert found[1] == pytest.approx(np.dot([-3, 12, 17, 12, -3], read_c[:5]) / 35)
    assert np.isnan(found[2])
    assert early.is_known_later("a", -600.0).tolist() == [True, True, False]


def test_a_live_filter_goes_stale():
    live = LiveLags({(Signal("temperature", "a"), 10.0): None}, {("temperature", "a"): 300.0})
    for t in range(0, 200, 10):
        live = live.update(float(t), {"a": 20.0}, {})
    signal = Signal("temperature", "a")
    assert live.lagged(signal, 10.0, np.array([200.0, 600.0])).tolist() == [
        20.0,
        pytest.approx(np.nan, nan_ok=True),
    ]


def test_too_little_history_is_said_in_minutes():
    found = record(np.arange(0.0, 3601.0, 60.0), [3600.0])
    signal = Signal("temperature", "a")
    assert np.isfinite(found.lagged(signal, 720.0)).all()
    assert np.isnan(found.lagged(signal, 721.0)).all()
    assert found.why_missing(signal, 2400.0) == (
        "expected 200 min of readings of a beforehand (five time constants), got 60 min"
    )
    assert found.why_missing(Signal("state", "rpm")) == "no state rpm (there are none)"


def test_what_readings_state_but_not_at_that_time_is_not_said_to_be_lacking_altogether():
    states = [(0.0, {"rpm": 1000.0})]
    history = TemperatureHistory(np.array([0.0]), {"a": np.array([20.0])})
    sensors = {"a": Sensor("a", max_age_s=300.0)}
    found = recorded_conditions(sensors, history, states, np.array([1e6]))
    assert np.isnan(found.state("rpm")).all()
    told = found.why_missing(Signal("state", "rpm"))
    assert told == "no reading states rpm at that time"
    told = found.why_missing(Signal("temperature", "a"))
    assert told == "no usable reading of a at that time"


def test_rows_that_are_taken_share_the_past():
    found = record(np.arange(0.0, 7200.0, 60.0), [3600.0, 5000.0, 7000.0])
    some = found.take(np.array([2, 0]))
    signal = Signal("temperature", "a")
    np.testing.assert_array_equal(some.lagged(signal, 300.0), found.lagged(signal, 300.0)[[2, 0]])
    assert isinstance(some.lags, RecordedLags)
    assert len(some) == 2
