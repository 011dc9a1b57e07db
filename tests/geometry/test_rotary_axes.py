"""Location errors of rotary axes against Hsieh 2024 as printed, scipy's rotations, and by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.errors import InvalidContent
from app.geometry.components import COMPONENTS, Kind
from app.geometry.rotary_axes import actual_axis, rotary_location_error

LOCATIONS = [code for code, c in COMPONENTS.items() if c.kind is Kind.ROTARY_LOCATION]
ERRORS = {"XOC": 13.0, "YOC": -7.0, "AOC": 40.0, "BOC": -60.0,
          "YOA": 11.0, "ZOA": 5.0, "BOA": 70.0, "COA": -30.0}  # fmt: skip
PIVOTS = {"a": [0.0, 40.0, -500.0], "c": [20.0, -30.0, 0.0]}
POINT = [31.0, -70.0, 211.0]


def matrix(k, angle):
    """(9), with k of any origin; the same as (22)."""
    (x, y, z), s, c = k, np.sin(angle), np.cos(angle)
    v = 1 - c
    return np.array([
        [x * x * v + c, x * y * v - z * s, x * z * v + y * s],
        [x * y * v + z * s, y * y * v + c, y * z * v - x * s],
        [x * z * v - y * s, y * z * v + x * s, z * z * v + c],
    ])  # fmt: skip


def direction_c(a, b):
    """(8)."""
    return np.array([np.cos(a) * np.sin(b), -np.sin(a), np.cos(a) * np.cos(b)])


def direction_a(b, c):
    """(21)."""
    return np.array([np.cos(b) * np.cos(c), np.cos(b) * np.sin(c), -np.sin(b)])


@pytest.mark.parametrize("degrees", [-170.0, -33.0, 0.0, 5.0, 90.0, 200.0])
def test_a_tilted_c_axis_is_equations_8_to_13(degrees):
    a, b, angle = 4e-3, -7e-3, np.deg2rad(degrees)
    turned = matrix(direction_c(a, b), angle) - matrix([0.0, 0.0, 1.0], angle)
    found = rotary_location_error({"AOC": a * 1e6, "BOC": b * 1e6}, POINT, {"c": degrees}, "C")
    np.testing.assert_allclose(found[0], turned @ POINT * 1000.0, atol=1e-9)


@pytest.mark.parametrize("degrees", [-170.0, -33.0, 0.0, 5.0, 90.0, 200.0])
def test_a_tilted_a_axis_is_equations_21_to_25(degrees):
    b, c, angle = 4e-3, -7e-3, np.deg2rad(degrees)
    turned = matrix(direction_a(b, c), angle) - matrix([1.0, 0.0, 0.0], angle)
    found = rotary_location_error({"BOA": b * 1e6, "COA": c * 1e6}, POINT, {"a": degrees}, "A")
    np.testing.assert_allclose(found[0], turned @ POINT * 1000.0, atol=1e-9)


def printed_14_to_16(a, b, angle, p):
    c, s, ca, sa, cb, sb = (f(t) for t in (angle, a, b) for f in (np.cos, np.sin))
    x, y, z = p
    v = 1 - c
    return [
        -c * x + (c + ca**2 * v * sb**2) * x - s * y + (-ca * v * sa * sb + ca * cb * s) * y
        + (ca**2 * cb * v * sb + sa * s) * z,
        s * x + (-ca * v * sa * sb - ca * cb * s) * x - c * y + (c + v * sa**2) * y
        + (-ca * cb * v * sa + ca * sb * s) * z,
        (ca**2 * cb * v * sb - sa * s) * x + (-ca * cb * v * sa - ca * sb * s) * y - z
        + (ca**2 * cb**2 * v + c) * z,
    ]  # fmt: skip


def printed_26_to_28(b, g, angle, p):
    c, s, cb, sb, cg, sg = (f(t) for t in (angle, b, g) for f in (np.cos, np.sin))
    x, y, z = p
    v = 1 - c
    return [
        -x + (cb**2 * cg**2 * v + c) * x + (cb**2 * cg * v * sg - sb * s) * y
        + (-cb * cg * v * sb - cb * sg * s) * z,
        (cb**2 * cg * v * sg + sb * s) * x - c * y + (c + cb**2 * v * sg**2) * y - s * z
        + (-cb * v * sb * sg + cb * cg * s) * z,
        (-cb * cg * v * sb + cb * sg * s) * x + s * y + (-cb * v * sb * sg - cb * cg * s) * y
        - c * z + (c + v * sb**2) * z,
    ]  # fmt: skip


def test_the_expanded_equations_are_printed_for_the_opposite_angle():
    """14-16 and 26-28 are ours at −θ and not at +θ."""
    angle, tilts = np.deg2rad(37.0), (5e-3, -3e-3)
    for printed, order, codes in (
        (printed_14_to_16, "C", ("AOC", "BOC")),
        (printed_26_to_28, "A", ("BOA", "COA")),
    ):
        expected = np.array(printed(*tilts, angle, POINT)) * 1000.0
        errors = {code: tilt * 1e6 for code, tilt in zip(codes, tilts, strict=True)}
        at = {way: rotary_location_error(errors, POINT, {order: way * 37.0}, order)[0]
              for way in (1, -1)}  # fmt: skip
        np.testing.assert_allclose(at[-1], expected, atol=1e-9)
        assert np.abs(at[1] - expected).max() > 10.0


def test_element_3_2_of_equation_11_has_the_sign_of_equation_9():
    """Printed k_y k_z v − k_x s and, at the end, k_z k_z v − c: no rotation at all."""
    right = matrix(direction_c(4e-3, -7e-3), 0.6)
    np.testing.assert_allclose(right @ right.T, np.eye(3), atol=1e-15)
    for row, column, wrong in ((2, 1, -2 * direction_c(4e-3, -7e-3)[0] * np.sin(0.6)),
                               (2, 2, -2 * np.cos(0.6))):  # fmt: skip
        printed = right.copy()
        printed[row, column] += wrong
        assert np.abs(printed @ printed.T - np.eye(3)).max() > 1e-3


def test_the_simulated_bk2_path_has_the_figures_of_the_text():
    """Section 3: ball at y = 100 mm, z = −300 mm, A axis at ZOA = −500 mm, so 200 mm above it.

    "±18 µm error in X, −35 µm in Y and −18 µm in Z" for AOC, "35 µm in X, ±18 µm in Y"
    for BOC: the values of 0.005°, the end of the simulated range, where the text says
    0.001°. (Its ±18 µm in Z for BOC is the span of our ±8.7.)
    """
    turn = {"c": np.linspace(0.0, 360.0, 721)}
    tilt = np.deg2rad(0.005) * 1e6
    ball = [0.0, 100.0, -300.0 - -500.0]
    by_a = rotary_location_error({"AOC": tilt}, ball, turn, "C")
    np.testing.assert_allclose(by_a.min(axis=0), [-18.0, -35.0, -18.0], atol=0.6)
    np.testing.assert_allclose(by_a.max(axis=0), [18.0, 0.0, 0.0], atol=0.6)
    by_b = rotary_location_error({"BOC": tilt}, ball, turn, "C")
    np.testing.assert_allclose(by_b.min(axis=0)[:2], [0.0, -18.0], atol=0.6)
    np.testing.assert_allclose(by_b.max(axis=0)[:2], [35.0, 18.0], atol=0.6)
    assert np.ptp(by_b[:, 2]) == pytest.approx(18.0, abs=0.6)


def test_half_a_turn_about_an_axis_that_is_beside_throws_a_point_twice_as_far():
    for code, order, expected in (
        ("XOC", "C", [2.0, 0.0, 0.0]),
        ("YOC", "C", [0.0, 2.0, 0.0]),
        ("YOA", "A", [0.0, 2.0, 0.0]),
        ("ZOA", "A", [0.0, 0.0, 2.0]),
    ):
        found = rotary_location_error({code: 1.0}, POINT, {order: 180.0}, order, PIVOTS)
        np.testing.assert_allclose(found[0], expected, atol=1e-9)


def test_a_quarter_turn_by_hand():
    """(1 − R) of a shift in x at C = 90°: (1, −1)."""
    found = rotary_location_error({"XOC": 1.0}, POINT, {"c": 90.0}, "C", PIVOTS)
    np.testing.assert_allclose(found[0], [1.0, -1.0, 0.0], atol=1e-9)


def test_half_a_turn_takes_g0_of_table_2_to_g2():
    """About the C axis of G0 to G2, at x = −0.0005 mm and y = 0.0215 mm, to 1 µm."""
    g0, g2 = [0.311, 104.794, -183.893], [-0.311, -104.751, -183.8895]
    axis = actual_axis("c", {"XOC": -0.5, "YOC": 21.5})
    turned = axis.turn(np.array([g0]), np.deg2rad([180.0]))
    np.testing.assert_allclose(turned[0, :2], g2[:2], atol=1.01e-3)


angles = st.floats(-720.0, 720.0)
sizes = st.floats(-500.0, 500.0)


@given(angles, angles, st.fixed_dictionaries(dict.fromkeys(LOCATIONS, sizes)))
def test_the_actual_motion_is_scipys_rotation_about_the_actual_axes(a, c, errors):
    """C turns first about its own line; A then carries all of it about its own."""

    def moved(errors):
        point = np.array(POINT)
        for letter, degrees in (("c", c), ("a", a)):
            axis = actual_axis(letter, errors, PIVOTS[letter])
            turn = Rotation.from_rotvec(np.deg2rad(degrees) * axis.direction)
            point = axis.point_mm + turn.apply(point - axis.point_mm)
        return point

    found = rotary_location_error(errors, POINT, {"a": a, "c": c}, "AC", PIVOTS)
    np.testing.assert_allclose(found[0], (moved(errors) - moved({})) * 1000.0, atol=1e-7)


@given(angles, angles)
def test_without_errors_or_without_turning_nothing_is_wrong(a, c):
    turned = rotary_location_error({}, POINT, {"a": a, "c": c}, "AC", PIVOTS)
    np.testing.assert_allclose(turned, 0.0, atol=1e-9)
    still = rotary_location_error(ERRORS, POINT, {}, "AC", PIVOTS)
    np.testing.assert_allclose(still, 0.0, atol=1e-9)


@given(angles)
def test_a_full_turn_more_changes_nothing(c):
    once, again = (
        rotary_location_error(ERRORS, POINT, {"a": 20.0, "c": x}, "AC", PIVOTS)
        for x in (c, c + 360)
    )
    np.testing.assert_allclose(once, again, atol=1e-7)


@given(angles)
def test_points_on_the_nominal_axis_see_how_far_it_is_from_the_actual_one(c):
    """First order: (1 − R) of the shift and of the tilt's offset at that height."""
    height = 300.0
    errors = {"XOC": 10.0, "YOC": -4.0, "AOC": 20.0, "BOC": 30.0}
    point = [PIVOTS["c"][0], PIVOTS["c"][1], height]
    found = rotary_location_error(errors, point, {"c": c}, "C", PIVOTS)[0]
    offset = np.array([10.0 + 0.3 * 30.0, -4.0 - 0.3 * 20.0, 0.0])
    expected = offset - matrix([0.0, 0.0, 1.0], np.deg2rad(c)) @ offset
    np.testing.assert_allclose(found, expected, atol=2e-3)


@pytest.mark.parametrize("code", LOCATIONS)
def test_small_errors_act_in_proportion(code):
    """The exact motion's part of second order: ten times the error, ten times the effect."""
    ask = {"a": 33.0, "b": 50.0, "c": -71.0}
    small = rotary_location_error({code: 1.0}, POINT, ask, "ABC", PIVOTS)
    large = rotary_location_error({code: 10.0}, POINT, ask, "ABC", PIVOTS)
    np.testing.assert_allclose(large, 10.0 * small, atol=1e-4)
    assert np.abs(small).max() > 0.05
    huge = [rotary_location_error({code: x}, POINT, ask, "ABC", PIVOTS) for x in (1e4, 2e4)]
    left = [np.abs(h - x * small).max() for h, x in zip(huge, (1e4, 2e4), strict=True)]
    if COMPONENTS[code].is_rotation:
        assert left[1] / left[0] == pytest.approx(4.0, rel=0.1)
    else:
        np.testing.assert_allclose(left, 0.0, atol=1e-5)


def test_many_angles_points_and_errors_are_as_each_alone():
    rng = np.random.default_rng(8)
    a, c = rng.uniform(-180, 180, (2, 15))
    points = rng.uniform(-300, 300, (15, 3))
    errors = {code: rng.normal(scale=50, size=15) for code in LOCATIONS}
    together = rotary_location_error(errors, points, {"a": a, "c": c}, "AC", PIVOTS)
    assert together.shape == (15, 3)
    for i in range(15):
        one = {code: values[i] for code, values in errors.items()}
        alone = rotary_location_error(one, points[i], {"a": a[i], "c": c[i]}, "AC", PIVOTS)
        np.testing.assert_allclose(together[i], alone[0], rtol=1e-12, atol=1e-10)
    one_point = rotary_location_error(ERRORS, POINT, {"C": c}, "AC", PIVOTS)
    assert one_point.shape == (15, 3)


def test_the_order_of_the_axes_matters_and_one_that_stands_still_does_not():
    ask = {"a": 40.0, "c": 60.0}
    ac, ca = (rotary_location_error(ERRORS, POINT, ask, o, PIVOTS) for o in ("AC", "CA"))
    assert np.abs(ac - ca).max() > 1.0
    alone = rotary_location_error(ERRORS, POINT, {"c": 60.0}, "C", PIVOTS)
    both = rotary_location_error(ERRORS, POINT, {"c": 60.0, "a": 0.0}, "AC", PIVOTS)
    np.testing.assert_allclose(both, alone, atol=1e-9)


@pytest.mark.parametrize(
    ("errors", "asked", "order", "message"),
    [
        (
            {},
            {"b": 1.0},
            "BX",
            r"order: expected the rotary axes A, B, C .* got 'BX'",
        ),
        ({}, {}, "", "got ''"),
        ({}, {}, "CC", "got 'CC'"),
        ({}, {"a": 1.0}, "C", "angles_deg: expected angles in ° of C, got a"),
        ({"EXX": 1.0}, {}, "C", r"expected location errors \(XOC, YOC, .*COB\), got 'EXX'"),
    ],
)
def test_what_is_no_rotary_axis_is_refused(errors, asked, order, message):
    with pytest.raises(InvalidContent, match=message):
        rotary_location_error(errors, POINT, asked, order)


@pytest.mark.parametrize("point", [[1.0, 2.0], [np.nan, 0.0, 0.0]])
def test_what_is_no_point_is_refused(point):
    with pytest.raises(InvalidContent, match="points_mm"):
        rotary_location_error(ERRORS, point, {"c": 1.0}, "C")
    with pytest.raises(InvalidContent, match="expected rotary axes among A, B and C"):
        actual_axis("d", {})


def test_a_b_axis_is_the_c_axis_with_the_coordinates_moved_on_in_a_circle():
    """z → x → y: [R] 8 to 13 of the same numbers, in other letters."""
    along_c = {"XOC": 13.0, "YOC": -7.0, "AOC": 4000.0, "BOC": -6000.0}
    along_b = {"ZOB": 13.0, "XOB": -7.0, "COB": 4000.0, "AOB": -6000.0}
    point_zxy, pivot_zxy = np.array([105.0, 20.0, -180.0]), np.array([3.0, -4.0, 0.0])
    angles = np.arange(0.0, 360.0, 37.0)
    c = rotary_location_error(along_c, point_zxy, {"c": angles}, "C", {"C": pivot_zxy})
    b = rotary_location_error(
        along_b, np.roll(point_zxy, -1), {"b": angles}, "B", {"B": np.roll(pivot_zxy, -1)}
    )
    np.testing.assert_allclose(b, np.roll(c, -1, axis=1), rtol=1e-12)


def test_each_tilt_of_a_b_axis_is_a_turn_about_its_letter_and_its_place_that_coordinate():
    """COB turns y towards −x, AOB y towards z; exact product E_A E_C as [R] 7 has E_B E_A."""
    a, c = 0.02, -0.03
    axis = actual_axis("b", {"AOB": a * 1e6, "COB": c * 1e6, "XOB": 5.0, "ZOB": -6.0}, (1.0, 2, 3))
    expected = Rotation.from_euler("x", a) * Rotation.from_euler("z", c)
    np.testing.assert_allclose(axis.direction, expected.apply([0.0, 1.0, 0.0]), atol=1e-15)
    np.testing.assert_allclose(axis.point_mm, [1.005, 0.0, 2.994])


@pytest.mark.parametrize("order", ["B", "BC", "CB", "AB", "BA"])
def test_a_b_axis_stands_in_any_order(order):
    """Half a turn about a B axis that is 3 µm too far in z throws a point by 6 µm in z."""
    found = rotary_location_error({"ZOB": 3.0}, POINT, {"b": 180.0}, order)
    np.testing.assert_allclose(found, [[0.0, 0.0, 6.0]], atol=1e-12)
