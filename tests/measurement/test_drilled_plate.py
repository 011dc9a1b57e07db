"""Holes of a plate: what a known machine drilled is found again, however the plate lay."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.measurement.drilled_plate import evaluate_drilled_plate
from tests.geometry.example_fields import random_field

UM_PER_MM = 1000.0
COLUMNS = np.array([0.0, 60.0, 150.0, 240.0, 300.0])
ROWS = np.array([0.0, 80.0, 130.0, 200.0])
GRID = np.array([(x, y) for y in ROWS for x in COLUMNS])
SCATTERED = np.random.default_rng(40).uniform(0.0, 300.0, (25, 2))
PLANE_Z = 50.0


def drilled(field, holes, z=PLANE_Z, tool=(0.0, 0.0, 0.0)):
    """Where a machine puts the tool: nominal plus the volumetric error [mm]."""
    points = np.column_stack([holes, np.full(len(holes), z)])
    return holes + field.at(points, tool)[0][:, :2] / UM_PER_MM


def laid(points_mm, angle_rad=0.0, shift=(0.0, 0.0)):
    """Turn and shift a plate, as it lies on a coordinate machine."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return points_mm @ np.array([[c, s], [-s, c]]) + shift


def plane_machine(chain="FXYZ", seed=6, squareness=-23.0):
    """EXX, EYX, EXY, EYY with nodes at the columns and rows, SXY, and nothing that turns."""
    rng = np.random.default_rng(seed)
    tables = {f"E{w}X": Table(COLUMNS, rng.normal(scale=6.0, size=5)) for w in "XY"}
    tables |= {f"E{w}Y": Table(ROWS, rng.normal(scale=6.0, size=4)) for w in "XY"}
    return ErrorField.make(Chain.parse(chain), tables | {"SXY": Table((), squareness)})


def without_line(positions, values):
    return values - np.polyval(np.polyfit(positions, values, 1), positions)


def tables_of(plate):
    return {table.component.code: table for table in plate.result.tables}


@pytest.mark.parametrize("angle", [0.0, 1e-3, 1.0, -2.5, math.pi])
@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ", "XFYZ"])
def test_rows_and_columns_give_each_axis_error_back(chain, angle):
    """Linear errors up to a constant, straightness up to a line, whose slopes are SXY.

    Second order is left: the fitted turn of 1e-4 times errors of 20 µm.
    """
    field = plane_machine(chain)
    plate = evaluate_drilled_plate(GRID, laid(drilled(field, GRID), angle, (400.0, -70.0)))
    found = tables_of(plate)
    truth = {code: values[0] for code, (_, values) in field.tables.items()}
    for code, positions in (("EXX", COLUMNS), ("EYY", ROWS)):
        constant = truth[code] - truth[code].mean()
        np.testing.assert_allclose(found[code].errors, constant, atol=2e-3)
        np.testing.assert_allclose(found[code].positions_mm, positions)
    for code, positions in (("EYX", COLUMNS), ("EXY", ROWS)):
        np.testing.assert_allclose(
            found[code].errors, without_line(positions, truth[code]), atol=2e-3
        )
    slopes = [np.polyfit(p, truth[c], 1)[0] for c, p in (("EYX", COLUMNS), ("EXY", ROWS))]
    assert found["SXY"].errors[0] == pytest.approx(-23.0 + UM_PER_MM * sum(slopes), abs=2e-2)
    assert plate.result.figures["rms_without_rows_and_columns_um"] < 2e-3
    # The plate's own turn is the fitted one less what the machine turns it by, under 1e-4 rad.
    turned = (plate.rotation_urad / 1e6 - angle + math.pi) % (2 * math.pi) - math.pi
    assert abs(turned) < 1e-4


@pytest.mark.parametrize("holes", [GRID, SCATTERED], ids=["grid", "scattered"])
def test_a_map_of_the_plate_drills_the_same_plate(holes):
    """Scale and squareness alone: the components put back predict every hole, rigidly moved."""
    field = ErrorField.make(
        Chain.parse("XYFZ"),
        {
            "EXX": Table([0.0, 300.0], [3.0, -9.0]),
            "EYY": Table([0.0, 300.0], [0.0, 5.0]),
            "SXY": Table((), 31.0),
        },
    )
    measured = drilled(field, holes)
    plate = evaluate_drilled_plate(holes, measured)
    np.testing.assert_allclose(plate.scale_um_per_m, [-40.0, 5.0 / 0.3], atol=0.01)
    assert plate.squareness_um_per_m == pytest.approx(31.0, abs=0.01)
    found = {c: Table(t.positions_mm, t.errors) for c, t in tables_of(plate).items()}
    again = drilled(ErrorField.make(Chain.parse("XYFZ"), found), holes)
    np.testing.assert_allclose(
        evaluate_drilled_plate(holes, again).errors_um, plate.errors_um, atol=1e-3
    )
    assert np.abs(plate.errors_um).max() > 3.0
    np.testing.assert_allclose(plate.residuals_um, 0.0, atol=1e-3)


def test_the_worked_example_by_hand():
    """docs/methods/drilled-plate.md: 200 by 100 mm, 4 µm too long, right edge unmoved in y.

    EXX grows by 4 µm over 200 mm: 20 µm/m. The upper holes lie 1 µm to the right over
    100 mm: SXY = 10 µm/m.
    """
    nominal = [[0, 0], [200, 0], [0, 100], [200, 100]]
    measured = [[0, 0], [200.004, 0], [0.001, 100], [200.005, 100]]
    plate = evaluate_drilled_plate(nominal, measured)
    assert plate.scale_um_per_m == pytest.approx([20.0, 0.0], abs=1e-3)
    assert plate.squareness_um_per_m == pytest.approx(10.0, abs=1e-3)
    found = tables_of(plate)
    np.testing.assert_allclose(found["EXX"].errors, [-2.0, 2.0], atol=1e-3)
    assert set(found) == {"EXX", "EYY", "SXY"}


def test_squareness_has_the_sign_of_8_58():
    """Of positive SXY the angle between the axes is less than a right one."""
    for sxy in (50.0, -50.0):
        sheared = GRID + np.column_stack([sxy * GRID[:, 1] / 1e6, np.zeros(20)])
        assert evaluate_drilled_plate(GRID, sheared).squareness_um_per_m == pytest.approx(
            sxy, abs=1e-3
        )
        # The same plate turned until its y edge is right: e_y gains SXY·x.
        other = GRID + np.column_stack([np.zeros(20), sxy * GRID[:, 0] / 1e6])
        assert evaluate_drilled_plate(GRID, other).squareness_um_per_m == pytest.approx(
            sxy, abs=1e-2
        )


@given(st.floats(-3.0, 3.0), st.floats(-900, 900), st.floats(-900, 900), st.booleans())
def test_how_the_plate_lay_does_not_matter(angle, x, y, on_a_grid):
    holes = GRID if on_a_grid else SCATTERED
    rng = np.random.default_rng(41)
    measured = holes + rng.normal(scale=0.005, size=holes.shape)
    one = evaluate_drilled_plate(holes, measured)
    other = evaluate_drilled_plate(holes, laid(measured, angle, (x, y)))
    np.testing.assert_allclose(other.errors_um, one.errors_um, atol=1e-6)
    for ours, theirs in zip(one.result.tables, other.result.tables, strict=True):
        np.testing.assert_allclose(theirs.errors, ours.errors, atol=1e-6)
        np.testing.assert_allclose(theirs.covariance, ours.covariance, atol=1e-6)
    turned = (other.rotation_urad - one.rotation_urad) / 1e6 - angle
    assert math.sin(turned) == pytest.approx(0.0, abs=1e-9)


def test_the_rigid_motion_is_scipys():
    """Rotation.align_vectors solves the same least squares in space."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(42)
    measured = laid(SCATTERED + rng.normal(scale=0.01, size=SCATTERED.shape), 0.7, (10.0, 20.0))
    centred = [np.pad(p - p.mean(axis=0), ((0, 0), (0, 1))) for p in (measured, SCATTERED)]
    rotation, _ = Rotation.align_vectors(*centred)
    plate = evaluate_drilled_plate(SCATTERED, measured)
    assert plate.rotation_urad / 1e6 == pytest.approx(rotation.as_rotvec()[2], abs=1e-12)
    shift = measured.mean(axis=0) - (rotation.apply(np.pad(SCATTERED, ((0, 0), (0, 1)))))[
        :, :2
    ].mean(axis=0)
    np.testing.assert_allclose(plate.shift_mm, shift, atol=1e-9)


@pytest.mark.parametrize("way", [0, 1], ids=["warmer when drilled", "colder when drilled"])
def test_a_plate_that_has_shrunk_is_enlarged_again(way):
    """Aluminium, 23 µm/(m K), 4 K: 92 µm/m, which else passes for scale."""
    difference = (4.0, -4.0)[way]
    cold = drilled(plane_machine(), GRID) * (1.0 - 23e-6 * difference)
    blind = evaluate_drilled_plate(GRID, cold)
    aware = evaluate_drilled_plate(
        GRID, cold, expansion_um_per_m_k=23.0, drilled_minus_measured_c=difference
    )
    truth = evaluate_drilled_plate(GRID, drilled(plane_machine(), GRID))
    np.testing.assert_allclose(aware.scale_um_per_m, truth.scale_um_per_m, atol=0.02)
    np.testing.assert_allclose(
        blind.scale_um_per_m, truth.scale_um_per_m - 23.0 * difference, atol=0.02
    )
    assert aware.squareness_um_per_m == pytest.approx(truth.squareness_um_per_m, abs=0.01)
    assert any(f"Corrected by {23.0 * difference:g} µm/m" in n for n in aware.result.notes)


def yawing_machine(yaw):
    return ErrorField.make(
        Chain.parse("FXYZ"),
        {"EXX": Table(COLUMNS, [0.0, 2.0, -1.0, 4.0, 3.0]), "ECX": Table(COLUMNS, yaw)},
    )


YAW = np.array([-26.0, -16.0, -1.0, 9.0, 34.0])
"""Its mean over the columns is zero."""


def test_yaw_makes_the_means_over_rows_belong_to_the_plates_middle():
    """FXYZ: e_x = EXX − y ECX. With the line that is stated, the yaw known from elsewhere
    predicts every hole; without it, holes are off by up to y̅ ECX.
    """
    truth = yawing_machine(YAW)
    plate = evaluate_drilled_plate(
        GRID, drilled(truth, GRID), origin_mm=[0.0, 0.0, PLANE_Z], tool_offset_mm=[0, 0, 0]
    )
    known = {c: Table(t.positions_mm, t.errors) for c, t in tables_of(plate).items()}
    known |= {"ECX": Table(COLUMNS, YAW)}

    def missed(lines):
        again = drilled(ErrorField.make(truth.chain, known, lines), GRID)
        difference = evaluate_drilled_plate(GRID, again).errors_um - plate.errors_um
        return np.abs(difference).max()

    assert missed(plate.result.measuring_lines) < 2e-3
    assert missed(None) > 1.0
    assert plate.result.measuring_lines["x"].point_mm == (0.0, ROWS.mean(), PLANE_Z)


def test_the_mean_yaw_over_the_plate_passes_for_squareness():
    """e_x = −y · 40 µrad is a squareness of −40 µm/m, whatever it comes from."""
    one, other = (
        evaluate_drilled_plate(GRID, drilled(yawing_machine(YAW + mean), GRID))
        for mean in (0.0, 40.0)
    )
    assert other.squareness_um_per_m - one.squareness_um_per_m == pytest.approx(-40.0, abs=0.02)
    np.testing.assert_allclose(other.residuals_um, one.residuals_um, atol=2e-3)


def test_tables_count_from_the_machines_zero():
    plate = evaluate_drilled_plate(
        GRID, GRID, origin_mm=[100.0, -40.0, 7.0], tool_offset_mm=[0.0, 0.0, 90.0]
    )
    found = tables_of(plate)
    np.testing.assert_allclose(found["EXX"].positions_mm, COLUMNS + 100.0)
    np.testing.assert_allclose(found["EXY"].positions_mm, ROWS - 40.0)
    line = plate.result.measuring_lines["y"]
    assert line.point_mm == (100.0 + COLUMNS.mean(), -40.0, 7.0)
    assert line.tool_offset_mm == (0.0, 0.0, 90.0)
    assert not evaluate_drilled_plate(GRID, GRID).result.measuring_lines


MISSING = np.delete(GRID, [3, 7, 16], axis=0)
NOISE_UM = np.array([1.5, 0.6])


@pytest.mark.slow
@pytest.mark.parametrize("holes", [GRID, MISSING, SCATTERED], ids=["grid", "gaps", "scattered"])
def test_the_stated_covariances_are_the_scatter(holes):
    """600 plates with other noise in x than in y, turned at will: 6 % on a variance."""
    rng = np.random.default_rng(43)
    errors, stated = {}, {}
    for _ in range(600):
        noise = rng.normal(size=holes.shape) * NOISE_UM / UM_PER_MM
        plate = evaluate_drilled_plate(holes, laid(holes + noise, rng.uniform(-1, 1)))
        for code, table in tables_of(plate).items():
            errors.setdefault(code, []).append(table.errors)
            stated.setdefault(code, []).append(table.covariance)
    assert set(errors) == (
        {"EXX", "EYY", "SXY"} if holes is SCATTERED else {"EXX", "EYX", "EXY", "EYY", "SXY"}
    )
    for code, values in errors.items():
        mean = np.mean(stated[code], axis=0)
        empirical = np.atleast_2d(np.cov(np.array(values).T))
        np.testing.assert_allclose(empirical, mean, atol=0.2 * mean.max(), err_msg=code)


@pytest.mark.slow
def test_the_standard_errors_of_scale_and_squareness_are_their_scatter():
    """A plate three times as long as wide, so that x and y cannot stand for each other."""
    holes = SCATTERED * [1.0, 0.33]
    rng = np.random.default_rng(44)
    scales, squareness, stated = [], [], []
    for _ in range(1000):
        plate = evaluate_drilled_plate(
            holes, holes + rng.normal(size=(25, 2)) * NOISE_UM / UM_PER_MM
        )
        scales.append(plate.scale_um_per_m)
        squareness.append(plate.squareness_um_per_m)
        figures = plate.result.figures
        stated.append(
            [*plate.scale_standard_errors_um_per_m, figures["SXY_standard_error_um_per_m"]]
        )
    found = [*np.std(scales, axis=0), np.std(squareness)]
    np.testing.assert_allclose(found, np.sqrt(np.mean(np.square(stated), axis=0)), rtol=0.1)


@pytest.mark.slow
def test_noise_is_found_and_its_degrees_of_freedom():
    rng = np.random.default_rng(45)
    field = plane_machine()
    noise = [
        evaluate_drilled_plate(
            GRID, drilled(field, GRID) + rng.normal(size=(20, 2)) * NOISE_UM / UM_PER_MM
        ).result.figures
        for _ in range(300)
    ]
    # 20 holes less 5 columns and 4 rows, of which one constant is in both.
    assert noise[0]["noise_degrees_of_freedom"] == 12
    found = [np.sqrt(np.mean([f[f"noise_{u}_um"] ** 2 for f in noise])) for u in "xy"]
    np.testing.assert_allclose(found, NOISE_UM, rtol=0.05)


def test_three_holes_have_scale_and_squareness_but_no_uncertainty_of_their_own():
    holes = np.array([[0.0, 0.0], [200.0, 0.0], [50.0, 150.0]])
    measured = holes @ np.array([[1 + 30e-6, 0.0], [12e-6, 1 - 20e-6]])
    plate = evaluate_drilled_plate(holes, measured)
    assert plate.scale_um_per_m == pytest.approx([30.0, -20.0], abs=0.01)
    assert plate.squareness_um_per_m == pytest.approx(12.0, abs=0.01)
    assert all(table.covariance is None for table in plate.result.tables)
    assert np.isnan(plate.scale_standard_errors_um_per_m).all()
    assert any("no standard errors" in note for note in plate.result.notes)
    stated = evaluate_drilled_plate(holes, measured, repeatability_um=2.0)
    assert all(table.covariance is not None for table in stated.result.tables)
    assert stated.result.figures["noise_x_um"] == 2.0


def test_rows_and_columns_that_do_not_hang_together_are_no_grid():
    """Two rectangles without a row or a column in common."""
    one = np.array([(x, y) for x in (0.0, 50.0) for y in (0.0, 40.0)])
    holes = np.vstack([one, one + np.array([111.0, 222.0])])
    plate = evaluate_drilled_plate(holes, holes)
    assert set(tables_of(plate)) == {"EXX", "EYY", "SXY"}
    assert any("Too few holes share rows and columns" in note for note in plate.result.notes)


def test_holes_beside_the_grid_do_not_spoil_it():
    field = plane_machine()
    holes = np.vstack([GRID, [[33.0, 44.0], [222.0, 111.0]]])
    found = tables_of(evaluate_drilled_plate(holes, drilled(field, holes)))
    alone = tables_of(evaluate_drilled_plate(GRID, drilled(field, GRID)))
    assert set(found) == set(alone)
    for code, table in found.items():
        np.testing.assert_allclose(table.errors, alone[code].errors, atol=1e-3)


def test_a_hole_far_from_the_rest_is_suspicious_and_kept():
    rng = np.random.default_rng(46)
    measured = SCATTERED + rng.normal(scale=0.002, size=(25, 2))
    assert evaluate_drilled_plate(SCATTERED, measured).suspicious == ()
    measured[9] += 0.08, -0.05
    plate = evaluate_drilled_plate(SCATTERED, measured)
    assert plate.suspicious == (9,)
    assert len(plate.errors_um) == 25
    assert any("index 9" in note for note in plate.result.notes)


def test_a_machine_that_turns_leaves_what_rows_and_columns_cannot_hold():
    """Rotations multiply coordinates: no sum of a column and a row. It shows as noise."""
    field = random_field("XYFZ", seed=3, low=0.0, high=300.0)
    plate = evaluate_drilled_plate(GRID, drilled(field, GRID))
    assert plate.result.figures["rms_without_rows_and_columns_um"] > 0.3


@pytest.mark.parametrize(
    ("nominal", "measured", "field", "message"),
    [
        (GRID[:2], GRID[:2], "nominal_mm", r"at least 3 holes in mm, got .*\(2, 2\)"),
        (GRID, GRID[:-1], "measured_mm", "expected 20 holes as nominal, got 19"),
        (GRID.T, GRID.T, "nominal_mm", r"x and y of at least 3 holes .*\(2, 20\)"),
        (GRID[:5], GRID[:5], "nominal_mm", "got holes on one line"),
        (GRID * [1.0, 0.0], GRID, "nominal_mm", "got holes on one line"),
        (GRID, GRID * np.nan, "measured_mm", r"got nan mm at index \[0, 0\]$"),
        (GRID, GRID * 1000.0, "measured_mm", "within ±100000 mm.* perhaps in µm"),
        (GRID, GRID / 25.4, "measured_mm", "another order or another unit"),
        (GRID, GRID[np.random.default_rng(0).permutation(20)], "measured_mm", "another order"),
        (SCATTERED, SCATTERED * [-1, 1], "measured_mm", "perhaps mirrored"),
        (SCATTERED, SCATTERED[:, ::-1], "measured_mm", "perhaps mirrored"),
        (SCATTERED, ["x"] * 25, "measured_mm", "expected numbers in mm"),
    ],
)
def test_bad_holes_are_refused_by_the_field_that_is_to_blame(nominal, measured, field, message):
    with pytest.raises(InvalidContent, match=message) as refused:
        evaluate_drilled_plate(nominal, measured)
    assert refused.value.errors[0].field == field


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("origin_mm", [1.0, 2.0], "x, y and z of a point in mm"),
        ("tool_offset_mm", [1.0, 2.0, np.inf], "got inf mm"),
        ("expansion_um_per_m_k", 23e-6 * 1e9, r"within ±100 µm/\(m K\), got 23000"),
        ("drilled_minus_measured_c", math.nan, "within ±100 °C, got nan °C"),
        ("repeatability_um", -1.0, "got -1 µm"),
    ],
)
def test_bad_options_are_refused(option, value, message):
    with pytest.raises(InvalidContent, match=message) as refused:
        evaluate_drilled_plate(GRID, GRID, **{option: value})
    assert refused.value.errors[0].field == option
