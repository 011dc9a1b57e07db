"""The box, its points, and what is none."""

import math

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.work_volume import WorkVolume, points_of

BOX = WorkVolume((0.0, 300.0), (-200.0, 200.0), (100.0, 1300.0))


def test_the_lattice_has_every_corner_and_even_steps():
    points = BOX.lattice(3)
    assert points.shape == (27, 3)
    corners = points_of(*BOX.ranges_mm)
    assert {tuple(p) for p in corners} <= {tuple(p) for p in points}
    assert np.unique(points[:, 1]).tolist() == [-200.0, 0.0, 200.0]
    assert points[1].tolist() == [0.0, -200.0, 700.0]


def test_an_axis_that_is_not_there_has_one_place():
    lathe = WorkVolume((0.0, 200.0), (0.0, 0.0), (0.0, 400.0))
    assert lathe.lattice(5).shape == (25, 3)
    assert lathe.diagonal_mm == pytest.approx(math.hypot(200.0, 400.0))


def test_points_are_found_again_by_their_place():
    x, y, z = np.arange(2.0), np.arange(10.0, 13.0), np.arange(20.0, 24.0)
    points = points_of(x, y, z).reshape(2, 3, 4, 3)
    assert points[1, 2, 3].tolist() == [1.0, 12.0, 23.0]


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ((1.0, 0.0), "y_mm: expected a lowest and a highest y in mm, got 1 to 0 mm"),
        ((0.0, math.inf), "got 0 to inf mm"),
        ((math.nan, 1.0), "got nan to 1 mm"),
    ],
)
def test_what_is_no_box_is_refused(ends, message):
    with pytest.raises(InvalidContent, match=message):
        WorkVolume((0.0, 1.0), ends, (0.0, 1.0))


def test_one_point_per_axis_is_no_lattice():
    with pytest.raises(InvalidContent, match="points_per_axis: expected at least 2, got 1"):
        BOX.lattice(1)
