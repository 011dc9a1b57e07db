"""The largest difference in a cell: by hand, never beaten by brute force, and attained."""

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry import grid_difference as module
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.grid import ErrorGrid, sample_grid
from app.geometry.grid_difference import grid_difference
from app.geometry.measuring_line import MeasuringLine
from app.geometry.polynomial_pieces import bernstein_coefficients, cut, degree_along
from tests.geometry.example_fields import LINES, NONRIGID, RIGID, TOOL, constant_field, random_field

X, Y, Z = (
    np.array([0.0, 100.0, 220.0, 480.0]),
    np.array([10.0, 300, 450.0]),
    np.array([0.0, 150, 500]),
)
SIDE = np.array([0.0, 100.0])


def one_cell(chain, tables):
    field = ErrorField.make(Chain.parse(chain), {c: Table(*t) for c, t in tables.items()})
    return field, grid_difference(field, sample_grid(field, SIDE, SIDE, SIDE))


def test_a_kink_is_missed_by_its_height():
    """EXX is 0, 4, 0 at 0, 25, 100 mm: the line between the ends is 0, the error 4 at 25."""
    _, found = one_cell("FXYZ", {"EXX": ([0.0, 25.0, 100.0], [0.0, 4.0, 0.0])})
    assert found.bound_um.ravel().tolist() == [4.0, 0.0, 0.0]
    assert found.bound_length_um.ravel().tolist() == [4.0]
    assert found.attained_um.tolist() == found.bound_um.tolist()
    assert found.attained_length_um.tolist() == found.bound_length_um.tolist()
    assert found.largest_um == 4.0


def test_tables_too_fine_to_be_looked_through_are_refused():
    fine = (np.linspace(0.0, 100.0, 300), np.zeros(300))
    with pytest.raises(InvalidContent, match="got 27000000: ask for a part"):
        one_cell("FXYZ", {"EXX": fine, "EYY": fine, "EZZ": fine})


def test_a_kinked_rotation_is_missed_most_at_the_longest_arm():
    """EBX, 40 µrad at 50 mm between zeros, with the arm z up to 100 mm: 4 µm in x."""
    _, found = one_cell("FXYZ", {"EBX": ([0.0, 50.0, 100.0], [0.0, 40.0, 0.0])})
    np.testing.assert_allclose(found.bound_um.ravel(), [4.0, 0.0, 0.0], atol=1e-14)
    assert found.attained_um.tolist() == found.bound_um.tolist()
    assert found.attained_length_um.tolist() == found.bound_length_um.tolist()


def test_a_workpiece_axis_that_turns_itself_leaves_a_parabola():
    """ECX = 400 µrad x/100 mm turns x: E_y = 40 µm (x/100)², 10 µm below its chord at 50 mm.

    Cut in four, the vertex is an end of two pieces, and the bound is attained.
    """
    _, found = one_cell("XFYZ", {"ECX": ([0.0, 100.0], [0.0, 400.0])})
    np.testing.assert_allclose(found.attained_um.ravel()[1], 10.0)
    np.testing.assert_allclose(found.bound_um.ravel()[1], 10.0)


def test_what_is_linear_in_each_coordinate_is_interpolated_without_a_difference():
    field = constant_field("XYFZ", {"SXY": 10.0, "EAX": 5.0, "ECY": -7.0, "EXX^y": 3.0, "EYY": 2.0})
    found = grid_difference(field, sample_grid(field, X, Y, Z, TOOL), TOOL)
    assert found.largest_um < 1e-12


def differences_at(field, grid, points):
    found = np.abs(grid.at(points) - field.at(points, TOOL)[0])
    return found, np.linalg.norm(found, axis=1)


def by_brute_force(field, grid, seed, n=40_000):
    """The largest in each cell of n random points."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([a[0] for a in grid.nodes_mm], [a[-1] for a in grid.nodes_mm], (n, 3))
    each, length = differences_at(field, grid, points)
    shape = tuple(a.size - 1 for a in grid.nodes_mm)
    cell = tuple(
        np.searchsorted(nodes, points[:, i], side="right") - 1
        for i, nodes in enumerate(grid.nodes_mm)
    )
    most, longest = np.zeros((*shape, 3)), np.zeros(shape)
    np.maximum.at(most, cell, each)
    np.maximum.at(longest, cell, length)
    return most, longest


@pytest.mark.slow
@pytest.mark.parametrize("lines", [None, LINES], ids=["axes", "lines"])
@pytest.mark.parametrize("kinds", [RIGID, NONRIGID], ids=["rigid", "nonrigid"])
@pytest.mark.parametrize("chain", ["FXYZ", "XFYZ", "XYFZ", "XYZF"])
def test_no_random_point_beats_the_bound_and_something_comes_up_to_what_is_attained(
    chain, kinds, lines
):
    field = random_field(chain, kinds, seed=4, lines=lines, positions=5)
    grid = sample_grid(field, X, Y, Z, TOOL)
    found = grid_difference(field, grid, TOOL)
    most, longest = by_brute_force(field, grid, seed=5)
    assert (most <= found.bound_um + 1e-9).all()
    assert (longest <= found.bound_length_um + 1e-9).all()
    assert (found.attained_um <= found.bound_um + 1e-9).all()
    # Random points come close to what is said to be attained (8 in 10 at 3300 points a cell).
    assert (longest / found.attained_length_um).min() > 0.8
    # And the bound is no more than 1/16 above it, mostly nothing.
    assert (found.bound_length_um / found.attained_length_um).max() < 1.0 + 1 / 16


@pytest.mark.parametrize("code", ["ECX", "EBX", "EAX^y", "EBY^x", "ECY^x"])
def test_the_bound_holds_where_parabolas_are_all_there_is(code):
    """Nothing else in the field, so that no kink hides a bound that is too low."""
    positions = SIDE * 5 if "X" in code[:3] else np.array([0.0, 450.0])
    field = ErrorField.make(Chain.parse("XYFZ"), {code: Table(positions, [30.0, 400.0])})
    grid = sample_grid(field, X, Y, Z, TOOL)
    found = grid_difference(field, grid, TOOL)
    most, longest = by_brute_force(field, grid, seed=6)
    assert (most <= found.bound_um + 1e-9).all()
    assert (longest <= found.bound_length_um + 1e-9).all()
    large = found.attained_length_um > 1e-9
    assert (found.bound_length_um[large] <= (1 + 1 / 16) * found.attained_length_um[large]).all()


def test_in_small_boxes_it_is_the_same_as_in_one(monkeypatch):
    field = random_field("XYZF", RIGID, seed=8)
    grid = sample_grid(field, X, Y, Z, TOOL)
    whole = grid_difference(field, grid, TOOL)
    monkeypatch.setattr(module, "POINTS_AT_ONCE", 5000)
    pieces = grid_difference(field, grid, TOOL)
    for name in ("bound_um", "attained_um", "bound_length_um", "attained_length_um"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-12)


def test_a_grid_that_is_not_the_models_own_is_judged_too():
    """Corner values rounded to whole µm: nowhere more than the rounding's own hull away."""
    field = constant_field("XYFZ", {"SXY": 10.0})
    exact = sample_grid(field, X, Y, Z)
    rounded = ErrorGrid(X, Y, Z, np.round(exact.errors_um))
    found = grid_difference(field, rounded)
    assert found.largest_um == pytest.approx(np.abs(rounded.errors_um - exact.errors_um).max())


@pytest.mark.parametrize(
    ("chain", "code", "lines", "degrees"),
    [
        ("FXYZ", "EBX", None, [1, 1, 1]),
        ("XFYZ", "EBX", None, [2, 1, 1]),
        ("XFYZ", "EBX", {"x": MeasuringLine((0.0, 1.0, 2.0))}, [1, 1, 1]),
        ("XYZF", "EBZ", None, [1, 1, 2]),
        ("FXYZ", "EBX^z", None, [1, 1, 2]),
        ("FXYZ", "EBY^x", None, [1, 1, 1]),
        ("XYFZ", "EBY^x", None, [2, 2, 1]),
        ("XYFZ", "EBY^x", {"y": MeasuringLine((0.0, 1.0, 2.0))}, [2, 2, 1]),
        ("XYFZ", "EXX^y", None, [1, 1, 1]),
        ("XYFZ", "EXX", None, [1, 1, 1]),
    ],
)
def test_where_the_model_is_a_parabola(chain, code, lines, degrees):
    table = {code: Table([0.0, 500.0], [0.0, 1.0])}
    field = ErrorField.make(Chain.parse(chain), table, lines)
    assert [degree_along(field, axis) for axis in "xyz"] == degrees


@pytest.mark.parametrize("chain", ["XYFZ", "ZYXF"])
def test_between_nodes_the_model_has_the_degree_that_is_said(chain):
    """Third differences vanish along a degree of 2, second ones along 1."""
    field = random_field(chain, NONRIGID, seed=11)
    for i, axis in enumerate("xyz"):
        nodes = field.nodes_mm(axis)
        points = np.full((4, 3), 123.0)
        points[:, i] = np.linspace(nodes[3], nodes[4], 4)
        errors, _ = field.at(points, TOOL)
        order = degree_along(field, axis) + 1
        np.testing.assert_allclose(np.diff(errors, n=order, axis=0), 0.0, atol=1e-9)


def test_pieces_end_at_all_nodes_and_parabolas_are_cut_in_four():
    tables = np.array([-5.0, 0.0, 30.0, 100.0, 130.0])
    assert cut(SIDE, tables, 1).tolist() == [0.0, 30.0, 100.0]
    finer = cut(SIDE, tables, 2)
    assert set(finer) >= {0.0, 30.0, 100.0}
    assert finer.size % 2 == 1
    assert np.diff(finer[::2]).max() <= 25.0


def test_bernsteins_coefficients_of_a_parabola():
    """f = 0, 1, 0 at 0, 1/2, 1 is 4u(1 − u): coefficients 0, 2, 0."""
    values = np.zeros((3, 1, 1, 1))
    values[1] = 1.0
    assert bernstein_coefficients(values, [2, 1, 1]).ravel().tolist() == [0.0, 2.0, 0.0]
    assert bernstein_coefficients(values, [1, 1, 1]).ravel().tolist() == [0.0, 1.0, 0.0]
