"""The first-order low-pass against its exact solution and scipy's filter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from app.effects.low_pass import (
    RESTED_S,
    UNREAD,
    LagState,
    beginnings,
    last_state,
    low_pass,
)

TAU = 900.0


def test_even_steps_agree_with_scipy():
    rng = np.random.default_rng(2)
    u = rng.normal(0.0, 1.0, 300)
    h = 60.0
    a, r = np.exp(-h / TAU), TAU / h * (1 - np.exp(-h / TAU))
    # First-order hold: y[n] = a y[n−1] + (1 − r) u[n] + (r − a) u[n−1].
    expected = lfilter([1.0 - r, r - a], [1.0, -a], u - u[0]) + u[0]
    np.testing.assert_allclose(low_pass(np.arange(300) * h, u, TAU).outputs, expected, atol=1e-12)


def test_a_ramp_is_exact_at_irregular_times():
    times = np.array([0.0, 10.0, 200.0, 777.0, 3000.0])
    ramp = low_pass(times, 0.01 * times, TAU).outputs
    np.testing.assert_allclose(ramp, 0.01 * (times - TAU * (1 - np.exp(-times / TAU))), atol=1e-12)


def test_irregular_readings_agree_with_an_integrator():
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(20.0, 400.0, 40))
    u = rng.normal(20.0, 2.0, 40)
    found = low_pass(times, u, TAU)
    wanted = np.sort(rng.uniform(times[0], times[-1], 30))
    solution = solve_ivp(
        lambda t, y: (np.interp(t, times, u) - y) / TAU,
        (times[0], times[-1]),
        [u[0]],
        t_eval=wanted,
        rtol=1e-10,
        atol=1e-10,
        max_step=20.0,
    )
    between = found._replace(since_s=np.full(40, -1e9)).at(wanted)
    np.testing.assert_allclose(between, solution.y[0], atol=1e-6)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(1.0, 500.0), min_size=2, max_size=30))
def test_the_live_filter_continues_the_recorded_one(steps):
    times = np.cumsum(steps)
    u = np.cos(times / 300.0)
    recorded = low_pass(times, u, TAU, max_gap_s=600.0).outputs
    state = LagState.start(TAU, times[0], u[0])
    for t, value, output in zip(times[1:], u[1:], recorded[1:], strict=True):
        state = state.update(float(t), float(value), max_gap_s=600.0)
        assert state.value == pytest.approx(output, abs=1e-12)


def test_five_time_constants_are_needed():
    times = np.arange(0.0, 6 * TAU, 60.0)
    found = low_pass(times, np.ones(times.size), TAU, max_gap_s=600.0)
    late = found.at(np.array([5 * TAU - 1.0, 5 * TAU, times[-1] + 700.0]))
    assert np.isnan(late).tolist() == [True, False, True]
    state = LagState.start(TAU, 0.0, 1.0)
    assert np.isnan(state.at(5 * TAU - 1.0))
    assert state.at(5 * TAU) == 1.0


def test_a_gap_is_crossed_on_a_line_and_the_output_waits_until_it_is_forgotten():
    times = np.concatenate([np.arange(0.0, 9000.0, 60.0), np.arange(10800.0, 30000.0, 60.0)])
    u = np.cos(times / 4000.0)
    found = low_pass(times, u, TAU, max_gap_s=600.0)
    after, gap_s = times >= 10800.0, 10800.0 - 8940.0
    share = -np.expm1(-gap_s / TAU) * np.exp((10800.0 - times[after]) / TAU)
    np.testing.assert_allclose(found.unread[after], share, rtol=1e-9)
    assert not found.unread[~after].any()
    np.testing.assert_allclose(found.outputs, low_pass(times, u, TAU).outputs)
    here = found.at(times)
    settled = (times >= 5 * TAU) & ~(after & (found.unread > UNREAD))
    np.testing.assert_array_equal(np.isfinite(here), settled)
    # Where it answers again it is the output of a record without the gap, but for a twentieth.
    every_s = np.arange(0.0, 30000.0, 60.0)
    whole = low_pass(every_s, np.cos(every_s / 4000.0), TAU).at(times)
    assert np.nanmax(np.abs(here - whole)) < UNREAD


def test_after_a_rest_a_filter_begins_anew():
    times = np.array([0.0, 60.0, 120.0, 50_000.0, 50_060.0, 55_000.0])
    begins_s = beginnings(times)
    found = low_pass(times, np.arange(6.0), TAU, begins_s=begins_s)
    assert begins_s.tolist() == [0.0, 50_000.0]
    assert found.outputs[3] == 3.0
    assert found.since_s.tolist() == [0.0, 0.0, 0.0, 50_000.0, 50_000.0, 50_000.0]
    # A signal that comes long after the others does not begin with a machine at rest.
    late = low_pass(times[5:], np.ones(1), TAU, begins_s=begins_s)
    assert np.isnan(late.first).all()
    assert late.unread.tolist() == [1.0]


def test_a_reading_that_is_not_newer_changes_nothing():
    state = LagState.start(TAU, 100.0, 20.0)
    assert state.update(100.0, 99.0) is state


@given(
    st.lists(
        st.tuples(st.floats(0.01, 4000.0), st.floats(-50.0, 150.0) | st.just(20.0)),
        min_size=1,
        max_size=60,
    ),
    st.sampled_from([600.0, 7200.0]),
    st.sampled_from([3000.0, RESTED_S]),
)
@pytest.mark.slow
def test_a_record_read_at_once_leaves_the_filter_that_followed_it(steps, time_constant_s, rested_s):
    """To the last bit: replicas that began at different times say the same."""
    times = 1.7e9 + np.cumsum([step for step, _ in steps])
    values = np.array([value for _, value in steps])
    begins_s = beginnings(times, rested_s)
    state = None
    for time_s, value in zip(times.tolist(), values.tolist(), strict=True):
        begun_s = begins_s[begins_s <= time_s][-1]
        if state is None or time_s == begun_s:
            state = LagState.start(time_constant_s, time_s, value)
        else:
            state = state.update(time_s, value, 900.0)
    assert last_state(times, values, time_constant_s, 900.0, begins_s) == state
