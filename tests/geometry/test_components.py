"""The table of components against chapter 8 of C. Wang and the right-hand rule."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.errors import UnknownComponent
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, ORDER, Kind, parse_component, unsure_component
from app.geometry.volumetric_error import volumetric_error

# Section 8.1.1, in the order of the page: linear, vertical and horizontal straightness,
# roll, pitch, yaw, squareness. The codes are ISO 230-1's, written down by hand.
RIGID_BODY = {
    "D_x(x)": "EXX", "D_y(y)": "EYY", "D_z(z)": "EZZ",
    "D_y(x)": "EYX", "D_x(y)": "EXY", "D_x(z)": "EXZ",
    "D_z(x)": "EZX", "D_z(y)": "EZY", "D_y(z)": "EYZ",
    "A_x(x)": "EAX", "A_y(y)": "EBY", "A_z(z)": "ECZ",
    "A_y(x)": "EBX", "A_x(y)": "EAY", "A_x(z)": "EAZ",
    "A_z(x)": "ECX", "A_z(y)": "ECY", "A_y(z)": "EBZ",
    "S_xy": "SXY", "S_yz": "SYZ", "S_zx": "SZX",
}  # fmt: skip

# Equations 8.1-8.18, row by row: the two slopes that each adds.
SLOPES = {
    "D_x^y(x)": "EXX^y", "D_x^z(x)": "EXX^z", "D_y^y(x)": "EYX^y", "D_y^z(x)": "EYX^z",
    "D_z^y(x)": "EZX^y", "D_z^z(x)": "EZX^z", "D_x^x(y)": "EXY^x", "D_x^z(y)": "EXY^z",
    "D_y^x(y)": "EYY^x", "D_y^z(y)": "EYY^z", "D_z^x(y)": "EZY^x", "D_z^z(y)": "EZY^z",
    "D_x^x(z)": "EXZ^x", "D_x^y(z)": "EXZ^y", "D_y^x(z)": "EYZ^x", "D_y^y(z)": "EYZ^y",
    "D_z^x(z)": "EZZ^x", "D_z^y(z)": "EZZ^y",
    "A_x^y(x)": "EAX^y", "A_x^z(x)": "EAX^z", "A_y^y(x)": "EBX^y", "A_y^z(x)": "EBX^z",
    "A_z^y(x)": "ECX^y", "A_z^z(x)": "ECX^z", "A_x^x(y)": "EAY^x", "A_x^z(y)": "EAY^z",
    "A_y^x(y)": "EBY^x", "A_y^z(y)": "EBY^z", "A_z^x(y)": "ECY^x", "A_z^z(y)": "ECY^z",
    "A_x^x(z)": "EAZ^x", "A_x^y(z)": "EAZ^y", "A_y^x(z)": "EBZ^x", "A_y^y(z)": "EBZ^y",
    "A_z^x(z)": "ECZ^x", "A_z^y(z)": "ECZ^y",
}  # fmt: skip

# Hsieh 2024: the position-independent errors of a C axis and of an A axis; ISO 230-1: of a B axis.
ROTARY = [
    *("XOC", "YOC", "AOC", "BOC"), *("YOA", "ZOA", "BOA", "COA"), *("XOB", "ZOB", "AOB", "COB"),
]  # fmt: skip

# Section 8.2.9, sentence by sentence.
FOLLOWS_X_MIDDLE = ["EXX", "EYY", "SXY", "EYX", "EZX", "EXY", "EZY"]
FOLLOWS_Z_COLUMN = ["EZZ", "SYZ", "SZX", "EXZ", "EYZ"]


def test_the_table_is_the_chapters_and_hsiehs_components_and_no_others():
    expected = [*RIGID_BODY.values(), *SLOPES.values(), *ROTARY]
    assert len(expected) == 69
    assert sorted(COMPONENTS) == sorted(expected)


@pytest.mark.parametrize(
    ("kind", "count"),
    [
        (Kind.LINEAR, 3),
        (Kind.STRAIGHTNESS, 6),
        (Kind.ANGULAR, 9),
        (Kind.SQUARENESS, 3),
        (Kind.SLOPE, 36),
        (Kind.ROTARY_LOCATION, 12),
    ],
)
def test_each_group_has_as_many_as_the_chapter_counts(kind, count):
    assert sum(c.kind is kind for c in COMPONENTS.values()) == count


def test_codes_are_the_keys_and_the_order_is_the_tables():
    assert [c.code for c in COMPONENTS.values()] == list(COMPONENTS)
    assert sorted(COMPONENTS, key=ORDER.__getitem__) == list(COMPONENTS)


def test_the_chapters_name_and_the_iso_code_name_the_same():
    for chapter, code in [*RIGID_BODY.items(), *SLOPES.items()]:
        assert COMPONENTS[code].chapter == chapter
        for spelling in (chapter, chapter.replace("_", ""), chapter.upper(), f" {chapter} ", code):
            assert parse_component(spelling) == (COMPONENTS[code], 1)
        assert parse_component(code.lower()) == (COMPONENTS[code], 1)


def test_rotary_axis_locations_have_a_code_and_no_name_in_the_chapter():
    for code in ROTARY:
        assert parse_component(code) == (COMPONENTS[code], 1)
        assert COMPONENTS[code].chapter == ""
        assert COMPONENTS[code].unit == ("urad" if code[0] in "ABC" else "um")


def test_a_code_reads_direction_then_axis_of_motion():
    for code in [c for c in RIGID_BODY.values() if c[0] == "E"]:
        component = COMPONENTS[code]
        assert component.direction.upper() == code[1]
        assert component.axis is not None
        assert component.axis.upper() == code[2]
        assert component.unit == ("urad" if code[1] in "ABC" else "um")
        assert component.is_rotation is (code[1] in "ABC")


def test_a_slope_is_its_parent_per_metre_of_another_coordinate():
    for code in SLOPES.values():
        parent, slope = COMPONENTS[code.partition("^")[0]], COMPONENTS[code]
        assert (slope.axis, slope.direction) == (parent.axis, parent.direction)
        assert slope.times == code[-1]
        assert slope.times != slope.axis
        assert slope.unit == f"{parent.unit}_per_m"
        assert slope.default_sensor == parent.default_sensor


@pytest.mark.parametrize(
    ("name", "code", "axis", "about"),
    [("C0Y", "SXY", "y", "z"), ("A0Z", "SYZ", "z", "x"), ("B0Z", "SZX", "z", "y")],
)
def test_iso_squareness_turns_the_axis_by_the_right_hand_rule(name, code, axis, about):
    """The displacement of an axis that is turned by +1 mrad about X, Y or Z.

    ISO 230-1's C0Y is the orientation error of Y about Z, positive by the right-hand
    rule; ours is the factor of 8.58-8.60. Both must move a point at 1 m alike.
    """
    angle_urad = 1000.0
    unit = dict(zip("xyz", np.eye(3), strict=True))
    turned = Rotation.from_rotvec(unit[about] * angle_urad * 1e-6).apply(unit[axis])
    component, sign = parse_component(name)
    assert component.code == code
    ours = {code: np.array([sign * angle_urad])}
    error_um, _ = volumetric_error(Chain.parse("FXYZ"), ours, unit[axis] * 1000.0)
    # 1 m in µm; the turned axis also shortens by 0.5 µm, which is of second order.
    np.testing.assert_allclose(error_um[0], (turned - unit[axis]) * 1e6, atol=0.51)


def test_iso_names_of_squareness_are_read_with_and_without_e_and_with_their_sign():
    assert parse_component("EC0Y") == (COMPONENTS["SXY"], -1)
    assert parse_component("a0z") == (COMPONENTS["SYZ"], -1)
    assert parse_component("EB0Z") == (COMPONENTS["SZX"], 1)


def test_the_chapter_lets_them_follow_x_middle():
    for code in FOLLOWS_X_MIDDLE:
        assert COMPONENTS[code].default_sensor == "x-middle"


def test_the_chapter_lets_them_follow_z_column():
    for code in FOLLOWS_Z_COLUMN:
        assert COMPONENTS[code].default_sensor == "z-column"


@pytest.mark.parametrize("axis", "XYZ")
def test_angular_errors_follow_the_sensor_of_the_same_axis_straightness(axis):
    straightness = next(
        c for c in COMPONENTS.values() if c.kind is Kind.STRAIGHTNESS and c.code[2] == axis
    )
    for about in "ABC":
        assert COMPONENTS[f"E{about}{axis}"].default_sensor == straightness.default_sensor


@pytest.mark.parametrize(
    ("code", "given", "answered", "compensation"),
    [
        ("EXX", "errors_um", "errors_um", "compensation_um"),
        ("ECZ", "errors_urad", "errors_urad", "compensation_urad"),
        ("EYY^x", "slopes_um_per_m", "slopes_um_per_m", "compensation_um_per_m"),
        ("EAY^x", "slopes_urad_per_m", "slopes_urad_per_m", "compensation_urad_per_m"),
        ("SXY", "value_um_per_m", "error_um_per_m", "compensation_um_per_m"),
        ("AOC", "value_urad", "error_urad", "compensation_urad"),
        ("XOC", "value_um", "error_um", "compensation_um"),
    ],
)
def test_fields_end_in_the_unit_as_the_http_contract_has_them(code, given, answered, compensation):
    component = COMPONENTS[code]
    assert component.input_field == given
    assert component.error_field == answered
    assert component.compensation_field == compensation


def test_rotary_axis_locations_are_read_with_isos_zero_too():
    for code in ROTARY:
        assert parse_component(code.replace("O", "0")) == (COMPONENTS[code], 1)


@pytest.mark.parametrize(
    "name", ["", "E", "EXQ", "EXX^x", "EXX^", "EXX^yy", "D_x()", "S_yx", "C0Z", "X0Y", "EXXX", "^x"]
)
def test_what_nobody_calls_a_component_is_refused(name):
    with pytest.raises(UnknownComponent, match="expected an error component") as refusal:
        parse_component(name)
    assert f"got {name!r}" in refusal.value.detail


def test_a_slip_of_the_pen_is_told_what_is_near():
    with pytest.raises(UnknownComponent, match=r"near it: .*EXX"):
        parse_component("EXXX")


@pytest.mark.parametrize(
    ("name", "code"),
    [
        *((f"E_{letter}{axis}", f"E{letter}{axis}") for letter in "XYZABC" for axis in "XYZ"),
        *(("E_Y(X)", "EYX"), ("EC(z)", "ECZ"), ("E_XX", "EXX")),
        *(("xTx", "EXX"), ("xTy", "EYX"), ("zTx", "EXZ"), ("XRY", "EBX"), ("yRz", "ECY")),
        *(("δ_y(x)", "EYX"), ("δx(x)", "EXX"), ("ε_z(x)", "ECX"), ("εx(y)", "EAY")),
    ],
)
def test_names_of_other_instruments_are_read_where_they_are_sure(name, code):
    assert parse_component(name) == (COMPONENTS[code], 1)


@pytest.mark.parametrize("name", ["yaw", "Pitch X", "X roll", "ROLL_Z", "xWy"])
def test_names_that_are_not_sure_are_refused_with_what_is_read(name):
    with pytest.raises(UnknownComponent, match=r"expected a (rotation|squareness)") as refusal:
        parse_component(name)
    assert f"got {name!r}" in refusal.value.detail


@pytest.mark.parametrize("name", ["controller", "rolling", "xwyz"])
def test_other_words_are_not_taken_for_them(name):
    assert unsure_component(name) == ""
