"""The past that effects need: carried along, or rebuilt from as much record as counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.effects.conditions import Conditions, Signal, recorded_conditions
from app.effects.driver import (
    AboveReference,
    Always,
    Behind,
    BeyondMaps,
    State,
)
from app.effects.effect import Effect
from app.effects.past import FORGOTTEN, Needed, Past, needed_past, sensors_of
from app.effects.shape import Everywhere, Sensitivity
from app.effects.term import Term
from app.thermal.machine import Sensor
from app.thermal.temperature_history import TemperatureHistory

SENSORS = {"a": Sensor("a", max_age_s=300.0), "b": Sensor("b", max_age_s=100.0)}
NEEDED = Needed(
    frozenset(
        {
            (Signal("temperature", "a"), 600.0),
            (Signal("temperature", "b"), 60.0),
            (Signal("state", "rpm", 2), 400.0),
        }
    ),
    frozenset({"rpm"}),
)


def effect(*drivers):
    return Effect("thermal-lag", ("EXX",), terms=tuple(Term("EXX", d) for d in drivers))


def record(n, seed=1, step_s=60.0):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 1.5, n) * step_s)
    a = 20.0 + np.cumsum(rng.normal(scale=0.3, size=n))
    b = 25.0 + np.cumsum(rng.normal(scale=0.3, size=n))
    b[rng.uniform(size=n) < 0.2] = np.nan
    rpm = rng.choice([0.0, 3000.0, 8000.0], n)
    return [
        (t, {"a": x} | ({} if np.isnan(y) else {"b": y}), {"rpm": r})
        for t, x, y, r in zip(times.tolist(), a.tolist(), b.tolist(), rpm.tolist(), strict=True)
    ]


def carried(readings, past=None):
    past = past or Past.unread(SENSORS, NEEDED)
    for reading in readings:
        assert not past.is_out_of_order(*reading)
        past = past.update(*reading)
    return past


def rebuilt(readings):
    history = TemperatureHistory.of_readings(SENSORS, [(t, c) for t, c, _ in readings])
    return Past.of_record(SENSORS, NEEDED, history, [(t, s) for t, _, s in readings])


def outputs(past, time_s):
    now = np.array([time_s])
    return [past.lags.lagged(*key, now)[0] for key in sorted(NEEDED.lags)]


def test_what_effects_need_is_read_off_their_drivers():
    needed = needed_past(
        [
            effect(Behind("a", 600.0), AboveReference("b", 20.0)),
            effect(State("rpm", 2, 900.0), State("feed"), Always()),
        ]
    )
    assert needed == Needed(
        frozenset({(Signal("temperature", "a"), 600.0), (Signal("state", "rpm", 2), 900.0)}),
        frozenset({"rpm", "feed"}),
    )
    assert needed.record_s == FORGOTTEN * 900.0
    assert needed.sensors == {"a"}
    assert not needed_past([effect(Always(), AboveReference("a", 1.0))])
    late = effect(BeyondMaps("a", "b", "own", ((20.0, 1.0), (30.0, 2.0)), 300.0))
    assert needed_past([late]).lags == {
        (Signal("temperature", "a"), 300.0),
        (Signal("temperature", "b"), 300.0),
    }
    assert needed_past([]).record_s == 0.0


def test_all_sensors_of_effects_are_named():
    beyond = BeyondMaps("a", "b", "own", ((20.0, 1.0), (30.0, 2.0)))
    assert sensors_of([effect(beyond)]) == {"a", "b", "own"}
    exchanged = Effect("other-sensor", ("EXX",), ("x", "y"))
    assert sensors_of([exchanged]) == {"x", "y"}


@given(seed=st.integers(0, 50), n=st.integers(1, 120))
def test_carried_along_and_rebuilt_are_the_same(seed, n):
    readings = record(n, seed)
    one, other = carried(readings), rebuilt(readings)
    assert one.states == other.states
    for elapsed in (0.0, 50.0, 250.0):
        at = readings[-1][0] + elapsed
        np.testing.assert_allclose(outputs(one, at), outputs(other, at), rtol=1e-12)
        assert one.states_at(at) == other.states_at(at)


def test_what_lies_further_back_than_thirty_time_constants_is_forgotten():
    readings = record(2000)
    last_s = readings[-1][0]
    recent = [r for r in readings if r[0] >= last_s - NEEDED.record_s]
    assert len(recent) < 400
    now = outputs(carried(readings), last_s)
    assert np.isfinite(now).sum() >= 2  # b has gaps
    np.testing.assert_allclose(outputs(rebuilt(recent), last_s), now, rtol=1e-11)


def test_it_is_what_the_record_says_at_the_latest_reading():
    readings = record(300)
    at = readings[-1][0]
    history = TemperatureHistory.of_readings(SENSORS, [(t, c) for t, c, _ in readings])
    states = [(t, s) for t, _, s in readings]
    conditions = recorded_conditions(SENSORS, history, states, np.array([at]))
    past = carried(readings)
    moment = Conditions.of_moment(at, {}, past.states_at(at), past.lags)
    for key in NEEDED.lags:
        assert moment.lagged(*key) == pytest.approx(conditions.lagged(*key), rel=1e-12)
    assert moment.state("rpm") == conditions.state("rpm")


def test_a_reading_is_behind_by_what_it_carries():
    """Sensors may report apart: a late one counts only where its own record has gone on."""
    past = carried([(0.0, {"a": 20.0}, {}), (60.0, {"a": 21.0}, {"rpm": 0.0})])
    assert past.is_out_of_order(30.0, {"a": 20.5}, {})
    assert past.is_out_of_order(30.0, {}, {"rpm": 5.0})
    assert not past.is_out_of_order(30.0, {"b": 25.0}, {})
    assert not past.is_out_of_order(60.0, {"a": 21.0}, {})
    assert not past.is_out_of_order(30.0, {"other": 1.0}, {"feed": 1.0})


def test_states_that_nobody_needs_are_not_kept():
    past = carried([(0.0, {"a": 20.0}, {"rpm": 1.0, "feed": 2.0})])
    assert past.states_at(0.0) == {"rpm": 1.0}
    assert past.states_at(300.0) == {"rpm": 1.0}
    assert past.states_at(301.0) == {}


def test_a_sensor_that_the_machine_lacks_has_no_past():
    needed = needed_past([effect(Behind("gone", 60.0))])
    past = Past.of_record(SENSORS, needed, TemperatureHistory.of_readings(SENSORS, []), [])
    assert np.isnan(past.lags.lagged(Signal("temperature", "gone"), 60.0, np.zeros(1))).all()


def test_effects_without_terms_of_the_past_need_nothing():
    local = Effect("outdated-map", ("EXX",), terms=(Term("EXX", Always(), Everywhere()),))
    slope = Effect("sensor-fault", ("EXX",), terms=(Term("EXX", Always(), Sensitivity(True)),))
    assert not needed_past([local, slope])
