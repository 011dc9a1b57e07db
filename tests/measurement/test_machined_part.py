"""Straightness of a machined edge: the source's table, its matrix, and uncertainty."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.volumetric_error import volumetric_error
from app.measurement.machined_part import evaluate_machined_part
from app.measurement.outliers import far_from_the_rest
from app.thermal.correlation import fisher_interval
from tests.geometry.example_fields import random_field

UM_PER_MM = 1000.0

# [P] Table II as printed: position along y, straightness by the mathematical model, by CMM [mm].
TABLE_II = np.array([
    (-80, 0.000216, 0.0003), (-70, 0.00196, 0), (-60, 0.0003, 0.0007), (-50, 0.00014, 0.0009),
    (-40, 0.00136, 0), (-30, 0.00012, 0.0005), (-20, 0.00018, -0.0001), (-10, 0.0001, -0.0006),
    (0, 0, -0.0002), (10, -0.0001, -0.0001), (20, -0.0001, -0.0009), (30, -0.00018, -0.0004),
    (40, -0.00032, -0.0007), (50, -0.0003, -0.0002), (60, -0.0004, -0.0005),
    (70, -0.00024, -0.0001), (80, -0.00038, 0.0007),
])  # fmt: skip
POSITIONS = TABLE_II[:, 0]
MODEL_UM, CMM_UM = TABLE_II[:, 1:].T * UM_PER_MM
TEN_TIMES_TOO_LARGE = (1, 4)
"""The rows −70 and −40, where the model's values are ten times their neighbours'."""


def table_ii(model_um=MODEL_UM):
    return evaluate_machined_part("EXY", POSITIONS, CMM_UM, model_um)


def test_table_iis_suspicious_rows_are_found_by_their_distance_and_kept():
    part = table_ii()
    assert part.suspicious_measured == ()
    (note,) = (n for n in part.result.notes if n.startswith("Suspicious"))
    assert "predicted_um: 1.96 µm at -70 mm, 1.36 µm at -40 mm" in note
    # Kept as printed: the bias contains them.
    assert part.comparison.bias_um == pytest.approx(np.mean(CMM_UM - MODEL_UM))


def test_a_tenth_of_the_two_rows_is_not_suspicious():
    """0.000196 and 0.000136 mm lie among their neighbours: the rows look like misprints."""
    model = MODEL_UM.copy()
    model[list(TEN_TIMES_TOO_LARGE)] /= 10.0
    assert not [n for n in table_ii(model).result.notes if n.startswith("Suspicious")]


def test_table_iis_straightness_by_polyfit():
    part = table_ii()
    line = np.polyval(np.polyfit(POSITIONS, CMM_UM, 1), POSITIONS)
    (table,) = part.result.tables
    np.testing.assert_allclose(table.errors, CMM_UM - line, atol=1e-12)
    assert table.component.code == "EXY"
    # docs/methods/machined-part.md prints these.
    figures = {name: round(value, 2) for name, value in part.result.figures.items()}
    assert figures["straightness_um"] == 1.85
    assert figures["slope_um_per_m"] == -4.12
    assert figures["residual_standard_deviation_um"] == 0.49
    assert figures["bias_um"] == -0.18
    assert figures["rms_difference_um"] == 0.74
    assert figures["rms_without_line_um"] == 0.68
    assert figures["correlation"] == -0.16
    assert (figures["correlation_low"], figures["correlation_high"]) == (-0.61, 0.36)
    assert figures["correlation_as_came"] == 0.17


def test_what_table_iis_columns_have_in_common_is_their_slope():
    """[P]'s conclusion, looked at: with the two rows corrected r is 0.40, and 0.08 without slopes.

    The CMM column still falls by 4.1 µm/m, though the text calls it the deviation from the
    regression line; neither r differs from zero (95 %).
    """
    model = MODEL_UM.copy()
    model[list(TEN_TIMES_TOO_LARGE)] /= 10.0
    comparison = table_ii(model).comparison
    assert comparison.correlation_as_came == pytest.approx(0.40, abs=0.005)
    assert comparison.correlation == pytest.approx(0.08, abs=0.005)
    for low, high in (comparison.interval, fisher_interval(comparison.correlation_as_came, 17)):
        assert low < 0 < high
    assert abs(comparison.slope_difference_um_per_m) < 0.3


def test_the_second_row_of_10_and_11_follows_from_the_matrix_with_the_other_sign():
    """[P] 9 times P_c: δ_y − ε_x p_z + ε_z p_x, where 10 and 11 print + ε_x p_z − ε_z p_x."""
    ex, ey, ez = 3e-6, -5e-6, 7e-6
    dx, dy, dz = 0.011, -0.017, 0.013
    ax, ay, az = 100.0, 200.0, 300.0
    px, py, pz = 19.0, 23.0, 29.0
    matrix_9 = np.array([
        [1, -ez, ey, ax + dx], [ez, 1, -ex, ay + dy], [-ey, ex, 1, az + dz], [0, 0, 0, 1]
    ])  # fmt: skip
    ideal = np.array([ax + px, ay + py, az + pz])
    error = (matrix_9 @ [px, py, pz, 1.0])[:3] - ideal
    rows = [dx - ez * py + ey * pz, dy + ez * px - ex * pz, dz - ey * px + ex * py]
    np.testing.assert_allclose(error, rows, atol=1e-12)
    printed = dy + ex * pz - ez * px
    assert abs(error[1] - printed) > 1e-5
    # And it is the rule's for a workpiece-side axis, ω × p.
    names = {"EXX": dx, "EYX": dy, "EZX": dz}
    errors = {code: np.array([value * UM_PER_MM]) for code, value in names.items()}
    errors |= {code: np.array([v * 1e6]) for code, v in (("EAX", ex), ("EBX", ey), ("ECX", ez))}
    found, _ = volumetric_error(Chain.parse("XFYZ"), errors, [[px, py, pz]])
    np.testing.assert_allclose(found[0] / UM_PER_MM, rows, atol=1e-12)


def test_matrix_3_is_the_shift_times_the_rotation_not_the_rotation_times_the_shift():
    """[P] 3 writes E_rot E_trans; its right side has the translations unturned."""
    ex, ey, ez = 3e-3, -5e-3, 7e-3
    rotation = np.array([[1, -ez, ey, 0], [ez, 1, -ex, 0], [-ey, ex, 1, 0], [0, 0, 0, 1]])
    shift = np.eye(4)
    shift[:3, 3] = 100.0, 200.0, 300.0
    printed = rotation + shift - np.eye(4)
    np.testing.assert_allclose(shift @ rotation, printed, atol=1e-15)
    assert np.abs(rotation @ shift - printed).max() > 0.5


def test_the_worked_example_by_hand():
    """docs/methods/machined-part.md: 0, 3, 0 µm at 0, 50, 100 mm."""
    regression = evaluate_machined_part("EXY", [0, 50, 100], [0, 3, 0], repeatability_um=0.6)
    (table,) = regression.result.tables
    np.testing.assert_allclose(table.errors, [-1.0, 2.0, -1.0], atol=1e-12)
    # I − H of three even points is [1, −2, 1]/6 · [1, −2, 1].
    np.testing.assert_allclose(table.standard_errors, 0.6 * np.sqrt([1 / 6, 4 / 6, 1 / 6]))
    assert regression.result.figures["straightness_um"] == pytest.approx(3.0)
    # Middle minus an end is (−3, 6, −3)/6 of the readings: √1.5 σ.
    assert regression.result.figures["straightness_standard_error_um"] == pytest.approx(
        0.6 * np.sqrt(1.5)
    )
    ends = evaluate_machined_part("EXY", [0, 50, 100], [0, 3, 0], line="end-points")
    np.testing.assert_allclose(ends.result.tables[0].errors, [0.0, 3.0, 0.0], atol=1e-12)
    assert ends.result.tables[0].covariance is None


@given(
    st.lists(st.floats(-50, 50), min_size=3, max_size=12),
    st.floats(-100, 100),
    st.floats(-0.5, 0.5),
    st.sampled_from(["least-squares", "end-points"]),
)
def test_how_the_part_lay_on_the_coordinate_machine_does_not_matter(form, shift, slope, line):
    positions = 10.0 * np.arange(len(form)) ** 1.3
    one = evaluate_machined_part("EZX", positions, form, line=line)
    tilted = np.array(form) + shift + slope * positions
    other = evaluate_machined_part("EZX", positions, tilted, line=line)
    np.testing.assert_allclose(
        other.result.tables[0].errors, one.result.tables[0].errors, atol=1e-9
    )
    assert other.slope_um_per_m == pytest.approx(one.slope_um_per_m + 1000.0 * slope, abs=1e-6)
    assert other.straightness_um == pytest.approx(one.straightness_um, abs=1e-9)


def test_an_edge_cut_by_a_known_machine_shows_its_prediction():
    """The tool cuts along y; the model is the same machine: all that differs is the CMM's line."""
    field = random_field("XYFZ", seed=5)
    positions = field.tables["EXY"][0]
    path = np.column_stack([np.full(8, 130.0), positions, np.full(8, 60.0)])
    predicted = field.at(path, (0.0, 0.0, 120.0))[0][:, 0]
    cmm = predicted + 25.0 - 0.03 * positions
    part = evaluate_machined_part("EXY", positions, cmm, predicted)
    assert part.comparison.correlation == pytest.approx(1.0)
    assert part.comparison.rms_without_line_um == pytest.approx(0.0, abs=1e-9)
    assert part.comparison.slope_difference_um_per_m == pytest.approx(-30.0)


@given(st.lists(st.floats(-9, 9), min_size=10, max_size=10))
def test_the_difference_is_bias_and_slope_and_the_rest(numbers):
    """The three parts are orthogonal: their squares add up."""
    positions = np.array([0.0, 20.0, 50.0, 60.0, 110.0])
    part = evaluate_machined_part("EXY", positions, numbers[:5], numbers[5:])
    c = part.comparison
    slope = c.slope_difference_um_per_m / 1000.0 * positions.std()
    total = c.bias_um**2 + slope**2 + c.rms_without_line_um**2
    assert c.rms_difference_um**2 == pytest.approx(total, abs=1e-9)


FORM = np.array([0.0, 4.0, 1.0, -2.0, -3.0, 5.0, 2.0])
ALONG = np.array([0.0, 15.0, 40.0, 55.0, 80.0, 100.0, 130.0])


@pytest.mark.slow
@pytest.mark.parametrize("line", ["least-squares", "end-points"])
@pytest.mark.parametrize("passes", [1, 3])
def test_the_stated_covariance_is_the_scatter_of_the_deviations(line, passes):
    """1000 parts, points of 0.5 µm: 4.5 % on a variance. Each pass is aligned anew."""
    rng = np.random.default_rng(21)
    errors, stated = [], []
    for _ in range(1000):
        aligned = rng.normal(scale=9.0, size=(passes, 1)) + rng.normal(
            scale=0.1, size=(passes, 1)
        ) * (ALONG)
        read = FORM + aligned + rng.normal(scale=0.5, size=(passes, ALONG.size))
        part = evaluate_machined_part("EXY", ALONG, read, line=line, repeatability_um=0.5)
        errors.append(part.result.tables[0].errors)
        stated.append(part.result.tables[0].covariance)
    mean = np.mean(stated, axis=0)
    np.testing.assert_allclose(np.cov(np.array(errors).T), mean, atol=0.15 * mean.max())
    if passes > 1:
        assert part.result.figures["noise_degrees_of_freedom"] == 10.0


@pytest.mark.slow
def test_the_straightness_has_the_scatter_that_is_stated():
    """Where two points stand out clearly, the range is their difference."""
    rng = np.random.default_rng(22)
    parts = [
        evaluate_machined_part(
            "EXY", ALONG, FORM + rng.normal(scale=0.3, size=7), repeatability_um=0.3
        )
        for _ in range(700)
    ]
    stated = parts[0].result.figures["straightness_standard_error_um"]
    assert np.std([part.straightness_um for part in parts]) == pytest.approx(stated, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("n", [6, 12, 17])
def test_unrelated_columns_are_correlated_beyond_the_interval_once_in_twenty(n):
    """Regression takes one pair's worth: with n pairs the interval would be too narrow."""
    rng = np.random.default_rng(n)
    positions = np.arange(float(n))
    missed = 0
    for _ in range(700):
        part = evaluate_machined_part("EXY", positions, *rng.normal(size=(2, n)))
        low, high = part.comparison.interval
        missed += not low <= 0 <= high
    # 700 trials: the standard error of 5 % is 0.8 %.
    assert missed / 700 == pytest.approx(0.05, abs=0.025)


def test_normal_values_are_seldom_suspicious_and_gross_ones_always():
    rng = np.random.default_rng(23)
    positions = np.arange(17.0)
    found = [far_from_the_rest(positions, rng.normal(size=17)) for _ in range(1000)]
    assert np.mean([bool(f) for f in found]) < 0.03
    for _ in range(200):
        values = rng.normal(size=17) + 0.7 * positions
        values[[3, 11]] += 25.0, -25.0
        assert {3, 11} <= set(far_from_the_rest(positions, values))


@pytest.mark.parametrize("gross", [1.0, 1e-3, 1e4])
def test_a_misread_among_equal_values_is_suspicious_and_rounding_is_not(gross):
    """Eleven values at least: the mean of the deviations contains the misread one."""
    positions = np.arange(11.0)
    values = 0.1 + 0.2 * positions
    assert far_from_the_rest(positions, values) == ()
    values[4] += gross
    assert far_from_the_rest(positions, values) == (4,)
    assert far_from_the_rest(positions[:5], values[:5]) == ()


def test_a_column_that_does_not_vary_has_no_correlation():
    part = evaluate_machined_part("EXY", [0.0, 10.0, 30.0, 70.0], [1.0, 2.0, 0.0, 1.0], np.zeros(4))
    assert part.comparison.correlation is None
    assert "correlation" not in part.result.figures
    assert part.comparison.rms_difference_um == pytest.approx(np.sqrt(1.5))


def test_without_a_prediction_there_is_no_comparison():
    part = evaluate_machined_part("D_x(y)", POSITIONS, CMM_UM)
    assert part.comparison is None
    assert part.result.tables[0].component.code == "EXY"
    assert any("cannot be told apart" in note for note in part.result.notes)


def test_the_path_of_the_cut_is_its_measuring_line():
    part = evaluate_machined_part(
        "EXY", POSITIONS, CMM_UM, measuring_line_mm=[80, 0, 40], tool_offset_mm=[0, 0, 120]
    )
    line = part.result.measuring_lines["y"]
    assert line.point_mm == (80.0, 0.0, 40.0)
    assert line.tool_offset_mm == (0.0, 0.0, 120.0)


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        ({"component": "EYY"}, "component", "straightness component .* got EYY, linear"),
        ({"component": "SXY"}, "component", "got SXY, squareness"),
        ({"positions_mm": [0.0, 1.0], "measured_um": [0, 0]}, "positions_mm", "at least 3"),
        ({"positions_mm": POSITIONS[::-1]}, "positions_mm", "strictly increasing"),
        ({"measured_um": CMM_UM[:-1]}, "measured_um", "runs of 17 readings in µm"),
        ({"measured_um": np.full(17, 80500.0)}, "measured_um", "positions instead of deviations"),
        ({"predicted_um": CMM_UM[:-1]}, "predicted_um", "runs of 17 readings in µm"),
        ({"predicted_um": np.full(17, np.nan)}, "predicted_um", "got nan µm"),
        ({"line": "mean"}, "line", "least-squares or end-points, got 'mean'"),
        ({"repeatability_um": -0.1}, "repeatability_um", "got -0.1 µm"),
        ({"measuring_line_mm": [0.0]}, "measuring_line_mm", "x, y and z of a point in mm"),
    ],
)
def test_bad_input_is_refused_by_the_field_that_is_to_blame(change, field, message):
    arguments = {"component": "EXY", "positions_mm": POSITIONS, "measured_um": CMM_UM} | change
    with pytest.raises(InvalidContent, match=message) as refused:
        evaluate_machined_part(**arguments)
    assert refused.value.errors[0].field == field


def test_micrometres_stated_as_millimetres_are_noted():
    part = evaluate_machined_part("EXY", POSITIONS, TABLE_II[:, 2])
    assert any("if the readings are in mm" in note for note in part.result.notes)
