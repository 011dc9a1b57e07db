"""R-test of a rotary axis: Hsieh 2024's points, round trips, and standard errors by Monte Carlo."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import stdtrit

from app.errors import InvalidContent
from app.geometry.rotary_axes import rotary_location_error
from app.measurement.rotary_axis import measure_rotary_axis

PAGE = Path(__file__).parents[2] / "docs" / "methods" / "rotary-axis.md"

TABLE_2 = np.array([
    [0.311, 104.794, -183.893], [104.772, -0.289, -183.8895], [-0.311, -104.751, -183.8895],
])  # fmt: skip
"""[R] Table 2, G0 to G2, at C = 0, −90 and −180°; printed in steps of 0.5 µm."""

C_ERRORS = {"XOC": 13.0, "YOC": -7.0, "AOC": 40.0, "BOC": -60.0}
A_ERRORS = {"YOA": 11.0, "ZOA": 5.0, "BOA": 70.0, "COA": -30.0}
TURN = np.arange(0.0, 360.0, 30.0)
B_ERRORS = {"ZOB": -9.0, "XOB": 4.0, "COB": 50.0, "AOB": -20.0}
BALLS = {"C": [105.0, 20.0, -180.0], "A": [-150.0, 90.0, 60.0], "B": [80.0, 110.0, -40.0]}


def places(axis, errors, ball, angles, pivot=(0.0, 0.0, 0.0)):
    """Where the ball is: its nominal place about the pivot, and the geometry's error."""
    ball, pivot, angle = np.asarray(ball), np.asarray(pivot), np.deg2rad(np.asarray(angles))
    u, v = {"C": (0, 1), "A": (1, 2), "B": (2, 0)}[axis]
    nominal = np.tile(ball, (angle.size, 1))
    arm = ball - pivot
    nominal[:, u] = pivot[u] + np.cos(angle) * arm[u] - np.sin(angle) * arm[v]
    nominal[:, v] = pivot[v] + np.sin(angle) * arm[u] + np.cos(angle) * arm[v]
    pivots = {axis: pivot}
    return nominal + rotary_location_error(errors, ball, {axis: angles}, axis, pivots) / 1000.0


def circle_centre(points):
    """Centre of the circle through three points in space."""
    (a, b), foot = points[:2] - points[2], points[2]
    normal = np.cross(a, b)
    return foot + np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * normal @ normal)


def test_the_c_axis_of_table_2_lies_where_the_circle_of_its_points_has_its_centre():
    """x = −0.0005 mm, y = 0.0215 mm; with the angles too, within the step of the table."""
    centre = circle_centre(TABLE_2)
    np.testing.assert_allclose(centre[:2], [-0.0005, 0.0215], atol=5e-5)
    found = measure_rotary_axis("C", [0.0, -90.0, -180.0], TABLE_2)
    figures = found.result.figures
    at_ball = [figures["axis_x_at_ball_mm"], figures["axis_y_at_ball_mm"]]
    np.testing.assert_allclose(at_ball, [-0.0005, 0.0215], atol=0.0005)
    np.testing.assert_allclose(at_ball, [-0.000125, 0.021625], atol=1e-6)
    assert figures["axis_x_at_ball_standard_error_um"] == pytest.approx(0.22, abs=0.01)


def test_table_2_by_hand():
    """G0 is 3.5 µm lower than G2, 209.545 mm away: 16.7 µrad; G1 as far above their middle.

    From the ball's height of −183.891 mm to z = 0 such tilts carry the axis by 3.07 µm.
    """
    found = measure_rotary_axis("C", [0.0, -90.0, -180.0], TABLE_2)
    expected = {"XOC": -0.125 - 3.07, "YOC": 21.625 + 3.07, "AOC": -16.7, "BOC": -16.7}
    assert found.errors == pytest.approx(expected, abs=0.1)
    assert found.degrees_of_freedom == 9 - 7
    assert found.noise_um == pytest.approx(0.5 / np.sqrt(2.0), abs=0.001)
    assert np.abs(found.residuals_um).max() < 0.26


def test_the_sources_two_points_give_the_position_alone():
    """[R] Table 3 takes G0 and G1: c = (w1 + i w0)/(1 + i) = 0.022 i mm."""
    found = measure_rotary_axis("C", [0.0, -90.0], TABLE_2[:2])
    assert found.errors == pytest.approx({"XOC": 0.0, "YOC": 22.0}, abs=1e-6)
    assert found.axis.direction.tolist() == [0.0, 0.0, 1.0]
    assert found.covariance is None
    assert found.result.tables[0].standard_errors is None
    assert found.result.figures["axial_range_um"] == pytest.approx(3.5)
    said = " ".join(found.result.notes)
    assert "do not determine the direction" in said
    assert "each µrad of AOC or BOC moves them by 0.184 µm at z = 0" in said
    assert "Nothing tells the noise" in said


def test_a_ball_that_is_lower_at_plus_x_is_on_an_axis_that_leans_to_plus_x():
    points = [[100, 0, -0.001], [0, 100, 0], [-100, 0, 0.001], [0, -100, 0]]
    found = measure_rotary_axis("C", [0, 90, 180, 270], points)
    assert found.errors == pytest.approx({"XOC": 0, "YOC": 0, "AOC": 0, "BOC": 10.0}, abs=1e-4)
    assert found.axis.direction[0] == pytest.approx(1e-5, rel=1e-6)


@pytest.mark.parametrize(("axis", "errors"), [("C", C_ERRORS), ("a", A_ERRORS), ("B", B_ERRORS)])
@pytest.mark.parametrize("angles", [TURN, [0, -90, -180], [10, 10, 75, 140, 500.0]])
def test_what_the_geometry_says_comes_back(axis, errors, angles):
    pivot = [20.0, -30.0, -500.0]
    points = places(axis.upper(), errors, BALLS[axis.upper()], angles, pivot)
    found = measure_rotary_axis(axis, angles, points, pivot_mm=pivot)
    assert found.errors == pytest.approx(errors, abs=1e-5)
    assert [table.component.code for table in found.result.tables] == list(errors)
    assert [table.errors[0] for table in found.result.tables] == list(found.errors.values())
    np.testing.assert_allclose(found.start_mm, BALLS[axis.upper()], atol=1e-8)
    np.testing.assert_allclose(found.residuals_um, 0.0, atol=1e-6)


sizes = st.floats(-2000.0, 2000.0)
angle_sets = st.lists(st.integers(-36, 36), min_size=3, max_size=8, unique_by=lambda k: k % 36)
"""In steps of 10°, so at least over 20°: no arc is too short for balls at 107 mm and more."""


@given(
    st.sampled_from("CA"), st.lists(sizes, min_size=4, max_size=4), angle_sets, st.floats(-90, 90)
)
def test_any_axis_comes_back_from_any_three_angles_or_more(axis, values, tens, offset):
    codes = list(C_ERRORS if axis == "C" else A_ERRORS)
    angles = np.array(tens) * 10.0 + offset
    errors = dict(zip(codes, values, strict=True))
    points = places(axis, errors, BALLS[axis], angles)
    found = measure_rotary_axis(axis, angles, points)
    assert found.errors == pytest.approx(errors, abs=1e-3)


def test_nothing_is_linearised():
    """Tilts of 50 mrad: their squares would be 2500 µrad, and 250 µm at 100 mm."""
    errors = {"XOC": 5000.0, "YOC": -3000.0, "AOC": 50_000.0, "BOC": -40_000.0}
    found = measure_rotary_axis("C", TURN, places("C", errors, BALLS["C"], TURN))
    assert found.errors == pytest.approx(errors, abs=1e-5)
    assert "AOC, BOC beyond 10000 µrad is suspicious" in found.result.notes[-1]


shifts = st.lists(st.floats(-500, 500), min_size=3, max_size=3)


@given(st.permutations(range(6)), st.floats(-180, 180), shifts)
def test_the_axis_does_not_depend_on_order_angle_zero_or_origin(order, zero, moved):
    rng = np.random.default_rng(5)
    angles = np.array([0.0, 50.0, 110.0, 170.0, 230.0, 300.0])
    points = places("C", C_ERRORS, BALLS["C"], angles) + rng.normal(scale=1e-3, size=(6, 3))
    one = measure_rotary_axis("C", angles, points)
    pivot = [*moved[:2], 0.0]
    other = measure_rotary_axis(
        "C", angles[order] + zero, points[order] + np.array(moved), pivot_mm=pivot
    )
    assert other.noise_um == pytest.approx(one.noise_um, rel=1e-6)
    for code in ("AOC", "BOC"):
        assert other.errors[code] == pytest.approx(one.errors[code], abs=1e-5)
    for code, name in (("XOC", "axis_x_at_ball_mm"), ("YOC", "axis_y_at_ball_mm")):
        shift = pivot["XY".index(code[0])]
        at_ball = other.result.figures[name] - shift
        assert at_ball == pytest.approx(one.result.figures[name], abs=1e-8)


def test_the_position_is_where_the_axis_crosses_zero_of_the_given_coordinates():
    raised = places("C", C_ERRORS, BALLS["C"], TURN) + np.array([0.0, 0.0, 1000.0])
    found = measure_rotary_axis("C", TURN, raised)
    assert found.errors["XOC"] == pytest.approx(13.0 + 60.0, abs=1e-2)
    assert found.errors["YOC"] == pytest.approx(-7.0 + 40.0, abs=1e-2)


def estimates(axis, errors, angles, rounds, sigma_um=1.0, **options):
    """Measure the same axis again and again with noise: values, covariances, noises."""
    rng = np.random.default_rng(20240222)
    clean = places(axis, errors, BALLS[axis], angles)
    found = [
        measure_rotary_axis(
            axis, angles, clean + rng.normal(scale=sigma_um / 1000.0, size=clean.shape), **options
        )
        for _ in range(rounds)
    ]
    values = np.array([list(one.errors.values()) for one in found])
    return values, np.array([one.covariance for one in found]), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "errors", "angles"),
    [
        ("C", C_ERRORS, [0, -90, -180]),
        ("A", A_ERRORS, [0, 40, 80, 120]),
        ("B", B_ERRORS, TURN),
    ],
)
def test_standard_errors_are_those_of_many_measurements(axis, errors, angles):
    """400 rounds know a standard deviation to 3.5 %; 14 % are four of those."""
    values, covariances, _ = estimates(axis, errors, angles, 400)
    truth = np.array(list(errors.values()))
    stated = covariances.mean(axis=0)
    np.testing.assert_allclose(values.std(axis=0), np.sqrt(np.diag(stated)), rtol=0.14)
    sizes = np.outer(*[np.sqrt(np.diag(stated))] * 2)
    np.testing.assert_allclose(np.corrcoef(values.T), stated / sizes, atol=0.2)
    off = (values.mean(axis=0) - truth) / np.sqrt(np.diag(stated) / len(values))
    assert np.abs(off).max() < 4.0


@pytest.mark.slow
def test_few_degrees_of_freedom_need_students_t_and_then_cover():
    values, covariances, found = estimates("C", C_ERRORS, [0, -90, -180], 500)
    assert found[0].degrees_of_freedom == 2
    ratio = (values - list(C_ERRORS.values())) / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert (np.abs(ratio) < stdtrit(2, 0.975)).mean(axis=0) == pytest.approx(0.95, abs=0.039)
    assert (np.abs(ratio) < 1.96).mean() < 0.87
    assert "rest on 2 degrees of freedom: 95 % of the cases are within 4.3" in " ".join(
        found[0].result.notes
    )


@pytest.mark.slow
def test_noise_is_estimated_without_bias():
    _, _, found = estimates("C", C_ERRORS, [0, 60, 120, 180, 240, 300], 250, sigma_um=0.7)
    variances = [one.noise_um**2 for one in found]
    assert np.mean(variances) == pytest.approx(0.49, rel=4.0 * np.sqrt(2.0 / 11.0 / 250))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angles", "freedom", "options"),
    [([0, -90], 0, {"repeatability_um": 1.0}), ([0, 0, 120, 120, 120], 9, {})],
)
def test_standard_errors_of_the_position_alone(angles, freedom, options):
    errors = {"XOC": 13.0, "YOC": -7.0}
    values, covariances, found = estimates("C", errors, angles, 400, **options)
    assert found[0].degrees_of_freedom == freedom
    stated = np.sqrt(np.diag(covariances.mean(axis=0)))
    np.testing.assert_allclose(values.std(axis=0), stated, rtol=0.1)
    np.testing.assert_allclose(values.mean(axis=0), [13.0, -7.0], atol=4 * stated.max() / 28)


@pytest.mark.slow
@pytest.mark.parametrize("angles", [[0, 0.2, 180], [0, 180, 180.2], [0, 0.2, 0.4, 180, 180.2]])
def test_angles_that_are_almost_two_give_the_position_alone(angles):
    """A tilt across the line of 0 and 180° shows over 0.4 mm: 1 µm of noise would be 4 mrad."""
    errors = {"XOC": 13.0, "YOC": -7.0}
    values, covariances, found = estimates("C", errors, angles, 150)
    assert list(found[0].errors) == ["XOC", "YOC"]
    stated = np.sqrt(np.diag(covariances.mean(axis=0)))
    np.testing.assert_allclose(values.std(axis=0), stated, rtol=0.15)
    assert stated.max() < 1.0
    (said,) = [note for note in found[0].result.notes if "do not determine" in note]
    assert re.match(r"The angles do not .* noise would tilt the axis by \d{4} µrad\)", said)
    assert "axial_range_um" in found[0].result.figures


def test_a_short_arc_shows_the_position_weakly_and_no_direction():
    """10° at a radius of 107 mm: 1 µm of noise would tilt the axis by 3 mrad."""
    found = measure_rotary_axis("C", [0, 5, 10], places("C", C_ERRORS, BALLS["C"], [0, 5, 10]))
    said = " ".join(found.result.notes)
    assert list(found.errors) == ["XOC", "YOC"]
    assert "would tilt the axis by 3012 µrad" in said
    assert "1 µm of noise moves it by 8.1 µm at the ball." in said


def test_a_tilt_that_two_angles_hide_does_not_pass_for_noise():
    angles = [0, 0, 180, 180]
    points = places("C", {"AOC": 500.0}, BALLS["C"], angles)
    found = measure_rotary_axis("C", angles, points)
    assert found.noise_um == pytest.approx(0.0, abs=1e-6)
    assert found.result.figures["axial_range_um"] > 10.0


def test_stated_repeatability_serves_only_without_redundancy():
    spread = np.random.default_rng(3).normal(scale=2e-3, size=(12, 3))
    points = places("C", C_ERRORS, BALLS["C"], TURN) + spread
    alone, beside = (
        measure_rotary_axis("C", TURN, points, repeatability_um=r) for r in (None, 0.5)
    )
    np.testing.assert_array_equal(alone.covariance, beside.covariance)
    assert "more than the stated repeatability of 0.5 µm explains" in " ".join(beside.result.notes)
    fair = measure_rotary_axis("C", TURN, points, repeatability_um=2.0)
    assert "more than the stated" not in " ".join(fair.result.notes)


def ways_at(axis, angles):
    """Unit vectors radial, tangential and axial for a ball on an ideal axis."""
    ball = places(axis, {}, BALLS[axis], angles)
    along = np.array({"C": [0.0, 0.0, 1.0], "A": [1.0, 0.0, 0.0]}[axis])
    arm = ball - np.outer(ball @ along, along)
    radial = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    return radial, np.cross(along, radial), np.tile(along, (len(ball), 1))


@pytest.mark.parametrize("axis", "CA")
def test_run_out_goes_where_it_belongs(axis):
    """Twice per turn is what no axis can take up: 3 µm radial, 2 µm axial, 1 µm tangential."""
    angles = np.arange(0.0, 360.0, 15.0)
    two = 2 * np.deg2rad(angles)
    waves = np.column_stack([3 * np.cos(two), np.sin(two), -2 * np.sin(two)])
    points = places(axis, {}, BALLS[axis], angles)
    for way, wave in zip(ways_at(axis, angles), waves.T, strict=True):
        points = points + way * wave[:, None] / 1000.0
    found = measure_rotary_axis(axis, angles, points)
    np.testing.assert_allclose(found.residuals_um, waves, atol=1e-3)
    assert list(found.errors.values()) == pytest.approx([0.0] * 4, abs=1e-3)
    figures = found.result.figures
    assert figures["radial_range_um"] == pytest.approx(6.0, abs=1e-3)
    assert figures["radial_rms_um"] == pytest.approx(3.0 / np.sqrt(2.0), abs=1e-3)
    assert figures["tangential_rms_um"] == pytest.approx(1.0 / np.sqrt(2.0), abs=1e-3)
    assert figures["axial_twice_per_turn_um"] == pytest.approx(2.0, abs=1e-3)
    assert figures["radial_twice_per_turn_um"] == pytest.approx(3.0, abs=1e-3)
    assert figures["radial_once_per_turn_um"] == pytest.approx(0.0, abs=1e-3)


def test_half_of_a_radial_once_per_turn_passes_for_an_eccentricity():
    """cos θ · (cos θ, sin θ) = ((1, 0) + (cos 2θ, sin 2θ))/2: the first half is a shift."""
    angles = np.arange(0.0, 360.0, 15.0)
    points = places("C", {}, [100.0, 0.0, 0.0], angles)
    turn = np.deg2rad(angles)
    points += 4e-3 * np.cos(turn)[:, None] * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    found = measure_rotary_axis("C", angles, points)
    assert found.errors["XOC"] == pytest.approx(2.0, abs=1e-3)
    assert found.result.figures["radial_once_per_turn_um"] == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize("angles", [np.arange(0, 360, 60.0), np.arange(0, 180, 10.0)])
def test_harmonics_are_not_told_from_few_angles_or_an_arc(angles):
    found = measure_rotary_axis("C", angles, places("C", C_ERRORS, BALLS["C"], angles))
    assert not [name for name in found.result.figures if "per_turn" in name]
    assert "radial_range_um" in found.result.figures


def test_the_balls_error_at_any_angle_is_the_geometrys():
    """[R] 9–13: measured at three angles, predicted at all."""
    three = [0, -90, -180]
    found = measure_rotary_axis("C", three, places("C", C_ERRORS, BALLS["C"], three))
    np.testing.assert_allclose(
        path_error(found.errors, found.start_mm, TURN, "C"),
        rotary_location_error(C_ERRORS, BALLS["C"], {"c": TURN}, "C"),
        atol=1e-5,
    )


def path_error(errors, ball_mm, angle_deg, axis, compensated=None):
    """How far a ball is beside the spindle that follows it: on BK2 with C, on BK1 with A [µm]."""
    turn = {axis.lower(): angle_deg}
    actual, followed = (
        rotary_location_error(known, ball_mm, turn, axis.lower())
        for known in (errors, compensated or {})
    )
    return actual - followed


BALL = np.array([0.0, 100.0, 200.0])
"""[R] section 3: at y = 100, z = −300 mm, 200 mm above the A axis at −500 mm."""

TILT = np.deg2rad(0.005) * 1e6


def test_the_simulated_bk2_path_has_the_sources_figures_once_the_axis_is_measured():
    """Section 3's ±18 µm in X, −35 µm in Y and −18 µm in Z for AOC; 35 and ±18 µm for BOC."""
    whole = np.linspace(0.0, 360.0, 361)
    extremes = {}
    for code in ("AOC", "BOC"):
        angles = [0, -90, -180]
        found = measure_rotary_axis("C", angles, places("C", {code: TILT}, BALL, angles))
        path = path_error(found.errors, BALL, whole, "C")
        extremes[code] = (path.min(axis=0), path.max(axis=0))
    np.testing.assert_allclose(extremes["AOC"], [[-18, -35, -18], [18, 0, 0]], atol=0.6)
    np.testing.assert_allclose(extremes["BOC"], [[0, -18, -8.7], [35, 18, 8.7]], atol=0.6)


@pytest.mark.parametrize("code", ["BOA", "COA"])
def test_the_simulated_bk1_path_has_the_sources_forty_micrometres(code):
    """ "around 40 µm": a full turn spans 2 · 87.3 µrad · √(100² + 200²) mm = 39.0 µm in X."""
    found = measure_rotary_axis("A", [0, 90, 180], places("A", {code: TILT}, BALL, [0, 90, 180]))
    path = path_error(found.errors, BALL, np.linspace(0.0, 360.0, 721), "A")
    np.testing.assert_allclose(np.ptp(path, axis=0), [39.0, 0.0, 0.0], atol=0.1)


def test_four_parameters_leave_the_tilts_and_eight_leave_nothing():
    """Section 4: compensating the position alone cannot change what the tilts do along the axis."""
    for axis, errors in (("C", C_ERRORS), ("A", A_ERRORS)):
        points = places(axis, errors, BALLS[axis], [0, 90, 180])
        found = measure_rotary_axis(axis, [0, 90, 180], points)
        position = dict(list(found.errors.items())[:2])
        before, half, after = (
            path_error(errors, BALLS[axis], TURN, axis, compensated=known)
            for known in (None, position, found.errors)
        )
        along = {"C": 2, "A": 0}[axis]
        np.testing.assert_allclose(half[:, along], before[:, along], atol=0.01)
        assert np.ptp(half[:, along]) > 10.0
        np.testing.assert_allclose(after, 0.0, atol=1e-4)


def test_a_weak_arc_is_said():
    found = measure_rotary_axis("C", [0, 15, 30], places("C", C_ERRORS, BALLS["C"], [0, 15, 30]))
    (said,) = [note for note in found.result.notes if "weakly" in note]
    assert "over 30° at a radius of 107 mm" in said
    wide = measure_rotary_axis("C", TURN, places("C", C_ERRORS, BALLS["C"], TURN))
    assert not [note for note in wide.result.notes if "weakly" in note]
    figure = "direction_urad_per_um_of_noise"
    assert found.result.figures[figure] > 50 * wide.result.figures[figure]


def test_a_place_far_away_is_said_to_be_no_error():
    points = places("A", A_ERRORS, BALLS["A"], TURN, [0, 0, -500])
    found = measure_rotary_axis("A", TURN, points)
    assert found.errors["ZOA"] == pytest.approx(-500_000 + 5.0, abs=1e-3)
    assert "ZOA beyond 10000 µm" in found.result.notes[-1]
    with pytest.raises(InvalidContent, match="pivot_mm: expected a point of the nominal axis"):
        measure_rotary_axis("A", TURN, points + np.array([0.0, 0.0, -1500.0]))


FAR, NEAR = [100.0, 0.0, 0.0], [0.7, 0.0, 0.0]
GOOD = places("C", C_ERRORS, BALLS["C"], [0, 90, 180])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "angles", "points", "message"),
    [
        ("D", [0, 90, 180], GOOD, r"axis: .* A, B or C, got 'D'"),
        (None, [0, 90, 180], GOOD, "got None"),
        ("C", [0, 90], GOOD, r"points: expected an angle .* shape \(2,\) and \(3, 3\)"),
        ("C", [], np.empty((0, 3)), "expected points at 2 angles or more, .* got 0 at 0"),
        ("C", [0], GOOD[:1], "got 1 at 1"),
        ("C", [0, 360, 720.01], GOOD, "got 3 at 1"),
        ("C", [0, 90, np.nan], GOOD, "points.angle_deg: expected finite numbers in °, got nan"),
        ("C", [0, 90, 180], GOOD * [1, 1, np.inf], r"points.position_mm: .*inf at index \[0, 2\]"),
        ("C", [0, 90, 180], [[0, 1], [0], [1, 2]], "points.position_mm: expected numbers in mm"),
        ("C", [0, 90, 180], GOOD * 1000, r"within ±100000 mm, got -180\d\d\d mm: perhaps in µm"),
        ("C", [0, 90, 180], GOOD / 1000, r"more than 1 mm apart, got 0\.\d+ mm: .* are in m"),
        ("C", [0, 90, 180], [[0, 0, 0]] * 3, "the ball stands on the axis"),
        ("C", [0, 90, 180], [[0, 0, 0], [50, 0, 0], [100, 0, 0]], "places on a straight line"),
        ("C", [0, -90, -180], GOOD, "perhaps the angles run the other way"),
        ("C", [0, np.pi / 2, np.pi], GOOD, "perhaps the angles are in rad"),
        ("A", [0, 90, 180], GOOD, "A axis turned .* perhaps it is the C axis"),
        ("C", [0, 90, 180], np.roll(GOOD, 1, axis=1), "perhaps it is the A axis"),
        ("C", [0, 90, 180], np.roll(GOOD, -1, axis=1), "perhaps it is the B axis"),
        ("A", [0, 90, 180], np.roll(GOOD, -1, axis=1), "perhaps it is the B axis"),
        ("C", [0, 90, 200], GOOD, r"got [\d.]+ mm \(rms\) beside such an arc and [\d.e-]+ rad$"),
        ("C", [0, 90], [[0, 0, 0], [0, 0, 50]], "got 0 mm .* and 1.57 rad"),
        ("C", [0, 1.5], places("C", {}, FAR, [0, 1.5]), "noise would move the axis by 54 µm"),
        ("C", [0, 1, 2], places("C", C_ERRORS, FAR, [0, 1, 2]),
         r"got points over 2° at a radius of 100 mm: 1 µm .* would move the axis by 41 µm"),
        ("C", [0, 90, 180], places("C", {}, NEAR, [0, 90, 180]), "at least 1 mm beside the axis"),
    ],
)  # fmt: skip
def test_what_is_no_turn_is_refused(axis, angles, points, message):
    with pytest.raises(InvalidContent, match=message):
        measure_rotary_axis(axis, angles, points)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"repeatability_um": -1.0}, "repeatability_um: .* from 0 to 10000 µm, got -1 µm"),
        ({"repeatability_um": np.nan}, "got nan"),
        ({"pivot_mm": [0.0, 1.0]}, "pivot_mm: expected x, y and z of a point in mm"),
        ({"pivot_mm": [0.0, 1.0, np.nan]}, "pivot_mm: expected finite numbers in mm, got nan"),
    ],
)
def test_what_is_no_statement_is_refused(options, message):
    with pytest.raises(InvalidContent, match=message):
        measure_rotary_axis("C", [0, 90, 180], GOOD, **options)


def test_a_dense_sweep_counts_as_many_angles():
    angles = np.arange(0.0, 360.0, 0.05)
    found = measure_rotary_axis("C", angles, places("C", C_ERRORS, BALLS["C"], angles))
    assert found.errors == pytest.approx(C_ERRORS, abs=1e-5)


def test_the_page_has_the_figures_of_table_2():
    found = measure_rotary_axis("C", [0.0, -90.0, -180.0], TABLE_2)
    rows = re.findall(r"\| ([A-Z]+) \| (−?[\d.]+) \| ([\d.]+) \|", PAGE.read_text(encoding="utf-8"))
    stated = {code: (float(v.replace("−", "-")), float(s)) for code, v, s in rows}
    expected = {
        table.component.code: (table.errors[0], table.standard_errors[0])
        for table in found.result.tables
    }
    assert stated.keys() == expected.keys()
    for code, pair in expected.items():
        assert stated[code] == pytest.approx(pair, abs=0.0501)


def test_g0_g3_and_g4_of_table_2_turn_about_a_b_axis():
    """Their y is 104.791 to 104.794 mm. Angles are not printed: those of their own circle.

    The circle in x and z has its centre at x = 2.1715, z = −290.3492 mm and a radius of
    106.472 mm; the axis is the normal of the plane through the three points.
    """
    points = np.array([
        [0.311, 104.794, -183.893], [-104.1525, 104.791, -284.729], [-71.3045, 104.791, -213.293],
    ])  # fmt: skip
    centre = circle_centre(points)
    np.testing.assert_allclose(centre[[0, 2]], [2.1715, -290.3492], atol=1e-4)
    arm = points - centre
    angles = np.rad2deg(np.arctan2(arm[:, 0], arm[:, 2]))
    angles -= angles[0]
    np.testing.assert_allclose(angles, [0.0, -85.973, -42.636], atol=1e-3)
    found = measure_rotary_axis("B", angles, points)
    figures = found.result.figures
    at_ball = [figures["axis_x_at_ball_mm"], figures["axis_z_at_ball_mm"]]
    np.testing.assert_allclose(at_ball, centre[[0, 2]], atol=2e-4)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal /= normal[1]
    tilts = [found.errors["AOB"], found.errors["COB"]]
    np.testing.assert_allclose(tilts, [normal[2] * 1e6, -normal[0] * 1e6], rtol=1e-3)
    at_0 = centre - centre[1] * normal
    position = [found.errors["XOB"], found.errors["ZOB"]]
    np.testing.assert_allclose(position, at_0[[0, 2]] * 1e3, atol=0.2)


@pytest.mark.parametrize("axis", ["A", "B", "C"])
def test_path_errors_before_and_after_compensation(axis):
    """Before: what the geometry says; with the position, what the tilts leave; then nothing."""
    errors = {"A": A_ERRORS, "B": B_ERRORS, "C": C_ERRORS}[axis]
    ball, pivot = np.array(BALLS[axis]), np.array([1.0, -2.0, 3.0])
    path = measure_rotary_axis(
        axis, TURN, places(axis, errors, ball, TURN, pivot), pivot_mm=pivot
    ).path
    pivots = {axis: pivot}
    before = rotary_location_error(errors, ball, {axis: TURN}, axis, pivots)
    np.testing.assert_allclose(path.before_um, before, atol=1e-6)
    along = "ABC".index(axis)
    first, second, tilt, other = errors.values()
    # Where the axis passes the ball's height: its tilts have carried it along.
    height = ball[along] / 1000.0
    known = dict(zip(errors, (first + height * other, second - height * tilt), strict=False))
    followed = rotary_location_error(known, ball, {axis: TURN}, axis, pivots)
    np.testing.assert_allclose(path.position_um, before - followed, atol=1e-3)
    # What is left of it is along the axis alone: a wobble of tilt times radius.
    across = np.delete(path.position_um, along, axis=1)
    assert np.abs(across).max() < 0.01
    np.testing.assert_allclose(path.all_um, 0.0, atol=1e-6)


def test_rms_and_largest_of_the_path_errors_are_figures():
    """A ball 100 mm off an axis that is 3 µm beside: 0 and 6 µm, of which nothing stays."""
    found = measure_rotary_axis("C", [0, 180], places("C", {"XOC": 3.0}, [100, 0, 0], [0, 180]))
    figures = found.result.figures
    assert figures["path_max_before_um"] == pytest.approx(6.0)
    assert figures["path_rms_before_um"] == pytest.approx(18.0**0.5)
    for stage in ("position", "all"):
        assert figures[f"path_max_after_{stage}_um"] == pytest.approx(0.0, abs=1e-6)
        assert figures[f"path_rms_after_{stage}_um"] == pytest.approx(0.0, abs=1e-6)
