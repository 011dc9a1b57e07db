"""A response of many drivers: its columns from the record, live and stored, and how it is held."""

import json
import math

import numpy as np
import pytest

from app.effects.adopted.in_table import sureness
from app.effects.conditions import Conditions, recorded_conditions
from app.effects.effect import Effect, effect_from_json
from app.effects.past import Past, needed_past
from app.effects.response_columns import (
    LATE,
    LEVEL,
    ON,
    START,
    STATE,
    Column,
    Zero,
    columns_at,
    listed_columns,
)
from app.effects.response_driver import Responding, written_root
from app.effects.term import Term
from app.thermal.machine import Sensor
from app.thermal.temperature_history import TemperatureHistory

SENSORS = {name: Sensor(name, max_age_s=1800.0) for name in ("a", "b", "c")}
REST_S, STEP_S = 3 * 3600.0, 60.0


def readings(minutes=240, start_s=0.0, rest=True):
    """Three bodies at 20, 22 and 30 °C that stand, then come together; the spindle turns on."""
    found = []
    if rest:
        found += [
            (start_s - t, {"a": 20.0, "b": 22.0, "c": 30.0}, {"rpm": 0.0})
            for t in (REST_S, 9000.0, 7500.0, 6000.0, 4500.0, 3000.0, 1500.0)
        ]
    for minute in range(minutes):
        left = math.exp(-minute / 60.0)
        temperatures = {"a": 24.0 - 4.0 * left, "b": 24.0 - 2.0 * left, "c": 24.0 + 6.0 * left}
        found.append((start_s + STEP_S * minute, temperatures, {"rpm": 2000.0}))
    return found


def conditions_of(record, times_s):
    history = TemperatureHistory.of_readings(SENSORS, [(t, temps) for t, temps, _ in record])
    return recorded_conditions(SENSORS, history, [(t, s) for t, _, s in record], times_s)


def column(form, name, minutes, at_min, rest=True, zero=None):
    asked = [Column(form, name, minutes)]
    if form != START:
        asked.append(Column(LATE, "b", 20.0))
    else:
        asked = [Column(START, n, minutes) for n in "abc"] + [Column(LATE, n, 20.0) for n in "abc"]
    place = next(i for i, one in enumerate(asked) if one.name == name)
    times_s = STEP_S * np.atleast_1d(np.array(at_min, dtype=float))
    found = columns_at(asked, zero or Zero(), conditions_of(readings(rest=rest), times_s))
    return found.values[:, place], found.age_s


@pytest.mark.parametrize("rest", [True, False])
def test_temperatures_count_from_the_first_reading_whether_or_not_the_machine_stood_before(rest):
    """dy/dt = (u − y)/τ of u = 24 − 4 exp(−t/60), with y(0) = u(0) = 20, by hand."""
    values, age_s = column(LATE, "a", 20.0, [0.0, 90.0], rest)
    # y = 24 − 6 exp(−t/60) + 2 exp(−t/20)
    expected = 24.0 - 6.0 * math.exp(-1.5) + 2.0 * math.exp(-4.5) - 20.0
    np.testing.assert_allclose(values, [0.0, expected], atol=2e-3)
    np.testing.assert_allclose(age_s, [0.0, 5400.0], atol=120.0)


def test_a_state_was_0_before_the_record():
    for form, full in ((STATE, 2000.0), (ON, 1.0)):
        values, _ = column(form, "rpm", 40.0, [0.0, 60.0], rest=False)
        np.testing.assert_allclose(values, [0.0, full * (1.0 - math.exp(-1.5))], rtol=1e-6)


def test_what_a_body_differed_by_at_the_start_dies_out():
    """c was 30 °C where the middle one of the three was 22."""
    values, _ = column(START, "c", 60.0, [61.0, 200.0])
    np.testing.assert_allclose(values, [8.0 * (1 - math.exp(-1)), 8.0 * (1 - math.exp(-199 / 60))])
    absolute, _ = column(START, "c", 60.0, [61.0], zero=Zero((20.0,) * 6, level_c=20.0))
    np.testing.assert_allclose(absolute, [-8.0 * math.exp(-1)])


def responding(**changes):
    columns = listed_columns("abc", ["rpm"])
    p = len(columns)
    rng = np.random.default_rng(4)
    fields = {
        "columns": columns,
        "references_c": (),
        "level_sensor": "",
        "level_c": 23.0,
        "ranges": ((-10.0, 10.0),) * p,
        "until_s": (1000.0 * 86400.0,),
        "coefficients": tuple(tuple(row) for row in rng.normal(0, 0.02, (2, p)).tolist()),
        "spread": written_root(np.diag(rng.uniform(1e-6, 1e-5, p))),
        "noise": (1.0, 0.2, 300.0, 0.2, 200.0),
        "is_zeroed": True,
        "longest_min": 240.0,
    }
    wide = tuple((-3000.0, 3000.0) for _ in columns)
    return Responding(**(fields | {"ranges": wide} | changes))


def effect(driver):
    return Effect("response", ("EXX",), ("a", "b", "c"), ("rpm",), terms=(Term("EXX", driver),))


def test_live_it_is_what_the_record_says():
    record = readings() + readings(start_s=3 * 86400.0, rest=False)
    needed = needed_past([effect(responding())])
    past = Past.unread(SENSORS, needed)
    for number, reading in enumerate(record):
        past = past.update(*reading)
        if number % 37 and number not in (0, 7, 246, 247):
            continue
        time_s, temperatures, state = reading
        live = Conditions.of_moment(time_s, temperatures, state, past.lags)
        recorded = conditions_of(record, np.array([time_s]))
        here, there = responding().expected(live), responding().expected(recorded)
        for one, other in zip(here[:3], there[:3], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(here.corrected, there.corrected, atol=1e-9)
        rebuilt = Past.of_record(
            SENSORS,
            needed,
            TemperatureHistory.of_readings(SENSORS, [(t, x) for t, x, _ in record[: number + 1]]),
            [(t, s) for t, _, s in record[: number + 1]],
        )
        again = Conditions.of_moment(time_s, temperatures, state, rebuilt.lags)
        np.testing.assert_allclose(responding().at(again), responding().at(live), atol=1e-9)


def test_stored_it_is_the_same():
    one = effect(responding())
    stored = json.loads(json.dumps(one.to_json()))
    found = effect_from_json(stored)
    assert found == one
    there = conditions_of(readings(), np.array([3600.0, 9000.0]))
    assert found.terms[0].driver.at(there).tolist() == one.terms[0].driver.at(there).tolist()


def test_a_correction_is_smaller_than_what_was_learnt_and_the_table_says_by_how_much():
    there = conditions_of(readings(), np.array([9000.0]))
    (sure,) = sureness(effect(responding()), there)
    told = responding().expected(there)
    square = sure.expected**2
    expected = square / (square + sure.learnt_error**2 + sure.wander_error**2)
    assert 0.0 < expected < 1.0
    assert sure.corrected == pytest.approx(expected * sure.expected)
    assert responding().at(there)[0] == pytest.approx(sure.corrected)
    assert not told.is_held.any()
    wide = written_root(1e-3 * np.eye(len(responding().columns)))
    unsure = responding(spread=wide).expected(there)
    assert abs(unsure.corrected[0]) < abs(sure.corrected)


def test_a_jump_as_set_ups_begin_is_stated_and_nothing_is_corrected_less_for_it():
    there = conditions_of(readings(), np.array([600.0, 9000.0]))
    plain = responding()
    noise = plain.noise
    jumping = responding(noise=(*noise, 3.0)).expected(there)
    before = plain.expected(there)
    share = 1.0 - np.exp(-np.array([10.0, 150.0]) / 4.0)  # of a jump within some 4 minutes
    expected = np.sqrt(before.wander**2 + (3.0 * share) ** 2)
    np.testing.assert_allclose(jumping.wander, expected, rtol=1e-9)
    np.testing.assert_array_equal(jumping.corrected, before.corrected)


def test_what_is_not_sure_goes_half_back_to_the_maps_and_half_to_the_start():
    """Maps of 5 µm/K over a, which has risen by 4 (1 − exp(−2.5)) K; by hand."""
    there = conditions_of(readings(), np.array([9000.0]))
    maps = ((10.0, -50.0), (20.0, 0.0), (30.0, 50.0))
    told = responding(maps_sensor="a", maps=maps).expected(there)
    said = 5.0 * 4.0 * (1.0 - math.exp(-2.5))
    variance = told.learnt[0] ** 2 + told.wander[0] ** 2
    mean = told.mean[0]
    beside, whole = (x**3 / (x**2 + variance) for x in (mean, said + mean))
    assert told.corrected[0] == pytest.approx(0.5 * (beside + whole - said), rel=1e-3)
    unsure = responding(
        maps_sensor="a", maps=maps, spread=written_root(1e6 * np.eye(len(told_columns())))
    ).expected(there)
    assert unsure.corrected[0] == pytest.approx(-0.5 * said, rel=1e-3)


def told_columns():
    return responding().columns


def test_a_column_is_held_half_its_span_beyond_where_it_was_learnt():
    narrow = responding(ranges=tuple((-1.0, 1.0) for _ in responding().columns))
    there = conditions_of(readings(), np.array([9000.0]))
    outside = narrow.farthest(there)
    assert narrow.expected(there).is_held.all()
    assert outside.column == Column(STATE, "rpm", 3.0)
    assert outside.is_beyond.all()
    assert responding().farthest(there) is None
    assert narrow.farthest(there.take(np.empty(0, dtype=np.intp))) is None
    values = np.clip(columns_at(narrow.columns, Zero(level_c=23.0), there).values[0], -2.0, 2.0)
    assert narrow.expected(there).mean[0] == pytest.approx(
        values @ np.array(narrow.coefficients[0])
    )


def test_of_a_record_much_longer_than_those_that_taught_it_says_nothing():
    short = responding(longest_min=60.0)
    there = conditions_of(readings(), np.array([3000.0, 9000.0]))
    assert np.isnan(short.at(there)).tolist() == [False, True]
    assert "within the first 60 min of a record" in short.why_missing(there)
    assert responding().why_missing(there) == ""


def test_without_its_past_it_is_missing():
    there = Conditions.of_moment(0.0, {"a": 20.0, "b": 20.0, "c": 20.0}, {"rpm": 0.0})
    assert np.isnan(responding().at(there)).all()
    assert responding().why_missing(there) == "no record of a up to that time"


def test_after_a_date_the_response_is_another():
    later = responding(until_s=(0.0,))
    there = conditions_of(readings(), np.array([9000.0]))
    assert later.at(there)[0] != responding().at(there)[0]


def test_level_multiplies_the_rise():
    one, _ = column(LEVEL, "b", 30.0, [100.0], zero=Zero(level_c=0.0))
    ten_lower, _ = column(LEVEL, "b", 30.0, [100.0], zero=Zero(level_c=-10.0))
    rise = columns_at(
        [Column(LATE, "b", 30.0)], Zero(), conditions_of(readings(), np.array([6000.0]))
    ).values[0, 0]
    assert ten_lower[0] - one[0] == pytest.approx(rise)
