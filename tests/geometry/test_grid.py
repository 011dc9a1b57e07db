"""Trilinear interpolation against (8.101) as printed, and scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.grid import ErrorGrid, place_in_cells, sample_grid
from tests.geometry.example_fields import TOOL, random_field

X, Y, Z = np.array([0.0, 100.0, 220.0, 480.0]), np.array([10.0, 300.0]), np.array([0.0, 150.0, 500])


def printed(c, x, y, z):
    """(8.101), term by term; c[0] is C1."""
    return (
        c[0] * (1 - x) * (1 - y) * (1 - z) + c[1] * x * (1 - y) * (1 - z)
        + c[2] * x * y * (1 - z) + c[3] * (1 - x) * y * (1 - z)
        + c[4] * (1 - x) * (1 - y) * z + c[5] * x * (1 - y) * z
        + c[6] * x * y * z + c[7] * (1 - x) * y * z
    )  # fmt: skip


def random_grid(seed=0):
    rng = np.random.default_rng(seed)
    return ErrorGrid(X, Y, Z, rng.normal(scale=10.0, size=(4, 2, 3, 3)))


def test_inside_each_cell_it_is_the_printed_equation():
    """With the shares of 8.102-8.104 and the cell's corners 1 to 8."""
    grid = random_grid()
    rng = np.random.default_rng(1)
    for i, j, k in np.ndindex(3, 1, 2):
        for x, y, z in rng.uniform(size=(5, 3)):
            point = [
                X[i] + x * (X[i + 1] - X[i]),
                Y[j] + y * (Y[j + 1] - Y[j]),
                Z[k] + z * (Z[k + 1] - Z[k]),
            ]
            expected = printed(grid.corners(i, j, k), x, y, z)
            np.testing.assert_allclose(grid.at(point)[0], expected, atol=1e-11)


def test_the_corners_have_the_chapters_numbers():
    """1 (0,0,0), 2 (1,0,0), 3 (1,1,0), 4 (0,1,0), 5 to 8 the same at z = 1."""
    where = np.stack(np.meshgrid(X, Y, Z, indexing="ij"), axis=-1)
    found = ErrorGrid(X, Y, Z, where).corners(1, 0, 1)
    bottom = [[100.0, 10.0, 150.0], [220.0, 10.0, 150.0], [220.0, 300.0, 150.0], [100.0, 300, 150]]
    assert found[:4].tolist() == bottom
    assert found[4:].tolist() == [[x, y, 500.0] for x, y, _ in bottom]


def test_the_shares_of_y_and_z_run_to_corners_4_and_5():
    """8.103 and 8.104 print corner 2, where y and z are those of corner 1: 0 in the denominator."""
    where = np.stack(np.meshgrid(X, Y, Z, indexing="ij"), axis=-1)
    p1, p2, _, p4, p5, *_ = ErrorGrid(X, Y, Z, where).corners(1, 0, 1)
    assert (p2 - p1).tolist() == [120.0, 0.0, 0.0]
    point = np.array([133.0, 88.0, 412.0])
    expected = (point - p1) / [p2[0] - p1[0], p4[1] - p1[1], p5[2] - p1[2]]
    for nodes, coordinate, cell, share in zip((X, Y, Z), point, (1, 0, 1), expected, strict=True):
        cells, shares = place_in_cells(nodes, np.array([coordinate]))
        assert cells[0] == cell
        assert shares[0] == pytest.approx(share, rel=1e-14)


def test_at_the_nodes_it_is_the_grid_and_on_faces_both_cells_agree():
    grid = random_grid()
    points = np.stack(np.meshgrid(X, Y, Z, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(grid.at(points), grid.errors_um.reshape(-1, 3), atol=1e-12)
    left, right = grid.at([[100.0 - 1e-9, 77.0, 99.0]]), grid.at([[100.0 + 1e-9, 77.0, 99.0]])
    np.testing.assert_allclose(left, right, atol=1e-8)


def test_it_is_scipys_and_outside_the_nearest_point_of_the_surface():
    grid = random_grid()
    points = np.random.default_rng(2).uniform(-100.0, 600.0, (500, 3))
    nearest = np.clip(points, [X[0], Y[0], Z[0]], [X[-1], Y[-1], Z[-1]])
    expected = RegularGridInterpolator((X, Y, Z), grid.errors_um)(nearest)
    np.testing.assert_allclose(grid.at(points), expected, atol=1e-11)


@pytest.mark.slow
@given(st.lists(st.floats(0.0, 500.0), min_size=3, max_size=3))
def test_it_never_leaves_the_range_of_the_eight_corners(point):
    grid = random_grid()
    found = grid.at(point)[0]
    everything = grid.errors_um.reshape(-1, 3)
    assert (found <= everything.max(axis=0) + 1e-9).all()
    assert (found >= everything.min(axis=0) - 1e-9).all()


def test_many_points_are_as_each_alone():
    grid = random_grid()
    points = np.random.default_rng(3).uniform(0.0, 500.0, (20, 3))
    together = grid.at(points)
    for point, found in zip(points, together, strict=True):
        np.testing.assert_array_equal(grid.at(point)[0], found)


def test_a_sampled_grid_is_the_model_at_its_nodes():
    field = random_field("XYFZ")
    grid = sample_grid(field, X, Y, Z, TOOL)
    assert grid.errors_um.shape == (4, 2, 3, 3)
    expected, _ = field.at([X[3], Y[1], Z[2]], TOOL)
    np.testing.assert_array_equal(grid.errors_um[3, 1, 2], expected[0])


@pytest.mark.parametrize(
    ("x", "message"),
    [
        ([5.0], "x_mm: expected at least 2 coordinates in mm, got 1"),
        ([], "got 0"),
        ([0.0, 0.0], r"strictly increasing coordinates in mm, got \[0.0, 0.0\]"),
        ([1.0, 0.0], "strictly increasing"),
        ([0.0, np.nan], "expected finite"),
        ([[0.0, 1.0]], "expected at least 2"),
    ],
)
def test_what_is_no_grid_is_refused(x, message):
    with pytest.raises(InvalidContent, match=message):
        sample_grid(random_field(), x, Y, Z)


def test_a_grid_is_of_one_thermal_state():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table((), [[1.0], [2.0]])})
    with pytest.raises(InvalidContent, match="expected one thermal state"):
        sample_grid(field, X, Y, Z)
