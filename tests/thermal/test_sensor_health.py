"""Whether a sensor can be believed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.thermal.machine import Sensor
from app.thermal.sensor_health import (
    Health,
    are_in_range,
    believed,
    check_temperatures,
    grow_older,
    judge_record,
    judged_record,
    without_stuck,
)
from app.thermal.temperature_history import TemperatureHistory
from tests.thermal.example_maps import machine

MINUTE = 60.0

# Defaults of a sensor: stale after 600 s, stuck after 3600 s, 0.1 °C.
THREE = machine(*(Sensor(name, max_rate_c_per_min=10.0) for name in "abc"))


def assessed(readings, sensors=THREE):
    history = TemperatureHistory.of_readings(sensors.sensors, readings)
    return {state.sensor: state for state in judged_record(sensors, history).states}


def every_ten_minutes(hours, **temperatures):
    """Readings as functions of the time in hours, or a constant."""
    return [
        (
            i * 600.0,
            {k: f(i / 6) if callable(f) else f for k, f in temperatures.items() if f is not None},
        )
        for i in range(hours * 6 + 1)
    ]


def health(states):
    return {name: str(state.health) for name, state in states.items()}


# --- missing, stale, out of range --------------------------------------------------------


def test_all_is_well():
    states = assessed([(0.0, {"a": 20.0, "b": 21.0, "c": 22.0})])
    assert health(states) == {"a": "ok", "b": "ok", "c": "ok"}
    assert (states["b"].temperature_c, states["b"].age_s, states["b"].detail) == (21.0, 0.0, "")


def test_a_sensor_that_no_reading_has_is_missing():
    states = assessed([(0.0, {"a": 20.0, "b": 20.0})])
    assert states["c"].health is Health.MISSING
    assert (states["c"].temperature_c, states["c"].age_s) == (None, None)
    assert states["c"].detail == "c is missing: no reading has it"
    assert set(health(assessed([])).values()) == {"missing"}


def test_a_sensor_that_falls_silent_is_stale_after_its_maximum_age():
    """Age counts from its own last value to the latest reading of any sensor."""
    just = assessed([(0.0, {"a": 20.0, "b": 20.0}), (600.0, {"b": 20.0})])
    assert just["a"].health is Health.OK
    assert (just["a"].age_s, just["b"].age_s) == (600.0, 0.0)
    late = assessed([(0.0, {"a": 20.0, "b": 20.0}), (601.0, {"b": 20.0})])
    assert late["a"].health is Health.STALE
    assert late["a"].temperature_c == 20.0
    assert "last value is 601 s old, at most 600 s are allowed" in late["a"].detail


def test_time_without_readings_makes_stale():
    states = assessed([(0.0, {"a": 20.0, "b": 300.0, "c": 20.0})])
    soon = {s.sensor: s for s in grow_older(THREE, states.values(), 600.0)}
    assert health(soon) == {"a": "ok", "b": "out-of-range", "c": "ok"}
    assert soon["a"].age_s == 600.0
    later = {s.sensor: s for s in grow_older(THREE, soon.values(), 0.5)}
    # What is worse than stale stays so.
    assert health(later) == {"a": "stale", "b": "out-of-range", "c": "stale"}
    assert later["b"].age_s == 600.5


def test_a_stale_sensor_is_told_with_the_age_that_it_has_now():
    late = assessed([(0.0, {"a": 20.0, "b": 20.0}), (700.0, {"b": 20.0})])
    days = {s.sensor: s for s in grow_older(THREE, late.values(), 258_500.0)}
    assert days["a"].age_s == 259_200.0
    assert "last value is 3 days old" in days["a"].detail


def test_after_one_wrong_first_value_the_sentence_says_how_to_be_rid_of_it():
    (a, *_) = assessed([(0.0, {"a": 79.0}), (10.0, {"a": 22.0}), (20.0, {"a": 22.1})]).values()
    assert a.health is Health.JUMP
    assert "if 79 °C is what was wrong" in a.detail
    assert "`thermap readings withdraw`" in a.detail
    later = [(0.0, {"a": 22.0}), (10.0, {"a": 22.1}), (20.0, {"a": 79.0})]
    (a, *_) = assessed(later).values()
    assert a.health is Health.JUMP
    assert "withdraw" not in a.detail


def test_a_missing_sensor_has_no_age_to_grow():
    states = assessed([(0.0, {"a": 20.0})])
    older = {s.sensor: s for s in grow_older(THREE, states.values(), 1e6)}
    assert older["b"] == states["b"]


@pytest.mark.parametrize("value", [-273.15, -50.1, 150.1, 1e9])
def test_a_value_outside_the_range_is_the_sensors_failure(value):
    states = assessed([(0.0, {"a": 20.0, "b": 20.0}), (60.0, {"a": value, "b": 20.0})])
    assert states["a"].health is Health.OUT_OF_RANGE
    assert states["a"].temperature_c == value
    assert "expected a temperature of a from -50 to 150 °C, got" in states["a"].detail


def test_back_in_range_it_is_well_again():
    readings = [(0.0, {"a": 20.0}), (60.0, {"a": -999.0}), (120.0, {"a": 20.5})]
    assert assessed(readings)["a"].health is Health.OK


RANGES = machine(Sensor("a", min_c=-10.0, max_c=80.0), Sensor("b", min_c=0.0, max_c=50.0))
READINGS_C = st.lists(
    st.dictionaries(
        st.sampled_from(["a", "a", "b", "b", "nose"]),
        st.sampled_from([-10.1, -10.0, -0.1, 0.0, 20.0, 50.0, 50.1, 80.0, 80.1, 295.0]),
    ),
    max_size=4,
)


@given(READINGS_C)
def test_the_short_form_says_of_many_what_the_long_one_says_of_each(readings_c):
    def is_well(temperatures_c):
        try:
            states = check_temperatures(RANGES, temperatures_c)
        except InvalidContent:
            return False
        return all(state.health is Health.OK for state in states)

    assert are_in_range(RANGES, readings_c) == all(map(is_well, readings_c))


# --- kelvin ------------------------------------------------------------------------------


def test_temperatures_without_history_are_judged_by_their_range():
    states = check_temperatures(THREE, {"a": 20.0, "b": 151.0})
    assert [(s.sensor, str(s.health)) for s in states] == [("a", "ok"), ("b", "out-of-range")]
    assert states[0].age_s is None
    assert check_temperatures(THREE, {"a": float("nan")})[0].health is Health.OUT_OF_RANGE


def test_kelvin_and_unknown_sensors_are_mistakes_of_the_sender_each_named():
    with pytest.raises(InvalidContent) as refusal:
        check_temperatures(THREE, {"a": 293.15, "b": 20.0, "d": 20.0})
    assert [e.field for e in refusal.value.errors] == ["temperatures_c.a", "temperatures_c.d"]
    assert "got 293.15, which would be 20.00 °C if it was meant in kelvin" in refusal.value.detail
    assert "has no sensor 'd'; it has a, b, c" in refusal.value.detail


# --- jump --------------------------------------------------------------------------------


def test_a_jump_faster_than_heat_moves_is_not_believed():
    """10 °C/min over one minute, and ten resolutions of 0.1 °C: 11 °C are allowed."""
    allowed = assessed([(0.0, {"a": 20.0}), (MINUTE, {"a": 31.0})])
    assert allowed["a"].health is Health.OK
    jumped = assessed([(0.0, {"a": 20.0}), (MINUTE, {"a": 31.1})])
    assert jumped["a"].health is Health.JUMP
    assert jumped["a"].temperature_c == 31.1
    assert jumped["a"].detail == (
        "a jumped from 20 to 31.1 °C within 60 s, expected at most 10 °C/min; if 20 °C is what "
        "was wrong, withdraw that reading (`thermap readings withdraw`)"
    )
    assert assessed([(0.0, {"a": 31.1}), (MINUTE, {"a": 20.0})])["a"].health is Health.JUMP


def test_after_a_spike_the_return_is_no_jump():
    readings = [(0.0, {"a": 20.0}), (10.0, {"a": 80.0}), (20.0, {"a": 20.1})]
    assert assessed(readings[:2])["a"].health is Health.JUMP
    assert assessed(readings)["a"].health is Health.OK


def test_a_new_level_is_believed_once_heat_could_have_reached_it():
    """From 20 to 60 °C: 39 °C beyond the allowance take 3.9 min at 10 °C/min."""
    readings = [(0.0, {"a": 20.0})] + [(i * 30.0, {"a": 60.0}) for i in range(1, 9)]
    assert assessed(readings[:8])["a"].health is Health.JUMP  # at 210 s
    assert assessed(readings)["a"].health is Health.OK  # at 240 s


def test_a_spike_at_the_start_of_the_record_does_not_condemn_the_rest_for_ever():
    readings = [(0.0, {"a": 80.0})] + [(i * MINUTE, {"a": 20.0}) for i in range(1, 8)]
    assert assessed(readings[:3])["a"].health is Health.JUMP
    assert assessed(readings)["a"].health is Health.OK


def test_values_out_of_range_take_no_part_in_the_judgement_of_jumps():
    readings = [
        (0.0, {"a": -999.0}),
        (10.0, {"a": 20.0}),
        (20.0, {"a": 999.0}),
        (30.0, {"a": 20.0}),
    ]
    assert assessed(readings)["a"].health is Health.OK


def test_warming_up_quickly_for_long_is_no_jump():
    readings = [(i * 6.0, {"a": 20.0 + i}) for i in range(60)]
    assert assessed(readings)["a"].health is Health.OK


# --- stuck -------------------------------------------------------------------------------


def warming(rate_c_per_h):
    return lambda hours: 20.0 + rate_c_per_h * hours


def test_a_sensor_that_stands_still_while_its_neighbours_move_is_stuck():
    states = assessed(every_ten_minutes(2, a=21.5, b=warming(3), c=warming(5)))
    assert health(states) == {"a": "stuck", "b": "ok", "c": "ok"}
    assert states["a"].temperature_c == 21.5
    assert states["a"].detail == (
        "a is stuck: exactly 21.5 °C for 7200 s while its neighbours moved by 6 °C"
    )


def test_not_when_the_neighbours_rest_too():
    """A night at 20 °C: movements below ten resolutions (1 °C) prove nothing."""
    states = assessed(every_ten_minutes(8, a=20.0, b=20.0, c=warming(0.1)))
    assert health(states) == {"a": "ok", "b": "ok", "c": "ok"}


def test_not_before_the_time_is_up():
    """The neighbours have moved by 1.5 °C at 10 min; an hour later a had time to follow."""
    readings = every_ten_minutes(2, a=20.0, b=warming(9), c=warming(9))
    assert assessed(readings[:7])["a"].health is Health.OK
    assert assessed(readings[:8])["a"].health is Health.STUCK


def test_the_time_counts_from_the_last_change():
    """a moved until 2 h in steps of 1/6 °C; the others moved by ten of these by 2 h 20 min."""
    readings = every_ten_minutes(4, a=lambda h: 20.0 + min(h, 2.0), b=warming(9), c=warming(9))
    assert assessed(readings[:20])["a"].health is Health.OK
    assert assessed(readings[:21])["a"].health is Health.STUCK


def test_a_bed_that_warms_an_hour_after_the_spindle_is_not_stuck_after_a_nights_rest():
    """Rest is no evidence: what counts is the time since the neighbours moved."""

    def after_a_night(rate, delay_h):
        return lambda h: 20.0 + rate * max(h - 8.0 - delay_h, 0.0)

    readings = every_ten_minutes(
        10, a=after_a_night(1, 0.9), b=after_a_night(20, 0.0), c=after_a_night(9, 0.1)
    )
    for end in range(1, len(readings) + 1):
        assert assessed(readings[:end])["a"].health is Health.OK


def test_a_gap_between_readings_is_no_time_without_change():
    """20 °C before and after 70 min of silence; who knows what was between."""
    before = [(i * 60.0, {"a": 20.0, "b": 20.0 + i, "c": 20.0 + i}) for i in range(10)]
    after = [(4800.0 + i * 60.0, {"a": 20.0, "b": 29.0, "c": 29.0}) for i in range(10)]
    assert assessed(before + after)["a"].health is Health.OK


def test_a_sensor_may_be_allowed_to_stand_still():
    patient = machine(Sensor("a", stuck_after_s=None), Sensor("b"), Sensor("c"))
    readings = every_ten_minutes(8, a=20.0, b=warming(3), c=warming(3))
    assert assessed(readings, patient)["a"].health is Health.OK
    assert assessed(readings)["a"].health is Health.STUCK


def test_a_sensor_of_whole_degrees_is_known_by_its_steps():
    """Steps of 1 °C: neighbours that move by 6 °C prove nothing of it."""
    readings = every_ten_minutes(
        4, a=lambda h: 20.0 if h < 0.5 else 21.0, b=warming(2), c=warming(2)
    )
    assert assessed(readings)["a"].health is Health.OK


# --- the whole record --------------------------------------------------------------------


def test_what_was_not_to_be_believed_is_left_out_of_a_record():
    readings = [(i * 60.0, {"a": 20.0, "b": 20.0 + 0.01 * i, "c": 20.0}) for i in range(5)]
    readings[1][1]["b"] = 60.0
    readings[3][1]["c"] = -999.0
    cleaned = believed(THREE, TemperatureHistory.of_readings("abc", readings))
    assert np.isnan(cleaned.temperatures_c["a"]).tolist() == [False] * 5
    assert np.isnan(cleaned.temperatures_c["b"]).tolist() == [False, True, False, False, False]
    assert np.isnan(cleaned.temperatures_c["c"]).tolist() == [False, False, False, True, False]


def test_the_record_is_judged_as_the_live_sensors_were():
    """The last verdict of every beginning of a record is that time's verdict in the whole."""
    rng = np.random.default_rng(8105)
    readings = every_ten_minutes(6, a=20.0, b=warming(3), c=lambda h: 20.0 + 4 * h)
    for i in rng.choice(len(readings), 8, replace=False):
        readings[i][1]["b"] += 50.0
    history = TemperatureHistory.of_readings("abc", readings)
    whole = {n: judge_record(THREE, THREE.sensors[n], history) for n in "abc"}
    for end in range(1, len(readings) + 1):
        states = health(assessed(readings[:end]))
        assert states == {n: str(whole[n][end - 1]) for n in "abc"}


def test_the_neighbours_movement_counts_from_then_too():
    """b and c moved before a came to rest and rest with it since."""

    def ended(rate):
        return lambda h: 20.0 + rate * min(h, 2.0)

    states = assessed(every_ten_minutes(4, a=ended(1), b=ended(9), c=ended(9)))
    assert set(health(states).values()) == {"ok"}


def test_one_neighbour_of_three_that_moves_is_not_the_rule():
    """The spindle alone warms up; the middle one of the neighbours rests."""
    four = machine(Sensor("a"), Sensor("b"), Sensor("c"), Sensor("spindle"))
    readings = every_ten_minutes(2, a=20.0, b=20.0, c=20.0, spindle=warming(20))
    assert health(assessed(readings, four))["a"] == "ok"


def test_a_neighbour_that_breaks_does_not_move():
    """−999 °C is no temperature: a 1000 °C movement would condemn every resting sensor."""
    two = machine(Sensor("a"), Sensor("b"))
    readings = every_ten_minutes(2, a=20.0, b=lambda h: 20.0 if h < 1.5 else -999.0)
    assert health(assessed(readings, two)) == {"a": "ok", "b": "out-of-range"}


def test_a_machine_with_one_sensor_cannot_tell():
    alone = machine(Sensor("a"))
    assert health(assessed(every_ten_minutes(8, a=20.0), alone)) == {"a": "ok"}


def test_who_looks_back_knows_that_a_stuck_sensor_had_stopped_before():
    """It warms for two hours and stands still for four: of these its first value is left."""
    readings = every_ten_minutes(
        6, a=lambda h: 20.0 + 2 * min(h, 2.0), b=lambda h: 20.0 + 2 * h, c=lambda h: 20.0 + 2 * h
    )
    history = TemperatureHistory.of_readings("abc", readings)
    at_its_time = np.isnan(believed(THREE, history).temperatures_c["a"])
    looking_back = np.isnan(without_stuck(THREE, history).temperatures_c["a"])
    stopped = 2 * 6
    assert stopped + 1 < np.flatnonzero(at_its_time)[0]
    assert looking_back.tolist() == [i > stopped for i in range(len(readings))]
    for name in "bc":
        assert not np.isnan(without_stuck(THREE, history).temperatures_c[name]).any()


@pytest.mark.parametrize(("next_c", "had_stopped"), [(20.5, False), (19.5, False), (25.0, True)])
def test_a_heavy_body_read_in_half_degrees_had_not_stopped_where_it_goes_on_by_one_step(
    next_c, had_stopped
):
    readings = every_ten_minutes(
        7,
        a=lambda h: 20.5 if h < 0.5 else 20.0 if h < 6 else next_c,
        b=lambda h: 20.0 + 1.5 * min(h, 6.0),
        c=lambda h: 20.0 + 1.5 * min(h, 6.0),
    )
    coarse = machine(Sensor("a", resolution_c=0.5), Sensor("b"), Sensor("c"))
    looking_back = without_stuck(coarse, TemperatureHistory.of_readings("abc", readings))
    assert np.isnan(looking_back.temperatures_c["a"]).any() == had_stopped
