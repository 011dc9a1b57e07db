"""The heart: every component between its own two maps (C. Wang, 8.105-8.107)."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from app.errors import (
    Conflict,
    InvalidContent,
    NotEnoughMaps,
    OutsideMaps,
    SensorUnavailable,
    UnknownThing,
)
from app.thermal.bracket import Status
from app.thermal.compile_model import compile_model
from app.thermal.machine import OutOfRange, SameTemperature, Sensor
from tests.thermal.example_maps import (
    error_map,
    errors_of,
    machine,
    maps_of,
    state_of,
    table,
)


def compiled(maps, assignment=None, **policies):
    return compile_model(machine(**policies), maps, assignment or {})


# --- 8.105-8.107 by hand -----------------------------------------------------------------


def test_between_two_maps_by_hand():
    """[E(T_m) − E(T_n)] (T_u − T_n)/(T_m − T_n) + E(T_n), all numbers exact in binary.

    T_n = 20, T_m = 30, T_u = 22.5: [11 − 1]·0.25 + 1 = 3.5 and [22 − 2]·0.25 + 2 = 7.
    """
    maps = maps_of("EXX", [20.0, 30.0], [[0.0, 1.0, 2.0], [0.0, 11.0, 22.0]], [0, 250, 500])
    state, member = state_of(compiled(maps), "EXX", 22.5)
    assert state.values[member.forward].tolist() == [0.0, 3.5, 7.0]
    assert (state.lower_map, state.upper_map) == ("Run #1", "Run #2")
    assert (state.weight, state.status) == (0.25, Status.INTERPOLATED)
    assert (state.sensor, state.temperature_c) == ("x-middle", 22.5)


def test_two_components_sit_between_different_maps_because_their_sensors_differ():
    """The chapter's assignment: D_x(x) follows x-middle, D_z(z) z-column.

    x-middle at 23 lies in Runs 1-2 at 0.75, z-column at 28 in Runs 2-3 at 0.5.
    """
    temperatures = [
        {"x-middle": 20.0, "z-column": 21.0},
        {"x-middle": 24.0, "z-column": 26.0},
        {"x-middle": 26.0, "z-column": 30.0},
    ]
    maps = [
        error_map(f"Run #{i}", t, table("EXX", [4.0 * i], [0]), table("EZZ", [10.0 * i], [0]))
        for i, t in enumerate(temperatures, start=1)
    ]
    live = {"x-middle": 23.0, "z-column": 28.0}
    exx, _ = state_of(compiled(maps), "EXX", live)
    ezz, _ = state_of(compiled(maps), "EZZ", live)
    assert (exx.lower_map, exx.upper_map, exx.weight) == ("Run #1", "Run #2", 0.75)
    assert (ezz.lower_map, ezz.upper_map, ezz.weight) == ("Run #2", "Run #3", 0.5)
    assert (exx.sensor, ezz.sensor) == ("x-middle", "z-column")
    assert (exx.values.tolist(), ezz.values.tolist()) == ([7.0], [25.0])


def test_the_users_assignment_outranks_the_chapters():
    maps = [
        error_map("a", {"x-middle": 20.0, "spindle": 20.0}, table("EXX", [0.0], [0])),
        error_map("b", {"x-middle": 30.0, "spindle": 40.0}, table("EXX", [20.0], [0])),
    ]
    live = {"x-middle": 30.0, "spindle": 25.0}
    assert errors_of(compiled(maps), "EXX", live).tolist() == [20.0]
    assert errors_of(compiled(maps, {"EXX": "spindle"}), "EXX", live).tolist() == [5.0]


def test_maps_are_ordered_by_the_assigned_sensors_temperature_not_by_another():
    """x-middle rises while the spindle cools: EXX on the spindle runs through them backwards."""
    maps = [
        error_map("a", {"x-middle": 20.0, "spindle": 50.0}, table("EXX", [0.0], [0])),
        error_map("b", {"x-middle": 22.0, "spindle": 40.0}, table("EXX", [8.0], [0])),
        error_map("c", {"x-middle": 24.0, "spindle": 30.0}, table("EXX", [10.0], [0])),
    ]
    state, _ = state_of(compiled(maps, {"EXX": "spindle"}), "EXX", {"spindle": 45.0})
    assert (state.lower_map, state.upper_map) == ("b", "a")
    assert state.values.tolist() == [4.0]


def test_angular_nonrigid_and_squareness_components_go_the_same_way():
    codes = {"EBX": [0, 100], "EAY^x": [0, 100], "EYY^x": [0, 50, 100], "SXY": (), "SZX": ()}
    rng = np.random.default_rng(7)
    cold, warm = ({c: rng.normal(size=max(len(p), 1)) for c, p in codes.items()} for _ in "ab")
    maps = [
        error_map("cold", 20.0, *(table(c, cold[c], p) for c, p in codes.items())),
        error_map("warm", 28.0, *(table(c, warm[c], p) for c, p in codes.items())),
    ]
    for code in codes:
        expected = cold[code] + 0.375 * (warm[code] - cold[code])
        np.testing.assert_allclose(errors_of(compiled(maps), code, 23.0), expected, rtol=1e-14)


# --- properties --------------------------------------------------------------------------

temperatures = st.lists(st.integers(0, 600), min_size=2, max_size=12, unique=True).map(
    lambda tenths: [t / 10 for t in tenths]
)
positions = st.lists(
    st.integers(-5000, 5000).map(lambda tenths: tenths / 10), min_size=1, max_size=8, unique=True
).map(sorted)


@st.composite
def stacks(draw):
    """Temperatures in no order, shared positions, and a row of any errors for each map."""
    scale, grid = draw(temperatures), draw(positions)
    row = st.lists(st.floats(-1e6, 1e6), min_size=len(grid), max_size=len(grid))
    return scale, grid, [draw(row) for _ in scale]


@given(stacks())
def test_each_map_is_reproduced_to_the_last_bit_at_its_temperature(stack):
    scale, grid, rows = stack
    model = compiled(maps_of("EXX", scale, rows, grid))
    for temperature, row in zip(scale, rows, strict=True):
        np.testing.assert_array_equal(errors_of(model, "EXX", temperature), row)
        assert state_of(model, "EXX", temperature)[0].status is Status.AT_MAP


@given(stacks(), st.floats(0.0, 1.0))
def test_between_maps_it_is_scipys_regular_grid_interpolator(stack, share):
    scale, grid, rows = stack
    order = np.argsort(scale)
    values = np.array(rows)[order]
    if len(grid) == 1:
        grid, values = [grid[0], grid[0] + 1.0], np.hstack([values, values])
    reference = RegularGridInterpolator((np.array(scale)[order], grid), values)
    t = min(scale) + share * (max(scale) - min(scale))
    t = min(max(t, min(scale)), max(scale))
    found = errors_of(compiled(maps_of("EXX", scale, rows, stack[1])), "EXX", t)
    expected = reference([(t, x) for x in grid])[: len(found)]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)


@given(temperatures, positions, st.data())
def test_what_is_linear_in_temperature_is_exact_inside_and_beyond(scale, grid, data):
    """E = a + b T at every position; 1e-9 of the largest number on the way is rounding."""
    line = st.floats(-1000.0, 1000.0)
    a = np.array(data.draw(st.lists(line, min_size=len(grid), max_size=len(grid))))
    b = np.array(data.draw(st.lists(line, min_size=len(grid), max_size=len(grid))))
    model = compiled(
        maps_of("EXX", scale, [a + b * t for t in scale], grid),
        out_of_range=OutOfRange.EXTRAPOLATE,
        extrapolation_margin_c=20.001,
        extrapolation_error_ratio=1e12,
    )
    t = data.draw(st.floats(min(scale) - 20.0, max(scale) + 20.0))
    # Beyond the maps the weight, at worst 20/0.1, multiplies the rounding of the nodes.
    np.testing.assert_allclose(errors_of(model, "EXX", t), a + b * t, atol=1e-7)


@given(stacks(), st.sampled_from([-1.0, 1.0]))
def test_it_is_continuous_at_the_maps(stack, side):
    scale, grid, rows = stack
    model = compiled(maps_of("EXX", scale, rows, grid))
    for temperature, row in zip(scale, rows, strict=True):
        beside = errors_of(model, "EXX", temperature + side * 1e-9)
        # 1e-9 °C of a step of at least 0.1 °C, between errors of at most 2e6 µm.
        np.testing.assert_allclose(beside, row, atol=1e-8 * 2e6 * 1.01)


@given(stacks(), st.integers(0, 2**32 - 1), st.floats(-5.0, 65.0))
def test_the_order_in_which_maps_are_given_does_not_matter_to_a_bit(stack, seed, t):
    scale, grid, rows = stack
    maps = [
        error_map(f"Run #{i}", c, table("EXX", row, grid), table("SYZ", row[:1]))
        for i, (c, row) in enumerate(zip(scale, rows, strict=True))
    ]
    shuffled = random.Random(seed).sample(maps, len(maps))
    one, other = compiled(maps), compiled(shuffled)
    assert [g.codes for g in one.groups] == [g.codes for g in other.groups]
    live = {"x-middle": t, "z-column": t}
    for mine, theirs in zip(one.errors_at(live), other.errors_at(live), strict=True):
        assert mine.values.tobytes() == theirs.values.tobytes()
        assert (mine.lower_map, mine.upper_map) == (theirs.lower_map, theirs.upper_map)
        assert (mine.weight, mine.status) == (theirs.weight, theirs.status)


def test_the_order_in_which_a_map_states_its_components_does_not_matter_either():
    tables = [table("SXY", [1.0]), table("EYX", [2.0], [0]), table("EXX", [3.0], [0])]
    for stated in (tables, tables[::-1]):
        model = compiled([error_map("a", 20.0, *stated), error_map("b", 30.0, *tables)])
        assert [g.codes for g in model.groups] == [["EXX", "EYX", "SXY"]]
        assert model.errors_at({"x-middle": 25.0})[0].values.tolist() == [3.0, 2.0, 1.0]


def test_the_order_does_not_matter_where_maps_are_averaged_either():
    """Means of three tables at one temperature: a sum in another order has other last bits."""
    rng = np.random.default_rng(11)
    maps = [
        error_map(f"Run #{i}", t, table("EXX", rng.normal(size=5), range(5)))
        for i, t in enumerate([20.0, 20.03, 20.06, 27.0, 27.0, 27.0, 31.0])
    ]
    policy = {"same_temperature": SameTemperature.MEAN}
    expected = [s.values.tobytes() for s in compiled(maps, **policy).errors_at({"x-middle": 24.0})]
    for seed in range(20):
        model = compiled(random.Random(seed).sample(maps, len(maps)), **policy)
        assert [s.values.tobytes() for s in model.errors_at({"x-middle": 24.0})] == expected


# --- positions ---------------------------------------------------------------------------


def test_maps_with_different_positions_meet_on_the_union_inside_the_common_range():
    """Run #1 at 0, 100, 400 is (0, 10, 40); Run #2 at 50, 150, 300 is (20, 20, 50).

    On 50, 100, 150, 300 they are (5, 10, 15, 30) and (20, 20, 20, 50); half way the mean.
    """
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0, 10.0, 40.0], [0, 100, 400])),
        error_map("Run #2", 30.0, table("EXX", [20.0, 20.0, 50.0], [50, 150, 300])),
    ]
    state, member = state_of(compiled(maps), "EXX", 25.0)
    assert member.positions_mm.tolist() == [50.0, 100.0, 150.0, 300.0]
    assert state.values[member.forward].tolist() == [12.5, 15.0, 17.5, 40.0]


def test_a_map_in_inches_ends_where_one_in_mm_ends():
    """600 mm are 23.62205 in, which is 600.00007 mm; 100 mm are 3.93701 in, or 100.00005 mm."""
    inches = [place * 25.4 for place in (0.0, 3.93701, 23.62205)]
    maps = [
        error_map("mm", 20.0, table("EXX", [0.0, 2.0, 12.0], [0, 100, 600])),
        error_map("inches", 30.0, table("EXX", [0.0, 4.0, 24.0], inches)),
    ]
    state, member = state_of(compiled(maps), "EXX", 25.0)
    assert member.positions_mm.tolist() == [0.0, 100.0, 600.0]
    assert state.values[member.forward].tolist() == [0.0, 3.0, 18.0]
    assert state.maps.shortened == {}


def test_positions_that_are_themselves_so_fine_stay_apart():
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0, 1.0], [0, 0.0004])),
        error_map("Run #2", 30.0, table("EXX", [0.0, 1.0, 2.0], [0, 0.0002, 0.0004])),
    ]
    _, member = state_of(compiled(maps), "EXX", 25.0)
    assert member.positions_mm.tolist() == [0.0, 0.0002, 0.0004]


def test_on_any_grids_it_is_both_maps_own_lines_weighted():
    """Two piecewise linear tables weighted are linear between the union's points.

    So sampled anywhere inside, the packed table is (1 − w) f_n(x) + w f_m(x) with each
    map's own interpolant, here numpy's; the third map, not in use, changes nothing.
    """
    rng = np.random.default_rng(105)
    for _ in range(30):
        grids = [np.sort(rng.uniform(-300, 300, rng.integers(4, 15))) for _ in range(3)]
        if max(g[0] for g in grids) >= min(g[-1] for g in grids):
            continue
        rows = [rng.normal(scale=20, size=g.size) for g in grids]
        maps = [
            error_map(f"Run #{i}", t, table("EYX", rows[i], grids[i]))
            for i, t in enumerate([20.0, 23.0, 31.0])
        ]
        t = rng.uniform(23.0, 31.0)
        state, member = state_of(compiled(maps), "EYX", t)
        x = rng.uniform(member.positions_mm[0], member.positions_mm[-1], 50)
        _, *own = [np.interp(x, g, r) for g, r in zip(grids, rows, strict=True)]
        w = (t - 23.0) / 8.0
        found = np.interp(x, member.positions_mm, state.values[member.forward])
        np.testing.assert_allclose(found, (1 - w) * own[0] + w * own[1], atol=1e-10)


def test_with_different_positions_each_maps_own_points_are_still_exact():
    rng = np.random.default_rng(106)
    grids = [np.array([0.0, 33.3, 100.1, 500.0]), np.array([0.0, 70.7, 333.3, 500.0])]
    rows = [rng.normal(scale=20, size=4) for _ in grids]
    maps = [
        error_map(f"Run #{i}", t, table("EXX", rows[i], grids[i])) for i, t in enumerate([20, 30])
    ]
    for i, t in enumerate([20.0, 30.0]):
        state, member = state_of(compiled(maps), "EXX", t)
        at_own = np.isin(member.positions_mm, grids[i])
        np.testing.assert_array_equal(state.values[member.forward][at_own], rows[i])


def test_a_map_with_one_position_joins_a_map_with_many():
    maps = [
        error_map("Run #1", 20.0, table("EXX", [4.0], [250.0])),
        error_map("Run #2", 30.0, table("EXX", [0.0, 10.0], [0, 100])),
    ]
    model = compiled(maps)
    assert state_of(model, "EXX", 25.0)[1].positions_mm.tolist() == [0.0, 100.0]
    assert errors_of(model, "EXX", 25.0).tolist() == [2.0, 7.0]


@pytest.mark.parametrize("second", [[100.0, 200.0], [150.0, 200.0]])
def test_maps_without_a_common_range_are_refused(second):
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0, 1.0], [0, 100])),
        error_map("Run #2", 30.0, table("EXX", [0.0, 1.0], second)),
    ]
    with pytest.raises(Conflict, match=r"share a range of positions of EXX, got .* mm"):
        compiled(maps)


# --- direction of approach ---------------------------------------------------------------


def test_both_directions_are_interpolated_each_for_itself():
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0, 1.0], [0, 100], [4.0, 5.0])),
        error_map("Run #2", 30.0, table("EXX", [10.0, 11.0], [0, 100], [24.0, 25.0])),
    ]
    model = compiled(maps)
    assert errors_of(model, "EXX", 25.0).tolist() == [5.0, 6.0]
    assert errors_of(model, "EXX", 25.0, backward=True).tolist() == [14.0, 15.0]
    assert model.notes == ()


def test_between_a_map_of_both_directions_and_one_of_one_the_reversal_is_held():
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0, 1.0], [0, 100])),
        error_map("Run #2", 30.0, table("EXX", [10.0, 11.0], [0, 100], [14.0, 16.0])),
    ]
    model = compiled(maps)
    for temperature_c in (10.0, 20.0, 22.5, 25.0, 30.0, 40.0):
        forward = errors_of(model, "EXX", temperature_c)
        backward = errors_of(model, "EXX", temperature_c, backward=True)
        assert (backward - forward).tolist() == [4.0, 5.0]
    assert errors_of(model, "EXX", 25.0).tolist() == [5.0, 6.0]
    assert model.notes == (
        "EXX has no backward errors in 'Run #1': the reversal of 'Run #2' holds there",
    )


def test_a_reversal_that_is_carried_beyond_where_it_was_measured_is_said():
    maps = [
        error_map("short", 20.0, table("EXX", [0.0, 1.0], [0, 100], [4.0, 8.0])),
        error_map("long", 30.0, table("EXX", [10.0, 15.0], [0, 500])),
    ]
    model = compiled(maps)
    assert errors_of(model, "EXX", 30.0, backward=True)[-1] == 15.0 + 7.0
    assert model.notes == (
        "EXX has no backward errors in 'long': the reversal of 'short' holds there, measured "
        "from 0 to 100 mm only: beyond that what it is at its ends holds",
    )


def test_between_two_maps_of_both_directions_the_reversal_is_linear_past_one_of_one():
    """Reversals of 2 at 20 °C and 6 at 40 °C: 3 at 25 °C, where a map of one direction lies."""
    maps = [
        error_map("a", 20.0, table("EXX", [0.0], [0], [2.0])),
        error_map("b", 25.0, table("EXX", [9.0], [0])),
        error_map("c", 40.0, table("EXX", [1.0], [0], [7.0])),
    ]
    for temperature_c, reversal in [
        (20.0, 2.0),
        (22.5, 2.5),
        (25.0, 3.0),
        (35.0, 5.0),
        (40.0, 6.0),
    ]:
        forward = errors_of(compiled(maps), "EXX", temperature_c)
        backward = errors_of(compiled(maps), "EXX", temperature_c, backward=True)
        np.testing.assert_allclose(backward - forward, reversal, rtol=1e-14)


def test_a_held_reversal_bends_where_the_map_that_has_it_bends():
    """The map of one direction has two positions; the reversal has a third in between."""
    maps = [
        error_map("a", 20.0, table("EXX", [0.0, 0.0, 0.0], [0, 50, 100], [1.0, 5.0, 2.0])),
        error_map("b", 30.0, table("EXX", [0.0, 8.0], [-50, 150])),
    ]
    state, member = state_of(compiled(maps), "EXX", 30.0)
    assert member.positions_mm.tolist() == [-50, 0, 50, 100, 150]
    reversal = state.values[member.backward] - state.values[member.forward]
    assert reversal.tolist() == [1.0, 1.0, 5.0, 2.0, 2.0]


def test_a_mean_of_maps_takes_the_reversal_from_those_that_have_it():
    maps = [
        error_map("a", 20.0, table("EXX", [0.0], [0], [4.0])),
        error_map("b", 20.0, table("EXX", [2.0], [0])),
        error_map("c", 30.0, table("EXX", [1.0], [0])),
    ]
    model = compiled(maps, same_temperature=SameTemperature.MEAN)
    assert errors_of(model, "EXX", 20.0).tolist() == [1.0]
    assert errors_of(model, "EXX", 20.0, backward=True).tolist() == [5.0]


def test_without_any_backward_table_there_is_none():
    model = compiled(maps_of("EXX", [20.0, 30.0], [[1.0], [2.0]], [0]))
    assert state_of(model, "EXX", 25.0)[1].backward is None


# --- outside the maps --------------------------------------------------------------------

LINE = maps_of("EXX", [20.0, 22.0, 30.0], [[0.0], [10.0], [50.0]], [0])


@pytest.mark.parametrize(
    ("policy", "temperature_c", "errors", "status"),
    [
        (OutOfRange.CLAMP, 31.0, 50.0, Status.CLAMPED),
        (OutOfRange.CLAMP, -20.0, 0.0, Status.CLAMPED),
        # The last two maps' slope is 5 µm/°C, and the first two's too.
        (OutOfRange.EXTRAPOLATE, 32.0, 60.0, Status.EXTRAPOLATED),
        (OutOfRange.EXTRAPOLATE, 17.0, -15.0, Status.EXTRAPOLATED),
        (OutOfRange.EXTRAPOLATE, 35.0, 75.0, Status.EXTRAPOLATED),
        (OutOfRange.REJECT, 30.0, 50.0, Status.AT_MAP),
        (OutOfRange.REJECT, 26.0, 30.0, Status.INTERPOLATED),
    ],
)
def test_policies_outside_the_maps(policy, temperature_c, errors, status):
    model = compiled(LINE, out_of_range=policy)
    state, _ = state_of(model, "EXX", temperature_c)
    assert state.values[0] == pytest.approx(errors)
    assert state.status is status


@pytest.mark.parametrize(
    ("policy", "temperature_c"), [(OutOfRange.REJECT, 30.1), (OutOfRange.EXTRAPOLATE, 35.1)]
)
def test_what_the_policy_does_not_allow_names_sensor_and_components(policy, temperature_c):
    maps = [
        error_map(f"Run #{i}", t, table("EXX", [1.0], [0]), table("EYX", [1.0], [0]))
        for i, t in enumerate([20.0, 30.0])
    ]
    with pytest.raises(OutsideMaps) as refusal:
        compiled(maps, out_of_range=policy).errors_at({"x-middle": temperature_c})
    assert refusal.value.detail.startswith("x-middle, for EXX, EYX: expected a temperature ")
    assert f"the maps' 20 to 30 °C, got {temperature_c} °C" in refusal.value.detail
    assert [e.field for e in refusal.value.errors] == ["temperatures_c.x-middle"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_temperature_that_is_none_is_never_clamped_to_a_map(value):
    with pytest.raises(InvalidContent, match="expected a finite temperature in °C"):
        compiled(LINE).errors_at({"x-middle": value})


# --- stand-ins ---------------------------------------------------------------------------


def stood_in(first, second, *, chain=(), **live):
    """EXX on `a`; each sensor's stand-in is the next of the chain."""
    names = ["a", *chain]
    following = [*names[1:], None]
    sensors = [Sensor(n, stand_in=s) for n, s in zip(names, following, strict=True)]
    maps = [
        error_map("cold", first, table("EXX", [0.0], [0])),
        error_map("warm", second, table("EXX", [10.0], [0])),
    ]
    model = compile_model(machine(*sensors), maps, {"EXX": "a"})
    return model, {k: float(v) for k, v in live.items()}


def test_a_stand_in_is_asked_on_its_own_temperatures_of_the_maps():
    """y-front was 5 °C cooler: its 22.5 °C is a quarter of ITS way, 15 to 45 °C."""
    model, live = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 45}, chain="b", b=22.5)
    state, _ = state_of(model, "EXX", live)
    assert state.values.tolist() == [2.5]
    assert (state.sensor, state.temperature_c, state.weight) == ("b", 22.5, 0.25)
    assert state.status is Status.STAND_IN
    assert state.is_stand_in
    assert state.group.sensor == "a"


def test_while_the_sensor_lives_its_stand_in_is_not_asked():
    model, live = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 45}, chain="b", a=25, b=15)
    state, _ = state_of(model, "EXX", live)
    assert (state.sensor, state.status, state.is_stand_in) == ("a", Status.INTERPOLATED, False)
    assert state.values.tolist() == [5.0]


def test_a_stand_in_may_run_against_the_sensor():
    """Cold where the other is warm: its maps are in its own order."""
    model, live = stood_in({"a": 20, "b": 40}, {"a": 30, "b": 30}, chain="b", b=37.5)
    state, _ = state_of(model, "EXX", live)
    assert (state.lower_map, state.upper_map) == ("warm", "cold")
    assert state.values.tolist() == [2.5]


def test_a_stand_in_at_a_map_says_stand_in_and_beyond_the_maps_says_the_graver():
    model, _ = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 45}, chain="b")
    assert state_of(model, "EXX", {"b": 15.0})[0].status is Status.STAND_IN
    clamped, _ = state_of(model, "EXX", {"b": 50.0})
    assert clamped.status is Status.CLAMPED
    assert clamped.is_stand_in


def test_a_chain_of_stand_ins_is_followed_to_the_first_that_lives():
    model, _ = stood_in({"a": 20, "b": 15, "c": 0}, {"a": 30, "b": 45, "c": 100}, chain="bc")
    assert state_of(model, "EXX", {"b": 30.0, "c": 75.0})[0].values.tolist() == [5.0]
    assert state_of(model, "EXX", {"c": 75.0})[0].values.tolist() == [7.5]


def test_a_stand_in_that_a_map_lacks_is_passed_over_for_the_next():
    model, _ = stood_in({"a": 20, "b": 15, "c": 0}, {"a": 30, "c": 100}, chain="bc")
    assert [s.sensor for s in model.groups[0].scales] == ["a", "c"]
    assert state_of(model, "EXX", {"b": 30.0, "c": 75.0})[0].sensor == "c"
    with pytest.raises(SensorUnavailable):
        model.errors_at({"b": 30.0})


def test_a_stand_in_that_does_not_tell_the_maps_apart_cannot_serve():
    model, _ = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 15.05}, chain="b")
    assert [s.sensor for s in model.groups[0].scales] == ["a"]
    with pytest.raises(SensorUnavailable):
        model.errors_at({"b": 15.0})


def test_a_circle_of_stand_ins_ends():
    circle = machine(Sensor("a", stand_in="b"), Sensor("b", stand_in="a"))
    maps = [
        error_map("cold", {"a": 20, "b": 15}, table("EXX", [0.0], [0])),
        error_map("warm", {"a": 30, "b": 45}, table("EXX", [10.0], [0])),
    ]
    model = compile_model(circle, maps, {"EXX": "a"})
    assert state_of(model, "EXX", {"b": 30.0})[0].values.tolist() == [5.0]
    with pytest.raises(SensorUnavailable):
        model.errors_at({})


def test_without_sensor_and_stand_in_the_sentence_names_both_and_the_components():
    model, _ = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 45}, chain="b")
    with pytest.raises(SensorUnavailable) as refusal:
        model.errors_at({"c": 20.0})
    assert refusal.value.detail == (
        "expected a temperature of a in °C, needed by EXX, got none that is usable "
        "nor of its stand-in b"
    )


def test_an_old_temperature_serves_only_where_no_fresh_one_does():
    """Fresh x-middle, else fresh y-front, else old x-middle, else old y-front."""
    model, _ = stood_in({"a": 20, "b": 15}, {"a": 30, "b": 45}, chain="b")
    old = {"a": 30.0, "b": 15.0}
    cases = [({"a": 25.0}, "a", 5.0), ({"b": 22.5}, "b", 2.5), ({}, "a", 10.0)]
    for fresh, sensor, error in cases:
        (state,) = model.errors_at(fresh, old)
        assert (state.sensor, state.values.tolist()) == (sensor, [error])
    (state,) = model.errors_at({}, {"b": 30.0})
    assert (state.sensor, state.status, state.values.tolist()) == ("b", Status.STAND_IN, [5.0])


def test_one_failed_sensor_is_not_covered_by_the_others():
    """Both groups' sensors are needed: half a table would pass for a whole one."""
    maps = [
        error_map(f"Run #{i}", t, table("EXX", [1.0], [0]), table("EZZ", [1.0], [0]))
        for i, t in enumerate([20.0, 30.0])
    ]
    with pytest.raises(SensorUnavailable, match=r"of z-column in °C, needed by EZZ") as refusal:
        compiled(maps).errors_at({"x-middle": 25.0})
    assert [e.field for e in refusal.value.errors] == ["temperatures_c.z-column"]


# --- maps at one temperature -------------------------------------------------------------


def test_maps_closer_than_the_resolution_are_refused_by_name():
    maps = maps_of("EXX", [20.0, 30.0, 20.05], [[0.0], [1.0], [2.0]], [0])
    with pytest.raises(Conflict) as refusal:
        compiled(maps)
    assert refusal.value.detail == (
        "maps 'Run #1' and 'Run #3' are 0.05 °C apart at x-middle, which EXX follows; expected "
        "at least its resolution of 0.1 °C (or the machine's same_temperature set to 'mean')"
    )


@pytest.mark.parametrize("low", [20.0, 20.1, 0.2, 33.3, -7.7])
def test_exactly_the_resolution_apart_is_allowed_whatever_the_binary_rounding(low):
    """20.4 − 20.3 and 0.3 − 0.2 are below 0.1 in binary."""
    maps = maps_of("EXX", [low, low + 0.1, 40.0], [[0.0], [1.0], [2.0]], [0])
    assert errors_of(compiled(maps), "EXX", low + 0.1).tolist() == [1.0]
    decimal = maps_of("EXX", [20.3, 20.4, 0.2, 0.3], [[0.0], [1.0], [2.0], [3.0]], [0])
    assert errors_of(compiled(decimal), "EXX", 0.3).tolist() == [3.0]


@pytest.mark.parametrize("resolution_c", [0.0, 1e-12, -1.0])
def test_at_one_temperature_no_resolution_tells_two_maps_apart(resolution_c):
    """Else the weight would be 0/0."""
    fine = machine(Sensor("x-middle", resolution_c=resolution_c))
    maps = maps_of("EXX", [20.0, 20.0], [[0.0], [1.0]], [0])
    with pytest.raises(Conflict, match="are 0 °C apart"):
        compile_model(fine, maps, {})


def test_only_the_assigned_sensor_has_to_tell_maps_apart():
    maps = [
        error_map("a", {"x-middle": 20.0, "z-column": 20.0}, table("EXX", [0.0], [0])),
        error_map("b", {"x-middle": 30.0, "z-column": 20.0}, table("EXX", [4.0], [0])),
    ]
    assert errors_of(compiled(maps), "EXX", 25.0).tolist() == [2.0]
    with pytest.raises(Conflict):
        compiled(maps, {"EXX": "z-column"})


def test_their_mean_on_demand():
    """20.00 and 20.06 become one state at 20.03 °C, with the mean of (0, 2) and of (4, 6)."""
    maps = [
        error_map("a", 20.0, table("EXX", [0.0, 2.0], [0, 100])),
        error_map("b", 20.06, table("EXX", [4.0, 6.0], [0, 100])),
        error_map("c", 30.03, table("EXX", [12.0, 14.0], [0, 100])),
    ]
    model = compiled(maps, same_temperature=SameTemperature.MEAN)
    state, _ = state_of(model, "EXX", 25.03)
    np.testing.assert_allclose(state.values, [7.0, 9.0])
    assert (state.lower_map, state.upper_map) == ("a + b", "c")
    clamped, _ = state_of(model, "EXX", 20.0)
    assert clamped.values.tolist() == [2.0, 4.0]
    assert clamped.status is Status.CLAMPED


def test_a_mean_does_not_grow_beyond_the_resolution():
    """Maps 0.06 °C apart: each state takes in what is within 0.1 °C of its first map."""
    temperatures_c = [20.0 + 0.06 * i for i in range(100)]
    maps = maps_of("EXX", temperatures_c, [[float(i)] for i in range(100)], [0.0])
    model = compiled(maps, same_temperature=SameTemperature.MEAN)
    (group,) = model.groups
    assert len(group.labels) == 50
    np.testing.assert_allclose(group.scales[0].temperatures_c, 20.03 + 0.12 * np.arange(50))


def test_a_narrowed_range_of_positions_is_said():
    maps = [
        error_map("a", 20.0, table("EXX", [0.0, 2.0], [0, 100])),
        error_map("b", 30.0, table("EXX", [4.0, 6.0], [20, 80])),
    ]
    state, _ = state_of(compiled(maps), "EXX", 25.0)
    assert state.maps.shortened == {
        "EXX": "given from 20 to 80 mm only at this temperature, because map 'b' covers 20 to 80 "
        "mm; the maps together reach from 0 to 100 mm"
    }


def test_the_mean_of_maps_on_different_positions_and_of_their_stand_ins_temperature():
    sensors = [Sensor("x-middle", stand_in="y-front"), Sensor("y-front")]
    averaging = machine(*sensors, same_temperature=SameTemperature.MEAN)
    maps = [
        error_map("a", {"x-middle": 20, "y-front": 18}, table("EXX", [0.0, 10.0], [0, 100])),
        error_map("b", {"x-middle": 20, "y-front": 20}, table("EXX", [2.0, 2.0], [0, 50])),
        error_map("c", {"x-middle": 30, "y-front": 29}, table("EXX", [3.0], [0])),
    ]
    model = compile_model(averaging, maps, {})
    assert model.groups[0].scales[1].temperatures_c == (19.0, 29.0)
    state, member = state_of(model, "EXX", {"y-front": 24.0})
    assert member.positions_mm.tolist() == [0.0, 50.0]
    # Half way from the means (0+2)/2 and (5+2)/2 to 3.
    assert state.values.tolist() == [2.0, 3.25]


# --- what cannot be interpolated ---------------------------------------------------------


def test_a_component_of_one_map_is_left_out_with_the_reason():
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0], [0]), table("EYX", [0.0], [0])),
        error_map("Run #2", 30.0, table("EXX", [1.0], [0])),
    ]
    model = compiled(maps)
    assert [code for group in model.groups for code in group.codes] == ["EXX"]
    assert model.omitted == {"EYX": "measured in Run #1 only, at least two maps are needed"}
    assert model.find("EYX") is None
    group, member = model.find("EXX")
    assert (group.sensor, member.component.code) == ("x-middle", "EXX")


def test_a_component_that_nobody_assigned_is_left_out_with_the_reason():
    """A C axis has no default in the chapter, and this machine has several sensors."""
    maps = [error_map(f"Run #{i}", t, table("XOC", [1.0])) for i, t in enumerate([20.0, 30.0])]
    model = compiled(maps)
    assert model.omitted == {"XOC": "no sensor is assigned to it"}
    assert compiled(maps, {"XOC": "z-column"}).omitted == {}


def test_a_machine_with_one_sensor_lets_everything_follow_it():
    maps = [
        error_map(f"Run #{i}", {"bed": t}, table("EZZ", [t], [0]))
        for i, t in enumerate([20.0, 30.0])
    ]
    model = compile_model(machine(Sensor("bed")), maps, {})
    assert errors_of(model, "EZZ", {"bed": 24.0}).tolist() == [24.0]


def test_components_with_different_maps_stand_beside_each_other():
    """EYX lacks the middle map: at 23 °C it lies between Runs 1 and 3, EXX between 1 and 2."""
    maps = [
        error_map("Run #1", 20.0, table("EXX", [0.0], [0]), table("EYX", [0.0], [0])),
        error_map("Run #2", 24.0, table("EXX", [8.0], [0])),
        error_map("Run #3", 32.0, table("EXX", [9.0], [0]), table("EYX", [12.0], [0])),
    ]
    model = compiled(maps)
    assert errors_of(model, "EXX", 23.0).tolist() == [6.0]
    assert errors_of(model, "EYX", 23.0).tolist() == [3.0]
    assert state_of(model, "EYX", 23.0)[0].upper_map == "Run #3"


@pytest.mark.parametrize(
    ("maps", "why"),
    [([], "'mcfv5050' needs at least two error maps"), (LINE[:1], "at least two maps are needed")],
)
def test_with_fewer_than_two_maps_there_is_nothing_to_interpolate(maps, why):
    with pytest.raises(NotEnoughMaps, match=why):
        compiled(maps).errors_at({"x-middle": 25.0})


def test_maps_that_no_sensor_is_assigned_to_are_not_said_to_be_too_few():
    maps = [
        error_map(f"Run #{i}", {"bed": 20.0 + 10.0 * i}, table("EXX", [i], [0])) for i in range(2)
    ]
    model = compile_model(machine(Sensor("bed"), Sensor("head")), maps, {})
    with pytest.raises(NotEnoughMaps, match=r"be interpolated: EXX \(no sensor is ass") as raised:
        model.errors_at({"bed": 25.0})
    assert "two error maps" not in str(raised.value)


def test_a_map_without_the_assigned_sensor_is_refused_by_name():
    maps = [
        error_map("Run #1", {"x-middle": 20.0}, table("EXX", [0.0], [0])),
        error_map("Run #2", {"z-column": 30.0}, table("EXX", [0.0], [0])),
    ]
    with pytest.raises(InvalidContent) as refusal:
        compiled(maps)
    assert refusal.value.detail == (
        "temperatures_c: expected a temperature of x-middle in °C in map 'Run #2', because EXX "
        "follows it, got z-column"
    )
    assert refusal.value.errors[0].field == "temperatures_c"


def test_an_assignment_to_a_sensor_that_does_not_exist_lists_what_exists():
    with pytest.raises(UnknownThing, match="it has x-middle, y-front, z-column, spindle"):
        compiled(LINE, {"EXX": "bed"})
