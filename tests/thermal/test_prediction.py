"""Many times and places at once: the same as the table asked point by point."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from app.errors import InvalidContent, NotEnoughMaps
from app.geometry.chain import Chain
from app.geometry.measuring_line import MeasuringLine
from app.geometry.volumetric_error import volumetric_error
from app.thermal.bracket import Status
from app.thermal.compile_model import compile_model
from app.thermal.machine import OutOfRange
from app.thermal.map_weights import NO_READING, OUTSIDE_MAPS
from app.thermal.prediction import predict_component, predict_points
from tests.thermal.example_maps import error_map, errors_of, machine, maps_of, table

NO_TOOL = np.zeros(3)
UNKNOWN = np.zeros(1)


def compiled(maps, **policies):
    return compile_model(machine(**policies), maps, {})


def at_x_middle(*temperatures_c, **others):
    return {"x-middle": np.array(temperatures_c)} | {k: np.array(v) for k, v in others.items()}


def predicted(model, code, temperatures_c, positions_mm, directions=None):
    positions_mm = np.array(positions_mm, dtype=float)
    if directions is None:
        directions = np.zeros(positions_mm.size)
    return predict_component(model, code, temperatures_c, positions_mm, np.array(directions))


def test_over_temperature_and_position_by_hand():
    """Half way between (0, 8) at 20 °C and (4, 16) at 30 °C is (2, 12); a quarter along, 4.5."""
    model = compiled(maps_of("EXX", [20.0, 30.0], [[0.0, 8.0], [4.0, 16.0]], [0, 100]))
    found = predicted(model, "EXX", at_x_middle(25.0, 25.0, 20.0, 30.0), [25.0, 50.0, 25.0, 100.0])
    assert found.values.tolist() == [4.5, 7.0, 2.0, 16.0]
    assert found.status == ["interpolated", "interpolated", "at-map", "at-map"]


def test_anywhere_inside_it_is_scipys_regular_grid_interpolator():
    rng = np.random.default_rng(8105)
    scale = np.array([18.0, 20.5, 21.0, 27.3, 33.0])
    grid = np.array([-300.0, -120.0, -119.0, 0.0, 7.5, 400.0])
    nodes = rng.normal(scale=20, size=(5, 6))
    model = compiled(maps_of("EBX", scale, nodes, grid))
    t, x = rng.uniform(18.0, 33.0, 500), rng.uniform(-300.0, 400.0, 500)
    t[:5], x[5:11] = scale, grid
    expected = RegularGridInterpolator((scale, grid), nodes)(np.column_stack([t, x]))
    np.testing.assert_allclose(predicted(model, "EBX", at_x_middle(*t), x).values, expected, 1e-10)


def test_at_the_tables_own_points_it_is_the_table_to_the_last_bit():
    """`errors_at` serves the live table, this serves verification: they must not differ."""
    rng = np.random.default_rng(2)
    grid = np.array([0.0, 33.3, 100.1, 250.0, 499.9])
    model = compiled(maps_of("EYX", [20.0, 23.7, 31.0], rng.normal(size=(3, 5)), grid))
    for t in (20.0, 22.1, 23.7, 29.9, 31.0, 44.0):
        found = predicted(model, "EYX", at_x_middle(*[t] * 5), grid)
        np.testing.assert_array_equal(found.values, errors_of(model, "EYX", t))


def test_outside_the_table_its_end_values_hold():
    model = compiled(maps_of("EXX", [20.0, 30.0], [[1.0, 8.0], [1.0, 8.0]], [0, 100]))
    found = predicted(model, "EXX", at_x_middle(25.0, 25.0), [-50.0, 1e6])
    assert found.values.tolist() == [1.0, 8.0]


@pytest.mark.parametrize(
    ("maps", "code"),
    [
        (maps_of("SXY", [20.0, 30.0], [[4.0], [8.0]]), "SXY"),
        (maps_of("EXX", [20.0, 30.0], [[4.0], [8.0]], [250.0]), "EXX"),
    ],
)
def test_without_positions_the_position_is_ignored(maps, code):
    found = predicted(compiled(maps), code, at_x_middle(25.0, 25.0), [0.0, 999.0])
    assert found.values.tolist() == [6.0, 6.0]


def test_each_direction_has_its_own_table_and_an_unknown_one_the_mean():
    maps = [
        error_map("a", 20.0, table("EXX", [0.0, 2.0], [0, 100], [10.0, 12.0])),
        error_map("b", 30.0, table("EXX", [2.0, 4.0], [0, 100], [20.0, 22.0])),
    ]
    found = predicted(compiled(maps), "EXX", at_x_middle(*[25.0] * 3), [50.0] * 3, [1, -1, 0])
    assert found.values.tolist() == [2.0, 16.0, 9.0]


def test_every_status_and_nan_only_where_there_is_no_error_to_tell():
    maps = [
        error_map(f"Run #{i}", {"x-middle": t, "y-front": t - 2}, table("EXX", [10.0 * i], [0]))
        for i, t in enumerate([20.0, 30.0])
    ]
    temperatures = at_x_middle(
        25.0, 20.0, np.nan, np.nan, 33.0, 36.0, **{"y-front": [0, 0, 23.0, np.nan, 0, 0]}
    )
    clamped = predicted(compiled(maps), "EXX", temperatures, np.zeros(6))
    assert clamped.status == [
        Status.INTERPOLATED, Status.AT_MAP, Status.STAND_IN, NO_READING, "clamped", "clamped",
    ]  # fmt: skip
    np.testing.assert_array_equal(clamped.values, [5.0, 0.0, 5.0, np.nan, 10.0, 10.0])
    extrapolating = compiled(maps, out_of_range=OutOfRange.EXTRAPOLATE)
    further = predicted(extrapolating, "EXX", temperatures, np.zeros(6))
    assert further.status[4:] == [Status.EXTRAPOLATED, OUTSIDE_MAPS]
    np.testing.assert_allclose(further.values[4:], [13.0, np.nan])


def test_a_stand_in_without_any_readings_may_be_left_out():
    """Temperatures of x-middle alone, though y-front is its stand-in in the maps."""
    maps = [
        error_map(f"Run #{i}", {"x-middle": t, "y-front": t}, table("EXX", [10.0 * i], [0]))
        for i, t in enumerate([20.0, 30.0])
    ]
    assert predicted(compiled(maps), "EXX", at_x_middle(25.0), [0.0]).values.tolist() == [5.0]
    nothing = predicted(compiled(maps), "EXX", {}, [0.0])
    assert nothing.status == [NO_READING]
    assert np.isnan(nothing.values).all()


def test_a_stand_in_that_cools_while_the_sensor_warms_has_its_own_order():
    """y-front 40, 34, 30 °C in Runs 1, 2, 3: at 31 °C three quarters from Run 2 to Run 3."""
    maps = [
        error_map(f"Run #{i}", {"x-middle": x, "y-front": y}, table("EXX", [error], [0]))
        for i, (x, y, error) in enumerate(
            [(20.0, 40.0, 0.0), (24.0, 34.0, 8.0), (32.0, 30.0, 20.0)], start=1
        )
    ]
    temperatures = at_x_middle(*[np.nan] * 3, **{"y-front": [31.0, 37.0, 34.0]})
    found = predicted(compiled(maps), "EXX", temperatures, np.zeros(3))
    assert found.values.tolist() == [17.0, 4.0, 8.0]
    for y, error in zip([31.0, 37.0, 34.0], found.values, strict=True):
        assert errors_of(compiled(maps), "EXX", {"y-front": y}).tolist() == [error]


def test_a_component_that_the_model_lacks_is_refused_with_the_reason():
    maps = [
        error_map("Run #1", 20.0, table("EYX", [0.0], [0]), table("EXX", [0.0], [0])),
        error_map("Run #2", 30.0, table("EYX", [0.0], [0])),
    ]
    with pytest.raises(InvalidContent) as refusal:
        predicted(compiled(maps), "EXX", at_x_middle(25.0), [0.0])
    assert refusal.value.detail == (
        "expected a component of the model (EYX), got EXX: measured in Run #1 only, at least two "
        "maps are needed"
    )
    with pytest.raises(InvalidContent, match="got EZZ: no map has it"):
        predicted(compiled(maps), "EZZ", at_x_middle(25.0), [0.0])


# --- points ------------------------------------------------------------------------------


LINES = {"x": MeasuringLine((0.0, 250.0, 100.0), (0.0, 0.0, 60.0))}


def rich_maps(rng):
    """Every kind of component, on sensors of their own, some bidirectional, x on a line."""
    grid = np.array([0.0, 110.0, 500.0])
    return [
        error_map(
            f"Run #{i}",
            {"x-middle": t, "z-column": t + 3.0, "y-front": t - 1.0, "spindle": 2 * t},
            table("EXX", rng.normal(size=3), grid, rng.normal(size=3)),
            table("EBX", rng.normal(scale=30, size=3), grid),
            table("EAY^x", rng.normal(scale=9, size=3), grid),
            table("EZZ", rng.normal(size=3), grid),
            table("ECZ", rng.normal(scale=30, size=3), grid),
            table("SZX", rng.normal(scale=30, size=1)),
            lines=LINES,
        )
        for i, t in enumerate([20.0, 24.0, 31.0])
    ]


def test_points_are_the_volumetric_error_of_the_components_at_their_own_coordinate():
    rng = np.random.default_rng(5)
    model = compiled(rich_maps(rng))
    n = 60
    t = rng.uniform(20.0, 31.0, n)
    live = {"x-middle": t, "z-column": t + 2.0}
    points, tools = rng.uniform(0, 500, (n, 3)), rng.uniform(-100, 200, (n, 3))
    directions = rng.integers(-1, 2, (n, 3))
    found = predict_points(model, live, points, tools, directions)
    axis = {"EXX": 0, "EBX": 0, "EAY^x": 1, "EZZ": 2, "ECZ": 2, "SZX": 0}
    alone = {
        code: predict_component(model, code, live, points[:, i], directions[:, i]).values
        for code, i in axis.items()
    }
    expected, _ = volumetric_error(Chain.parse("XYFZ"), alone, points, tools, LINES)
    np.testing.assert_array_equal(found.values, expected)
    for i in range(0, n, 7):
        now = {name: values[i : i + 1] for name, values in live.items()}
        one = predict_points(model, now, points[i : i + 1], tools[i : i + 1], directions[i : i + 1])
        np.testing.assert_array_equal(one.values[0], found.values[i])
        assert one.status == [found.status[i]]


def test_a_point_is_as_trustworthy_as_its_worst_component():
    """EXX and others follow x-middle (stand-in y-front), EZZ and others z-column."""
    model = compiled(rich_maps(np.random.default_rng(6)))
    cases = {
        Status.AT_MAP: (20.0, 23.0, 0.0),
        Status.INTERPOLATED: (20.0, 25.0, 0.0),
        Status.STAND_IN: (np.nan, 25.0, 25.0),
        Status.CLAMPED: (np.nan, 60.0, 25.0),
        NO_READING: (21.0, np.nan, 0.0),
    }
    columns = zip(*cases.values(), strict=True)
    live = dict(zip(["x-middle", "z-column", "y-front"], map(np.array, columns), strict=True))
    points = np.full((5, 3), 100.0)
    found = predict_points(model, live, points, np.zeros((5, 3)), np.zeros((5, 3)))
    assert found.status == list(cases)
    assert np.isfinite(found.values[:4]).all()
    assert np.isnan(found.values[4]).all()


def test_outside_what_the_policy_allows_there_is_no_point():
    model = compiled(rich_maps(np.random.default_rng(6)), out_of_range=OutOfRange.REJECT)
    live = {"x-middle": np.array([25.0]), "z-column": np.array([90.0])}
    found = predict_points(model, live, np.ones((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)))
    assert found.status == [OUTSIDE_MAPS]
    assert np.isnan(found.values).all()


def test_an_unknown_rotation_makes_a_point_unknown_even_where_it_has_no_lever():
    """ECZ of XYFZ turns the tool alone, and there is no tool offset here."""
    tables = [table("EXX", [1.0], [0]), table("ECZ", [5.0], [0])]
    maps = [
        error_map(f"Run #{i}", {"x-middle": t, "z-column": t}, *tables)
        for i, t in enumerate([20.0, 30.0])
    ]
    live = at_x_middle(25.0, 25.0, **{"z-column": [25.0, np.nan]})
    points = np.ones((2, 3))
    found = predict_points(compiled(maps), live, points, np.zeros((2, 3)), np.zeros((2, 3)))
    assert found.status == [Status.INTERPOLATED, NO_READING]
    np.testing.assert_array_equal(found.values, [[1.0, 0.0, 0.0], [np.nan] * 3])


def test_without_two_maps_no_error_known_is_not_an_error_of_zero():
    with pytest.raises(NotEnoughMaps, match="needs at least two error maps"):
        predict_points(
            compiled([]), at_x_middle(25.0), np.ones((1, 3)), np.zeros((1, 3)), np.zeros((1, 3))
        )
