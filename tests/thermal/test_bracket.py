"""The neighbours of a temperature and the weight between them (8.105-8.107)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent, OutsideMaps
from app.thermal.bracket import Bracket, Status, find_bracket
from app.thermal.machine import OutOfRange

CLAMP, EXTRAPOLATE, REJECT = OutOfRange.CLAMP, OutOfRange.EXTRAPOLATE, OutOfRange.REJECT

MAPS_C = [20.0, 24.0, 30.0]


@pytest.mark.parametrize(
    ("temperature_c", "lower", "weight", "status"),
    [
        # (T_u - T_n) / (T_m - T_n) by hand.
        (21.0, 0, 0.25, Status.INTERPOLATED),
        (23.0, 0, 0.75, Status.INTERPOLATED),
        (25.5, 1, 0.25, Status.INTERPOLATED),
        (29.25, 1, 0.875, Status.INTERPOLATED),
        (20.0, 0, 0.0, Status.AT_MAP),
        (24.0, 1, 0.0, Status.AT_MAP),
        (30.0, 1, 1.0, Status.AT_MAP),
        (19.0, 0, 0.0, Status.CLAMPED),
        (-40.0, 0, 0.0, Status.CLAMPED),
        (31.0, 1, 1.0, Status.CLAMPED),
    ],
)
def test_weights_by_hand(temperature_c, lower, weight, status):
    assert find_bracket(MAPS_C, temperature_c) == Bracket(lower, weight, status)


@pytest.mark.parametrize(
    ("temperature_c", "lower", "weight"), [(19.0, 0, -0.25), (33.0, 1, 1.5), (15.0, 0, -1.25)]
)
def test_extrapolation_goes_on_in_a_line_through_the_last_two_maps(temperature_c, lower, weight):
    found = find_bracket(MAPS_C, temperature_c, EXTRAPOLATE, 5.0)
    assert found == Bracket(lower, weight, Status.EXTRAPOLATED)


def test_the_margin_itself_is_allowed_and_nothing_beyond_it():
    assert find_bracket(MAPS_C, 35.0, EXTRAPOLATE, 5.0).status is Status.EXTRAPOLATED
    assert find_bracket(MAPS_C, 15.0, EXTRAPOLATE, 5.0).status is Status.EXTRAPOLATED
    for outside in (np.nextafter(35.0, 40.0), np.nextafter(15.0, 0.0)):
        with pytest.raises(OutsideMaps, match="expected a temperature up to 5 °C beyond the maps'"):
            find_bracket(MAPS_C, outside, EXTRAPOLATE, 5.0)


@pytest.mark.parametrize("temperature_c", [19.99, 30.01])
def test_reject_refuses_and_says_what_it_expected(temperature_c):
    with pytest.raises(OutsideMaps) as refusal:
        find_bracket(MAPS_C, temperature_c, REJECT)
    assert refusal.value.detail == (
        f"expected a temperature within the maps' 20 to 30 °C, got {temperature_c} °C"
    )


@pytest.mark.parametrize("policy", list(OutOfRange))
@pytest.mark.parametrize("temperature_c", MAPS_C)
def test_the_maps_own_temperatures_are_inside_under_every_policy(policy, temperature_c):
    assert find_bracket(MAPS_C, temperature_c, policy).status is Status.AT_MAP


@pytest.mark.parametrize("policy", list(OutOfRange))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_temperature_lies_nowhere(policy, value):
    """Not at the last map, to which comparisons with NaN would send it."""
    with pytest.raises(InvalidContent, match="expected a finite temperature in °C, got"):
        find_bracket(MAPS_C, value, policy, 5.0)


scales = st.lists(st.integers(-500, 1500), min_size=2, max_size=40, unique=True).map(
    lambda tenths: [t / 10 for t in sorted(tenths)]
)


@given(scales, st.floats(-60.0, 160.0), st.sampled_from([CLAMP, EXTRAPOLATE]))
def test_the_neighbours_enclose_the_temperature(maps_c, temperature_c, policy):
    found = find_bracket(maps_c, temperature_c, policy, 1000.0)
    t_n, t_m = maps_c[found.lower], maps_c[found.lower + 1]
    back_c = t_n + found.weight * (t_m - t_n)
    if policy is CLAMP:
        temperature_c = min(max(temperature_c, maps_c[0]), maps_c[-1])
        assert 0.0 <= found.weight <= 1.0
        assert t_n <= temperature_c <= t_m
    # The smallest step is 0.1 °C, so a rounding of the weight stays one of the temperature.
    assert back_c == pytest.approx(temperature_c, abs=1e-11)


@given(scales, st.integers(0, 39))
def test_at_a_map_the_weight_is_exact(maps_c, i):
    found = find_bracket(maps_c, maps_c[i % len(maps_c)])
    assert found.status is Status.AT_MAP
    assert found.weight in (0.0, 1.0)
    assert found.lower + int(found.weight) == i % len(maps_c)
