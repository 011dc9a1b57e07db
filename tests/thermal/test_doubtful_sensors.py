"""Sensors that left their neighbours for good; heat that comes and goes is none of that."""

import numpy as np
import pytest

from app.thermal.doubtful_sensors import doubtful_sensors, without_doubtful
from app.thermal.temperature_history import TemperatureHistory

DAY_S = 86400.0
DAYS = 10
TIMES_S = np.arange(0.0, DAYS * DAY_S, 600.0)


def daily(amplitude_k, phase_h=0.0):
    return 20.0 + amplitude_k * np.sin(2 * np.pi * (TIMES_S / DAY_S - phase_h / 24.0))


def machine_room(seed=1, **extra):
    """Six sound sensors: the room, slower and weaker masses, and a spindle on two shifts."""
    rng = np.random.default_rng(seed)
    at_work = (TIMES_S % DAY_S > 6 * 3600.0) & (TIMES_S % DAY_S < 18 * 3600.0)
    found = {
        "room": daily(3.0),
        "bed": daily(1.0, 6.0),
        "x-middle": daily(2.0, 2.0),
        "z-column": daily(1.5, 3.0),
        "y-front": daily(2.1, 2.5),
        "spindle": daily(2.0, 1.0) + 15.0 * at_work,
    }
    noisy = {name: v + rng.normal(0.0, 0.05, v.size) for name, v in found.items()}
    return TemperatureHistory(TIMES_S, {**noisy, **extra})


def failed(history, sensor, by_k, since_s, slowly_s=0.0):
    share = np.clip((TIMES_S - since_s) / max(slowly_s, 1.0), 0.0, 1.0)
    return TemperatureHistory(
        TIMES_S,
        {**history.temperatures_c, sensor: history.temperatures_c[sensor] + by_k * share},
    )


@pytest.mark.parametrize("seed", range(5))
def test_sound_sensors_are_not_doubted(seed):
    assert doubtful_sensors(machine_room(seed)) == []


@pytest.mark.parametrize("by_k", [-12.0, 30.0])
@pytest.mark.parametrize("slowly_s", [0.0, 5 * 3600.0])
def test_a_sensor_that_leaves_is_named_with_its_time_and_size(by_k, slowly_s):
    since_s = 4.3 * DAY_S
    (one,) = doubtful_sensors(failed(machine_room(), "bed", by_k, since_s, slowly_s))
    assert one.sensor == "bed"
    assert one.off_by_k == pytest.approx(by_k, abs=1.5)
    assert since_s - 3600.0 <= one.since_s <= since_s + max(slowly_s, 3600.0)


def test_two_sensors_that_fail_are_both_named():
    history = failed(machine_room(), "bed", 30.0, 4.0 * DAY_S)
    history = failed(history, "y-front", -20.0, 6.0 * DAY_S)
    assert [one.sensor for one in doubtful_sensors(history)] == ["bed", "y-front"]


def test_what_comes_back_is_heat_and_not_a_failure():
    history = machine_room()
    lamp = 8.0 * ((TIMES_S > 4 * DAY_S) & (TIMES_S < 7 * DAY_S) & (TIMES_S % DAY_S < 40000.0))
    bed = history.temperatures_c["bed"] + lamp
    assert (
        doubtful_sensors(TemperatureHistory(TIMES_S, {**history.temperatures_c, "bed": bed})) == []
    )


def test_an_air_conditioning_that_changes_everything_is_no_failure():
    cooler = {n: v - 6.0 * (TIMES_S > 5 * DAY_S) for n, v in machine_room().temperatures_c.items()}
    assert doubtful_sensors(TemperatureHistory(TIMES_S, cooler)) == []


def test_too_little_to_judge():
    history = failed(machine_room(), "bed", 30.0, 4.0 * DAY_S)
    three = {n: history.temperatures_c[n] for n in ("bed", "room", "spindle")}
    assert doubtful_sensors(TemperatureHistory(TIMES_S, three)) == []
    one_day = TIMES_S < DAY_S
    short = {
        n: v[one_day]
        for n, v in failed(machine_room(), "bed", 30.0, DAY_S / 2).temperatures_c.items()
    }
    assert doubtful_sensors(TemperatureHistory(TIMES_S[one_day], short)) == []
    assert (
        doubtful_sensors(TemperatureHistory(np.empty(0), dict.fromkeys("abcd", np.empty(0)))) == []
    )


def test_gaps_and_silent_sensors_do_not_matter():
    history = failed(machine_room(), "bed", 30.0, 4.0 * DAY_S)
    values = {n: v.copy() for n, v in history.temperatures_c.items()}
    values["room"][:] = np.nan
    values["z-column"][: TIMES_S.size // 2] = np.nan
    for v in values.values():
        v[(TIMES_S > 2 * DAY_S) & (TIMES_S < 3 * DAY_S)] = np.nan
    found = doubtful_sensors(TemperatureHistory(TIMES_S, values))
    assert [one.sensor for one in found] == ["bed"]


def test_only_what_came_after_is_left_out():
    history = failed(machine_room(), "bed", 30.0, 4.0 * DAY_S)
    doubtful = doubtful_sensors(history)
    cleaned = without_doubtful(history, doubtful)
    lost = np.isnan(cleaned.temperatures_c["bed"])
    assert np.array_equal(lost, doubtful[0].since_s <= TIMES_S)
    for name in history.temperatures_c:
        kept = ~np.isnan(cleaned.temperatures_c[name])
        np.testing.assert_array_equal(
            cleaned.temperatures_c[name][kept], history.temperatures_c[name][kept]
        )
