"""How far the line through two maps is trusted, and how uncertain it is stated to be."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.compensation.table import compensation_table
from app.geometry.components import COMPONENTS
from app.thermal.bracket import Status
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.machine import OutOfRange, Sensor
from app.thermal.prediction import predict_component
from app.thermal.sensor_health import Health, SensorState
from tests.thermal.example_maps import error_map, machine, state_of

NOW = datetime(2026, 1, 1, tzinfo=UTC)
UNSTATED = (1.0 + math.sqrt(17.0)) / 2.0
"""The weight at which (1 − w)² + w² is 9."""


def maps_of(values, standard_error=None):
    """Maps of EXX at one position: temperature to error."""
    covariance = None if standard_error is None else [standard_error**2]
    return [
        error_map(
            f"{t:g}", t, ComponentTable.make(COMPONENTS["EXX"], [e], [0.0], covariance=covariance)
        )
        for t, e in values.items()
    ]


def model_of(values, standard_error=None, resolution_c=0.1, **policies):
    return compile_model(
        machine(
            Sensor("x-middle", resolution_c=resolution_c),
            out_of_range=OutOfRange.EXTRAPOLATE,
            **{"extrapolation_margin_c": 100.0} | policies,
        ),
        maps_of(values, standard_error),
        {},
    )


def errors_of_run():
    """Six states of one run that levels off, the last two 0.9 K apart; the last has 35 µm."""
    return {20.0: 0.0, 24.0: 12.0, 28.0: 21.0, 31.0: 28.0, 33.0: 33.0, 33.9: 35.0}


def test_two_maps_close_together_are_not_followed_far():
    """On their line 31 K further the machine would have 104 µm: the limit is 1.4 K beyond."""
    state, _ = state_of(model_of(errors_of_run()), "EXX", 65.0)
    assert state.status is Status.CLAMPED
    assert state.weight == pytest.approx(UNSTATED)
    assert state.values[0] == pytest.approx(33.0 + 2.0 * UNSTATED)
    assert state.limited_beyond_c == pytest.approx(0.9 * (UNSTATED - 1.0))


def test_what_was_limited_is_said_with_the_maps_their_distance_and_what_to_do():
    sensor = SensorState("x-middle", Health.OK, 65.0)
    found = compensation_table(model_of(errors_of_run()), 1, [sensor], NOW)
    assert found.warnings == [
        "x-middle at 65 °C is outside the maps: EXX extrapolated from '33' and '33.9', which are "
        "0.9 K apart, but held from 1.41 K beyond '33.9' on, because the standard error grows too "
        "large there; measure a map at the present temperature"
    ]


@pytest.mark.parametrize(("temperature_c", "nearest"), [(-50.0, "20"), (99.0, "30")])
def test_without_stated_uncertainty_the_weights_alone_decide_on_either_side(temperature_c, nearest):
    state, _ = state_of(model_of({20.0: 0.0, 30.0: 10.0}), "EXX", temperature_c)
    assert max(state.weight - 1.0, -state.weight) == pytest.approx(UNSTATED - 1.0)
    assert (1.0 - state.weight) ** 2 + state.weight**2 == pytest.approx(9.0)
    assert state.status is Status.CLAMPED


def test_what_lies_within_the_limit_is_as_it_was():
    state, _ = state_of(model_of({20.0: 0.0, 30.0: 10.0}), "EXX", 40.0)
    assert (state.status, state.weight, state.values.tolist()) == ("extrapolated", 2.0, [20.0])


def test_the_machine_sets_the_limit():
    """(1 − w)² + w² = 1 at w = 1: with a ratio of 1 nothing is extrapolated."""
    for ratio, weight in [(1.0, 1.0), (math.sqrt(5.0), 2.0), (1000.0, 9.0)]:
        model = model_of({20.0: 0.0, 30.0: 10.0}, extrapolation_error_ratio=ratio)
        assert state_of(model, "EXX", 110.0)[0].weight == pytest.approx(weight)


@given(
    st.floats(0.05, 10.0),
    st.floats(0.05, 10.0),
    st.floats(-50.0, 50.0),
    st.floats(0.2, 10.0),
    st.floats(0.0, 0.2),
    st.floats(1.0, 10.0),
    st.booleans(),
)
def test_at_the_limit_the_standard_error_is_the_ratio_times_that_at_the_edge(
    one, other, rise, span_c, resolution_c, ratio, above
):
    low, high = maps_of({20.0: 0.0, 20.0 + span_c: rise}, 1.0)
    low, high = (
        replace(m, tables={"EXX": replace(m.tables["EXX"], covariance=np.array([s**2]))})
        for m, s in ((low, one), (high, other))
    )
    hot = machine(
        Sensor("x-middle", resolution_c=min(resolution_c, span_c)),
        out_of_range=OutOfRange.EXTRAPOLATE,
        extrapolation_margin_c=1e4,
        extrapolation_error_ratio=ratio,
    )
    model = compile_model(hot, [low, high], {})
    state, member = state_of(model, "EXX", 20.0 + (1e3 if above else -1e3))
    (stated,) = state.standard_errors(member.forward)
    # One map's temperature counts at the limit and at the edge alike, and is not in the stated.
    of_temperature = (rise / span_c) ** 2 * min(resolution_c, span_c) ** 2 / 12.0
    found = stated**2 + of_temperature
    allowed = ratio**2 * (max(one, other) ** 2 + of_temperature)
    at_the_end = 0.0 <= state.weight <= 1.0
    assert at_the_end or found == pytest.approx(allowed)


@given(st.floats(0.01, 10.0), st.floats(-1e4, 1e4), st.floats(0.0, 0.2), st.floats(1.0, 10.0))
def test_a_steep_and_precise_curve_has_the_limit_of_any_other(precise, rise, resolution_c, ratio):
    """Of equally certain maps: the resolution of the temperatures alone stops nothing."""
    limits = []
    for values in ({20.0: 0.0, 22.0: rise}, {20.0: 0.0, 22.0: 0.0}):
        model = model_of(values, precise, resolution_c, extrapolation_error_ratio=ratio)
        limits.append(state_of(model, "EXX", 60.0)[0].weight)
    assert limits[0] == pytest.approx(limits[1])


def test_the_resolution_of_the_temperatures_makes_the_slope_uncertain():
    """Against drawn temperatures of both maps, uniform over the resolution.

    What they do at the map itself, (1 K of slope)², is left out there as between maps.
    """
    rng = np.random.default_rng(115)
    model = model_of({20.0: 0.0, 22.0: 30.0}, 1.0, resolution_c=0.2)
    state, member = state_of(model, "EXX", 23.0)
    t_n = rng.uniform(19.9, 20.1, 400_000)
    t_m = rng.uniform(21.9, 22.1, 400_000)
    drawn = 30.0 * (23.0 - t_n) / (t_m - t_n)
    of_the_map = 15.0**2 * 0.2**2 / 12.0
    expected = np.hypot(1.5, 0.5) ** 2 + drawn.var() - of_the_map
    assert state.standard_errors(member.forward)[0] ** 2 == pytest.approx(expected, rel=0.02)


def test_between_the_maps_and_at_them_the_resolution_adds_nothing():
    model = model_of({20.0: 0.0, 22.0: 30.0}, 1.0, resolution_c=1.0)
    for temperature_c, expected in [(20.0, 1.0), (21.0, math.sqrt(0.5)), (22.0, 1.0)]:
        state, member = state_of(model, "EXX", temperature_c)
        assert state.standard_errors(member.forward).tolist() == pytest.approx([expected])
    just_beyond, member = state_of(model, "EXX", 22.0 + 1e-9)
    assert just_beyond.standard_errors(member.forward)[0] == pytest.approx(1.0)


@given(st.lists(st.floats(-30.0, 90.0), min_size=1, max_size=8))
def test_predictions_and_what_is_made_of_them_have_the_same_limit(temperatures_c):
    model = model_of(errors_of_run())
    t, nowhere = np.array(temperatures_c), np.zeros(len(temperatures_c))
    found = predict_component(model, "EXX", {"x-middle": t}, nowhere, nowhere)
    states = [state_of(model, "EXX", float(one))[0] for one in t]
    expected = [state.values[0] for state in states]
    np.testing.assert_allclose(found.values, expected, rtol=1e-12, atol=1e-9)
    assert found.status == [state.status for state in states]
