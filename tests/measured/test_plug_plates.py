"""Measured plates of holes (Sloan telescope, 37 to 650 holes, 2003 to 2014).

What is asserted is what was found: taking out shift and rotation, then scale and
squareness, leaves 4.6 to 8.7 µm (radial, root mean square) of every plate. The plate that
was measured twice shows how far the stated standard errors go: they know the scatter of
the holes, not the coordinate machine nor the plate's temperature.
"""

import csv

import numpy as np
import pytest

from app.measurement.drilled_plate import evaluate_drilled_plate
from examples.measured.data_folder import data_folder

FOLDER = data_folder() / "sdss-plug-plates"

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no measured plates at {FOLDER}")

# Holes; radial rms [µm] without rigid motion, without scale and squareness too; scale of x and
# of y and SXY [µm/m].
FOUND = {
    "D1396A1": (637, 6.42, 6.33, 2.4, -2.0, 8.6),
    "D1413_1": (37, 7.74, 7.22, 0.3, -13.6, -30.7),
    "D1597A_orig_meas_2003": (650, 9.02, 8.09, -1.7, 31.1, 3.3),
    "D1597A_orig_meas2010": (650, 9.33, 8.73, -11.6, 19.8, -10.6),
    "D1597A_redrilled_meas_2011": (650, 10.78, 5.23, -33.9, -35.3, -64.2),
    "D2130A1": (635, 7.68, 5.84, -23.7, -26.5, 16.9),
    "D2130_1": (37, 8.06, 4.61, -27.5, -27.0, 29.2),
    "D8131_1": (82, 8.27, 7.03, 2.8, 11.1, -35.1),
    "D8132_1": (82, 7.91, 7.36, 0.9, -9.1, -21.3),
    "D8133_1": (82, 7.98, 6.55, -1.3, -14.5, -33.0),
    "D8300_1": (53, 6.64, 6.48, 5.4, -5.7, -6.0),
}


def read_plate(name):
    """Nominal and measured x, y of one plate [mm], in the order of the nominal."""
    with (FOLDER / "holes.csv").open(encoding="utf-8", newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["plate_file"] == name]
    columns = ("nom_x_mm", "nom_y_mm", "meas_x_mm", "meas_y_mm")
    holes = np.array([[float(row[column]) for column in columns] for row in rows])
    holes = holes[np.lexsort(holes[:, :2].T)]
    return holes[:, :2], holes[:, 2:]


@pytest.mark.slow
@pytest.mark.parametrize("name", FOUND)
def test_what_each_plate_says(name):
    plate = evaluate_drilled_plate(*read_plate(name))
    count, rigid, affine, scale_x, scale_y, squareness = FOUND[name]
    figures = plate.result.figures
    assert figures["holes"] == count
    assert figures["rms_without_rigid_motion_um"] == pytest.approx(rigid, abs=0.006)
    assert figures["rms_without_scale_and_squareness_um"] == pytest.approx(affine, abs=0.006)
    assert plate.scale_um_per_m == pytest.approx([scale_x, scale_y], abs=0.06)
    assert plate.squareness_um_per_m == pytest.approx(squareness, abs=0.06)
    assert plate.suspicious == ()
    # Their holes lie where stars are: no rows and columns.
    assert len(plate.result.tables) == 3


@pytest.mark.slow
def test_an_independent_least_squares_of_the_redrilled_plate():
    """Shift, rotation, one scale: 8.27 µm; a symmetric shear too: 5.23 µm, at −32 µm/m.

    SXY is the whole change of the angle between the axes, twice the symmetric shear.
    """
    nominal, measured = read_plate("D1597A_redrilled_meas_2011")
    errors = (measured - nominal) * 1000.0
    errors -= errors.mean(axis=0)
    x, y = (nominal - nominal.mean(axis=0)).T
    assert np.sqrt((errors**2).sum(axis=1).mean()) == pytest.approx(14.45, abs=0.01)

    def fitted(*directions):
        design = np.array([np.column_stack(d).ravel() for d in directions]).T
        slopes, *_ = np.linalg.lstsq(design, errors.ravel())
        left = (errors.ravel() - design @ slopes).reshape(-1, 2)
        return slopes * 1000.0, np.sqrt((left**2).sum(axis=1).mean())

    _, left = fitted((-y, x), (x, y))
    assert left == pytest.approx(8.27, abs=0.01)
    slopes, left = fitted((-y, x), (x, 0 * y), (0 * x, y), (y, x))
    plate = evaluate_drilled_plate(nominal, measured)
    assert plate.result.figures["rms_without_scale_and_squareness_um"] == pytest.approx(
        left, abs=1e-3
    )
    assert plate.squareness_um_per_m == pytest.approx(2 * slopes[3], abs=0.02)
    assert slopes[3] == pytest.approx(-32.1, abs=0.1)


@pytest.mark.slow
def test_a_plate_measured_twice_shows_what_the_standard_errors_do_not_know():
    """2003 and 2010, the same 650 holes: scale differs by −10 and −11 µm/m, SXY by −14 µm/m.

    The stated standard errors are 1 to 2 µm/m. Equal scale in x and y is what half a
    kelvin does to an aluminium plate; squareness is a matter of the coordinate machine.
    """
    nominal, early = read_plate("D1597A_orig_meas_2003")
    again, late = read_plate("D1597A_orig_meas2010")
    np.testing.assert_array_equal(nominal, again)
    change = evaluate_drilled_plate(early, late)
    assert change.scale_um_per_m == pytest.approx([-9.9, -11.3], abs=0.1)
    assert change.squareness_um_per_m == pytest.approx(-13.9, abs=0.1)
    figures = evaluate_drilled_plate(nominal, early).result.figures
    assert figures["SXY_standard_error_um_per_m"] == pytest.approx(2.25, abs=0.05)
    assert abs(change.squareness_um_per_m) > 5 * figures["SXY_standard_error_um_per_m"]
    # What both agree on is the plate: 4.6 µm between them, of 8.1 and 8.7 µm in each.
    assert change.result.figures["rms_without_scale_and_squareness_um"] == pytest.approx(
        4.59, abs=0.01
    )
