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
    MAPS,
    OFFSET,
    START,
    STATE,
    TIME,
    Column,
    Columns,
    Zero,
    columns_at,
    listed_columns,
)
from app.effects.response_driver import FORMER, Responding, read, written, written_root
from app.effects.term import Term
from app.search.response import least_harm
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
    values, _ = column(STATE, "rpm", 40.0, [0.0, 60.0], rest=False)
    np.testing.assert_allclose(values, [0.0, 2000.0 * (1.0 - math.exp(-1.5))], rtol=1e-6)


def test_what_a_body_differed_by_at_the_start_dies_out():
    """c was 30 °C where the middle one of the three was 22."""
    values, _ = column(START, "c", 60.0, [61.0, 200.0])
    np.testing.assert_allclose(values, [8.0 * (1 - math.exp(-1)), 8.0 * (1 - math.exp(-199 / 60))])


def test_time_since_the_start_maps_and_a_zero():
    """Settling within 5 min; maps of 5 µm/K over a, which has risen by 4 (1 − exp(−t/60)) K."""
    asked = [
        *(Column(LATE, name, 20.0) for name in "abc"),
        *(Column(TIME, "", 5.0), Column(MAPS, "a", 0.0), Column(OFFSET, "", 0.0)),
    ]
    there = conditions_of(readings(), np.array([300.0, 3600.0]))
    zero = Zero(maps=((20.0, 0.0), (24.0, 20.0)))
    found = columns_at(asked, zero, there)
    np.testing.assert_allclose(found.values[:, 3], 1.0 - np.exp(-found.age_s / 300.0))
    risen = 4.0 * (1.0 - np.exp(-np.array([5.0, 60.0]) / 60.0))
    np.testing.assert_allclose(found.values[:, 4], 5.0 * risen, atol=1e-6)
    assert found.values[:, 5].tolist() == [1.0, 1.0]
    counted = columns_at(asked, zero._replace(references_c=(0.0,) * 4 + (22.0, 0.0)), there)
    np.testing.assert_allclose(counted.values[:, 4], 5.0 * (risen - 2.0), atol=1e-6)


def responding(maps=(), days=(1.0, 3.0), **changes):
    columns = listed_columns("abc", ["rpm"], (20.0, 60.0), "a" if maps else "")
    p = len(columns)
    rng = np.random.default_rng(4)
    means = rng.normal(0, 0.02, (1 + len(days), p))
    spread = np.diag(rng.uniform(1e-6, 1e-5, p))
    if maps:
        means[:, -1] = 0.0
    fields = {
        "columns": columns,
        "references_c": (),
        "level_c": 23.0,
        "ranges": tuple((-3000.0, 3000.0) for _ in columns),
        "days_s": tuple(86400.0 * day for day in days),
        "drift_span_s": 2.0 * 86400.0,
        "coefficients": written(means),
        "spread": written_root(spread),
        "noise": (1.0, 0.2, 300.0, 0.2, 200.0),
        "longest_min": 240.0,
        "maps": maps,
    }
    return Responding(**(fields | changes))


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
    sd = np.hypot(told.learnt, told.wander)
    expected = least_harm(told.mean, sd, np.zeros(1))[0]
    assert 0.0 < expected / sure.expected < 1.0
    assert sure.corrected == pytest.approx(expected)
    assert responding().at(there)[0] == pytest.approx(sure.corrected)
    assert responding().farthest(there) is None
    wide = written_root(1e-3 * np.eye(len(responding().columns)))
    unsure = responding(spread=wide).expected(there)
    assert abs(unsure.corrected[0]) < abs(sure.corrected)


def test_what_is_not_sure_stays_between_the_maps_and_nothing():
    """Maps of 5 µm/K over a, which has risen by 4 (1 − exp(−2.5)) K."""
    there = conditions_of(readings(), np.array([9000.0]))
    maps = ((10.0, -50.0), (20.0, 0.0), (30.0, 50.0))
    one = responding(maps=maps)
    told = one.expected(there)
    said = np.full(1, 5.0 * 4.0 * (1.0 - math.exp(-2.5)))
    sd = np.hypot(told.learnt, told.wander)
    expected = least_harm(said + told.mean, sd, np.zeros(1), said) - said
    np.testing.assert_allclose(told.corrected, expected, rtol=1e-3)
    wide = written_root(1e6 * np.eye(len(one.columns)))
    for beyond, limit in ((200.0, 0.0), (-200.0, -said[0])):
        means = np.zeros((3, len(one.columns)))
        means[:, 0] = beyond
        unsure = responding(maps=maps, spread=wide, coefficients=written(means)).expected(there)
        assert unsure.corrected[0] == pytest.approx(limit, abs=1e-3)


def test_a_response_of_an_earlier_version_is_kept_and_said_to_be_learnt_anew():
    """No table silently becomes another one: it is missing, with what to do."""
    driver = {
        "name": "response",
        "columns": [["late", "a", 0.0], ["off maps", "b", 4.0]],
        "references_c": [],
        "level_sensor": "",
        "level_c": 20.0,
        "ranges": [[0.0, 1.0], [0.0, 1.0]],
        "until_s": [],
        "coefficients": [[1.0, 2.0]],
        "spread": "",
        "noise": [1.0, 1.0, 300.0, 1.0, 200.0, 3.0],
        "is_zeroed": True,
        "longest_min": 240.0,
        "in_maps": ["a", [20.0], [[20.0]], True],
    }
    stored = effect(responding()).to_json()
    stored["terms"][0]["driver"] = driver
    one = effect_from_json(json.loads(json.dumps(stored)))
    assert driver.items() <= json.loads(json.dumps(one.to_json()))["terms"][0]["driver"].items()
    there = conditions_of(readings(), np.array([9000.0]))
    former = one.terms[0].driver
    assert np.isnan(former.at(there)).all()
    assert former.why_missing(there) == FORMER
    assert "analyse again" in FORMER
    assert not sureness(one, there)


def test_a_column_is_held_half_its_span_beyond_where_it_was_learnt():
    narrow = responding(ranges=tuple((-1.0, 1.0) for _ in responding().columns))
    there = conditions_of(readings(), np.array([9000.0]))
    outside = narrow.farthest(there)
    assert outside.column == Column(STATE, "rpm", 5.0)
    assert outside.is_beyond.all()
    assert responding().farthest(there) is None
    assert narrow.farthest(there.take(np.empty(0, dtype=np.intp))) is None
    values = np.clip(columns_at(narrow.columns, narrow.zero, there).values, -2.0, 2.0)
    began_s = np.zeros(1)
    asked = Columns(values, np.full(1, 9000.0))
    assert narrow.expected(there).mean[0] == pytest.approx(
        responding().expected_of(asked, began_s).mean[0], rel=1e-6
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


def test_between_days_the_response_follows_the_bridge_of_a_markov_process():
    """Conditioning normal values of covariance exp(−|t|/span) on three days, by algebra."""
    one = responding(days=(1.0, 2.0, 5.0))
    means = read(one.coefficients).reshape(4, -1)
    days = np.array([1.0, 2.0, 5.0])

    def alike(a, b):
        return np.exp(-np.abs(np.subtract.outer(a, b)) / 2.0)

    for day in (0.5, 1.0, 1.25, 3.0, 4.9, 8.0):
        weights = np.linalg.solve(alike(days, days), alike(days, np.array([day])))[:, 0]
        expected = means[0] + weights @ (means[1:] - means[0])
        found = one._coefficients_at(np.array([86400.0 * day]))[0]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


def test_level_multiplies_the_rise():
    one, _ = column(LEVEL, "b", 30.0, [100.0], zero=Zero(level_c=0.0))
    ten_lower, _ = column(LEVEL, "b", 30.0, [100.0], zero=Zero(level_c=-10.0))
    rise = columns_at(
        [Column(LATE, "b", 30.0)], Zero(), conditions_of(readings(), np.array([6000.0]))
    ).values[0, 0]
    assert ten_lower[0] - one[0] == pytest.approx(rise)
