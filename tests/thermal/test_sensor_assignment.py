"""The proposal of a sensor for each component (C. Wang, 8.2.9)."""

import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from app.errors import UnknownThing
from app.thermal.correlation import tell_apart
from app.thermal.machine import SameTemperature, Sensor
from app.thermal.sensor_assignment import propose_assignment
from tests.thermal.example_maps import error_map, machine, table

TWO = machine(Sensor("x-middle"), Sensor("spindle"))


def maps_with(tables, **temperatures_c):
    """Run #1, #2 …: a table each, and a temperature of each sensor each (None: missing)."""
    columns = zip(*temperatures_c.values(), strict=True)
    names = [name.replace("_", "-") for name in temperatures_c]
    return [
        error_map(
            f"Run #{i}",
            {n: t for n, t in zip(names, row, strict=True) if t is not None},
            *([made] if made else []),
        )
        for i, (made, row) in enumerate(zip(tables, columns, strict=True), start=1)
    ]


def single_values(values):
    return [table("SXY", [v]) for v in values]


def proposal(maps, on=TWO, assignment=None):
    (found,) = propose_assignment(on, maps, assignment or {})
    return found, {c.sensor: c for c in found.correlations}


def warm_up(n, seed=0):
    """x-middle and the spindle over n maps, each on its own course, 0.5 and 1 °C a step."""
    rng = np.random.default_rng(seed)
    return 20 + 0.5 * rng.permutation(n), 25 + 1.0 * rng.permutation(n)


# --- what is correlated ------------------------------------------------------------------


def test_a_single_value_is_correlated_itself():
    """SXY over five maps; r by hand: Σdx dy / √(Σdx² Σdy²) = 9 / √(10·10), and −1."""
    maps = maps_with(
        single_values([1.0, 3.0, 2.0, 5.0, 4.0]),
        x_middle=[21.0, 22.0, 23.0, 24.0, 25.0],
        spindle=[-2.0 * v + 50 for v in (1, 3, 2, 5, 4)],
    )
    found, by = proposal(maps)
    assert by["x-middle"].r == pytest.approx(8 / 10)
    assert by["spindle"].r == pytest.approx(-1.0)
    assert (found.code, found.maps, by["x-middle"].maps) == ("SXY", 5, 5)


def test_a_table_is_reduced_to_its_largest_common_movement():
    """EXX stretches with x-middle, 1 µm/°C per 100 mm, under a smaller wave of its own.

    The stretch is the first principal component: a stretch without the wave has r = 1.
    """
    n = 12
    x_middle, spindle = warm_up(n)
    grid = np.linspace(0.0, 500.0, 11)
    wave = np.sin(2 * np.pi * grid / 500.0)
    amplitude = np.random.default_rng(1).normal(scale=0.3, size=n)
    rows = [t * grid / 100 + a * wave for t, a in zip(x_middle, amplitude, strict=True)]
    maps = maps_with([table("EXX", r, grid) for r in rows], x_middle=x_middle, spindle=spindle)
    found, by = proposal(maps)
    assert by["x-middle"].r > 0.999
    assert found.proposed_sensor == "x-middle"
    # The projection by numpy's eigenvectors of the covariance instead of the SVD.
    change = np.array(rows) - np.mean(rows, axis=0)
    first = np.linalg.eigh(change.T @ change)[1][:, -1]
    expected = stats.pearsonr(change @ first * np.sign(first[-1]), spindle).statistic
    assert by["spindle"].r == pytest.approx(expected)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_r_is_positive_where_the_error_grows_with_the_temperature(sign):
    """At the position that changes most; of several, at the last."""
    x_middle, spindle = warm_up(6)
    for shape in ([0.0, 1.0, 3.0], [-2.0, 0.0, 2.0], [0.0, 5.0, 1.0], [4.0]):
        grid = np.arange(len(shape)) * 100.0
        tables = [table("EXX", sign * t * np.array(shape), grid) for t in x_middle]
        _, by = proposal(maps_with(tables, x_middle=x_middle, spindle=spindle))
        assert by["x-middle"].r == pytest.approx(sign)


def test_both_directions_of_approach_count():
    """Forward nothing changes, backward the reversal error grows with the spindle."""
    x_middle, spindle = warm_up(6)
    tables = [table("EXX", [1.0, 1.0], [0, 100], [1.0 + t, 1.0 + t]) for t in spindle]
    found, by = proposal(maps_with(tables, x_middle=x_middle, spindle=spindle))
    assert by["spindle"].r == pytest.approx(1.0)
    assert found.proposed_sensor == "spindle"


# --- which sensor is proposed ------------------------------------------------------------


def test_a_significantly_better_sensor_is_proposed():
    x_middle, spindle = warm_up(12)
    noise = np.random.default_rng(2).normal(scale=0.5, size=12)
    maps = maps_with(single_values(spindle + noise), x_middle=x_middle, spindle=spindle)
    found, by = proposal(maps)
    assert (found.current_sensor, found.proposed_sensor) == ("x-middle", "spindle")
    assert by["spindle"].ties_with_best
    assert not by["x-middle"].ties_with_best
    assert found.reason == (
        f"spindle (r = {by['spindle'].r:.3f}, 12 maps) correlates best; "
        f"x-middle (r = {by['x-middle'].r:.3f}, 12 maps) is significantly worse"
    )


def test_the_chapters_default_stands_beside_one_that_is_not_significantly_better():
    """y-front reads the same as x-middle within the correlation (8.2.9)."""
    x_middle, _ = warm_up(12)
    rng = np.random.default_rng(3)
    y_front = x_middle + rng.normal(scale=0.2, size=12)
    values = y_front + rng.normal(scale=0.5, size=12)
    on = machine(Sensor("x-middle"), Sensor("y-front"))
    maps = maps_with(single_values(values), x_middle=x_middle, y_front=y_front)
    found, by = proposal(maps, on)
    assert by["y-front"].r > by["x-middle"].r
    assert by["x-middle"].ties_with_best
    assert (found.current_sensor, found.proposed_sensor) == ("x-middle", "x-middle")
    assert found.reason == (
        f"x-middle (r = {by['x-middle'].r:.3f}, 12 maps) stands: y-front "
        f"(r = {by['y-front'].r:.3f}, 12 maps) is not significantly better"
    )


def test_what_the_user_assigned_stands_in_the_same_way():
    x_middle, _ = warm_up(12)
    rng = np.random.default_rng(3)
    y_front = x_middle + rng.normal(scale=0.2, size=12)
    values = x_middle + rng.normal(scale=0.5, size=12)
    on = machine(Sensor("x-middle"), Sensor("y-front"))
    maps = maps_with(single_values(values), x_middle=x_middle, y_front=y_front)
    found, _ = proposal(maps, on, {"SXY": "y-front"})
    assert (found.current_sensor, found.proposed_sensor) == ("y-front", "y-front")
    assert proposal(maps, on)[0].proposed_sensor == "x-middle"


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("noise", "ties"), [(1.0, True), (0.02, False)])
def test_a_sensor_that_runs_against_another_is_compared_by_its_size(sign, noise, ties):
    """A cooler that falls as x-middle rises says the same: no verdict may hang on its sign."""
    x_middle, _ = warm_up(12)
    other = 40 + sign * (x_middle + np.random.default_rng(4).normal(scale=0.3, size=12))
    values = x_middle + np.random.default_rng(5).normal(scale=noise, size=12)
    on = machine(Sensor("x-middle"), Sensor("cooler"))
    maps = maps_with(single_values(values), x_middle=x_middle, cooler=other)
    _, by = proposal(maps, on)
    signed = [by["x-middle"].r, by["cooler"].r]
    between = stats.pearsonr(x_middle, other).statistic
    assert np.sign(signed[1]) == sign
    expected = not tell_apart(*np.abs(signed), sign * between, 12)
    assert by["x-middle"].ties_with_best
    assert by["cooler"].ties_with_best is expected is ties


def test_two_sensors_that_read_exactly_alike_tie_and_the_first_is_the_best():
    x_middle, _ = warm_up(12)
    on = machine(Sensor("p"), Sensor("q"), Sensor("r"))
    maps = maps_with(
        single_values(x_middle + np.random.default_rng(6).normal(size=12)),
        p=x_middle,
        q=2 * x_middle + 3.3,
        r=100 - x_middle,
    )
    found, by = proposal(maps, on)
    assert [by[s].ties_with_best for s in "pqr"] == [True, True, True]
    assert (found.current_sensor, found.proposed_sensor) == (None, "p")
    assert found.reason.endswith("correlates best; tied with it: q, r")


@pytest.mark.parametrize("n", [2, 3])
def test_with_few_maps_everything_ties_and_the_default_stands(n):
    x_middle, spindle = [20.0, 23.0, 21.0][:n], [20.0, 30.0, 45.0][:n]
    maps = maps_with(single_values(spindle), x_middle=x_middle, spindle=spindle)
    found, by = proposal(maps)
    assert by["spindle"].r == pytest.approx(1.0)
    assert all(c.ties_with_best for c in by.values())
    assert all(c.r_low is None and c.r_high is None for c in by.values())
    assert found.proposed_sensor == "x-middle"
    assert found.reason.endswith(
        f"stands; {n} maps cannot tell sensors apart, at least 4 are needed"
    )


def test_with_two_maps_every_r_is_one_and_no_rounding_chooses():
    """Nothing is assigned and nothing can be told: the machine's first sensor, in words."""
    on = machine(Sensor("p"), Sensor("q"))
    maps = maps_with(single_values([0.1, 0.7]), p=[20.3, 20.1], q=[17.7, 39.9])
    found, by = proposal(maps, on)
    assert (by["p"].r, by["q"].r) == pytest.approx((-1.0, 1.0))
    assert found.proposed_sensor == "p"
    assert "2 maps cannot tell sensors apart" in found.reason


def test_with_no_relation_at_all_the_default_is_seldom_left():
    """One sensor against another by pure chance: two independent r differ at 5 % in 5 %."""
    left = 0
    for seed in range(200):
        x_middle, spindle = warm_up(8, seed)
        values = np.random.default_rng(seed + 1000).normal(size=8)
        maps = maps_with(single_values(values), x_middle=x_middle, spindle=spindle)
        left += proposal(maps)[0].proposed_sensor != "x-middle"
    # Less than 5 % of 200: the sizes of two r differ less than the r themselves.
    assert left <= 10


# --- what has no correlation -------------------------------------------------------------


def without_numbers(correlation):
    return (correlation.r, correlation.r_low, correlation.r_high) == (None, None, None)


def test_a_component_of_one_map_keeps_its_sensor_with_the_reason():
    maps = maps_with(single_values([1.0]), x_middle=[20.0], spindle=[30.0])
    found, by = proposal(maps)
    assert (found.proposed_sensor, found.maps) == ("x-middle", 1)
    assert found.reason == "only Run #1 has SXY, at least two maps are needed"
    assert all(without_numbers(c) and c.reason == found.reason for c in by.values())


@pytest.mark.parametrize("value", [0.0, 3.7, -1e5])
def test_a_component_that_does_not_change_keeps_its_sensor(value):
    x_middle, spindle = warm_up(6)
    maps = maps_with(single_values([value] * 6), x_middle=x_middle, spindle=spindle)
    found, by = proposal(maps)
    assert found.proposed_sensor == "x-middle"
    assert found.reason == "it does not change over its 6 maps"
    assert all(without_numbers(c) and not c.ties_with_best for c in by.values())


def test_what_only_resampling_changes_is_no_change():
    """The same straight line on other positions differs in its last bits."""
    grids = [np.linspace(0, 500, n) for n in (2, 7, 11, 13)]
    x_middle, spindle = warm_up(4)
    tables = [table("EXX", 0.1 + 0.3 * g, g) for g in grids]
    found, by = proposal(maps_with(tables, x_middle=x_middle, spindle=spindle))
    assert found.reason == "it does not change over its 4 maps"
    assert by["spindle"].r is None


def test_tables_without_a_common_range_say_so():
    tables = [table("EXX", [0.0, t], [100.0 * t, 100.0 * t + 50]) for t in (1.0, 2.0)]
    found, by = proposal(maps_with(tables, x_middle=[20.0, 25.0], spindle=[20.0, 25.0]))
    assert found.proposed_sensor == "x-middle"
    assert "EXX to share a range of positions" in found.reason
    assert by["x-middle"].reason == found.reason


def test_a_sensor_that_a_map_lacks_has_no_r_and_cannot_be_proposed():
    x_middle, spindle = warm_up(6)
    readings = [*spindle[:4], None, None]
    maps = maps_with(single_values(spindle), x_middle=x_middle, spindle=readings)
    found, by = proposal(maps)
    assert without_numbers(by["spindle"])
    assert by["spindle"].maps == 4
    assert by["spindle"].reason == "spindle has no temperature in Run #5, Run #6"
    assert found.proposed_sensor == "x-middle"


def test_a_sensor_that_stands_still_has_no_r():
    """0.09 °C is less than the sensor resolves: a correlation with noise."""
    x_middle, _ = warm_up(6)
    still = 30.0 + 0.009 * np.arange(10)[[3, 9, 0, 1, 5, 2]]
    maps = maps_with(single_values(still), x_middle=x_middle, spindle=still)
    found, by = proposal(maps)
    assert without_numbers(by["spindle"])
    assert by["spindle"].reason == (
        "spindle is constant over the maps: it changes by 0.081 °C, its resolution is 0.1 °C"
    )
    assert found.proposed_sensor == "x-middle"


def test_the_current_sensor_itself_may_be_the_one_without_use():
    _, spindle = warm_up(6)
    maps = maps_with(single_values(spindle), x_middle=[20.0] * 6, spindle=spindle)
    found, _ = proposal(maps)
    assert found.proposed_sensor == "spindle"
    assert found.reason.endswith("correlates best; x-middle is constant over the maps: it changes "
                                 "by 0 °C, its resolution is 0.1 °C")  # fmt: skip


def test_a_sensor_on_which_the_maps_would_be_refused_is_proposed_with_that_caution():
    """Accepting it would be answered with a conflict, so the user is told beforehand."""
    x_middle, spindle = warm_up(6)
    spindle[5] = spindle[0] + 0.05
    maps = maps_with(single_values(spindle), x_middle=x_middle, spindle=spindle)
    found, by = proposal(maps)
    assert by["spindle"].r == pytest.approx(1.0)
    assert by["spindle"].reason == ""
    assert found.proposed_sensor == "spindle"
    assert found.reason.endswith(
        "is significantly worse; but it reads 0.05 °C between Run #1 and Run #6, less than its "
        "resolution of 0.1 °C: only with the machine's same_temperature set to 'mean'"
    )
    averaging = machine(
        Sensor("x-middle"), Sensor("spindle"), same_temperature=SameTemperature.MEAN
    )
    found, _ = proposal(maps, averaging)
    assert found.proposed_sensor == "spindle"
    assert found.reason.endswith("is significantly worse")


def test_where_no_sensor_can_serve_the_reasons_are_listed():
    maps = maps_with(single_values([1.0, 2.0]), x_middle=[20.0, 20.0], spindle=[30.0, None])
    found, _ = proposal(maps)
    assert found.proposed_sensor == "x-middle"
    assert found.reason == (
        "no sensor can be proposed: x-middle is constant over the maps: it changes by 0 °C, its "
        "resolution is 0.1 °C; spindle has no temperature in Run #2"
    )


# --- all components ----------------------------------------------------------------------


def test_each_component_of_any_map_gets_a_proposal_in_the_tables_order():
    x_middle, spindle = warm_up(6)
    maps = maps_with([None] * 6, x_middle=x_middle, spindle=spindle)
    maps = [
        error_map(
            m.label,
            m.temperatures_c,
            table("SXY", [spindle[i]]),
            table("EXX", [x_middle[i]], [0]),
            *([table("EBX", [1.0], [0])] if i == 3 else []),
        )
        for i, m in enumerate(maps)
    ]
    found = propose_assignment(TWO, maps, {})
    assert [(p.code, p.proposed_sensor, p.maps) for p in found] == [
        ("EXX", "x-middle", 6),
        ("EBX", "x-middle", 1),
        ("SXY", "spindle", 6),
    ]
    assert all([c.sensor for c in p.correlations] == ["x-middle", "spindle"] for p in found)
    assert propose_assignment(TWO, [], {}) == []


def test_without_a_default_the_best_is_proposed():
    """A C axis' location has no sensor in the chapter."""
    x_middle, spindle = warm_up(12)
    maps = maps_with([table("XOC", [t]) for t in spindle], x_middle=x_middle, spindle=spindle)
    found, _ = proposal(maps)
    assert (found.current_sensor, found.proposed_sensor) == (None, "spindle")
    assert found.reason == "spindle (r = 1.000, 12 maps) correlates best; tied with it: none"


def test_a_machine_without_sensors_has_nothing_to_propose():
    bare = machine(Sensor("a"))
    object.__setattr__(bare, "sensors", {})
    maps = maps_with(single_values([1.0, 2.0]), x_middle=[20.0, 25.0])
    found, _ = proposal(maps, bare)
    assert (found.proposed_sensor, found.correlations) == (None, ())
    assert found.reason == "no sensor can be proposed: the machine has none"


def test_an_assignment_to_a_sensor_that_does_not_exist_lists_what_exists():
    maps = maps_with(single_values([1.0, 2.0]), x_middle=[20.0, 25.0])
    with pytest.raises(UnknownThing, match="no sensor 'bed'; it has x-middle, spindle"):
        propose_assignment(TWO, maps, {"SXY": "bed"})


@given(st.integers(2, 9), st.integers(0, 2**32 - 1))
def test_the_order_in_which_maps_are_given_does_not_matter_to_a_bit(n, seed):
    rng = np.random.default_rng(seed)
    x_middle, spindle = warm_up(n, seed)
    tables = [table("EYX", rng.normal(size=4), [0, 10, 50, 200]) for _ in range(n)]
    maps = maps_with(tables, x_middle=x_middle, spindle=spindle)
    shuffled = random.Random(seed).sample(maps, n)
    assert propose_assignment(TWO, maps, {}) == propose_assignment(TWO, shuffled, {})


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=8),
    st.lists(st.floats(-50.0, 150.0), min_size=8, max_size=8),
    st.lists(st.floats(-50.0, 150.0), min_size=8, max_size=8),
)
def test_whatever_comes_there_is_a_number_or_a_reason_and_never_nan(values, first, second):
    n = len(values)
    maps = maps_with(single_values(values), x_middle=first[:n], spindle=second[:n])
    found, by = proposal(maps)
    assert found.proposed_sensor in ("x-middle", "spindle")
    assert found.reason
    for c in by.values():
        assert (c.r is None) <= bool(c.reason)
        assert (c.r_low is None) == (c.r is None or n < 4)
        if c.r is not None:
            assert -1.0 <= c.r <= 1.0
        if c.r_low is not None:
            assert c.r_low - 1e-12 <= c.r <= c.r_high + 1e-12
            assert math.isfinite(c.r_low)
