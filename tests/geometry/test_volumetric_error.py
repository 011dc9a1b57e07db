"""The volumetric error against the chapter's printed equations, exact rotations and Hsu."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLine
from app.geometry.volumetric_error import volumetric_error
from tests.geometry.example_fields import LINES

MM = 1000.0  # µm in a mm; µrad times mm is a thousandth of a µm
RIGID = [c for c in COMPONENTS.values() if c.axis and c.times is None]
SLOPES = [c for c in COMPONENTS.values() if c.axis and c.times]
CHAINS = ["".join(p) for p in permutations("XYZF")]

# Prime numbers, so that no two lever arms are alike [mm].
POINT = (307.0, -211.0, 503.0)
TOOL = (17.0, -29.0, 163.0)


def chapter_errors(rng, size=1.0):
    """All 18 motion errors [µm, µrad] under the chapter's names: D[0, 'y'] is D_x(y)."""
    d = {(i, u): float(rng.normal(scale=10 * size)) for i in range(3) for u in "xyz"}
    a = {(i, u): float(rng.normal(scale=40 * size)) for i in range(3) for u in "xyz"}
    return d, a


def as_components(d, a):
    named = {f"E{'XYZ'[i]}{u.upper()}": v for (i, u), v in d.items()}
    return named | {f"E{'ABC'[i]}{u.upper()}": v for (i, u), v in a.items()}


def error_at(chain, errors, point, tool=(0.0, 0.0, 0.0), lines=None):
    values = {code: np.array([value]) for code, value in errors.items()}
    found, turned = volumetric_error(Chain.parse(chain), values, [point], tool, lines)
    return found[0], turned[0]


# The equations as they are printed, lever arms in m so that µrad times m is µm.
def printed_fxyz(d, a, x, y, z):
    """8.68-8.70."""
    return [
        (d[0, "x"] - y * a[2, "x"] + z * a[1, "x"]) + (d[0, "y"] + z * a[1, "y"]) + d[0, "z"],
        (d[1, "x"] - z * a[0, "x"]) + (d[1, "y"] - z * a[0, "y"]) + d[1, "z"],
        (d[2, "x"] + y * a[0, "x"]) + d[2, "y"] + d[2, "z"],
    ]


def printed_xfyz(d, a, x, y, z):
    """8.74-8.76."""
    return [
        (d[0, "x"] - y * a[2, "x"] + z * a[1, "x"]) + (d[0, "y"] + z * a[1, "y"]) + d[0, "z"],
        (d[1, "x"] + x * a[2, "x"] - z * a[0, "x"]) + (d[1, "y"] - z * a[0, "y"]) + d[1, "z"],
        (d[2, "x"] - x * a[1, "x"] + y * a[0, "x"]) + d[2, "y"] + d[2, "z"],
    ]


def printed_xyfz(d, a, x, y, z):
    """8.77-8.79."""
    return [
        (d[0, "x"] + z * a[1, "x"]) + (d[0, "y"] - y * a[2, "y"] + z * a[1, "y"]) + d[0, "z"],
        (d[1, "x"] + x * a[2, "x"] - z * a[0, "x"])
        + (d[1, "y"] + x * a[2, "y"] - z * a[0, "y"])
        + d[1, "z"],
        (d[2, "x"] - x * a[1, "x"]) + (d[2, "y"] - x * a[1, "y"] + y * a[0, "y"]) + d[2, "z"],
    ]


def printed_xyzf(d, a, x, y, z):
    """8.80-8.82."""
    return [
        d[0, "x"] + (d[0, "y"] - y * a[2, "y"]) + (d[0, "z"] - y * a[2, "z"] + z * a[1, "z"]),
        (d[1, "x"] + x * a[2, "x"])
        + (d[1, "y"] + x * a[2, "y"])
        + (d[1, "z"] + x * a[2, "z"] - z * a[0, "z"]),
        (d[2, "x"] - x * a[1, "x"])
        + (d[2, "y"] - x * a[1, "y"] + y * a[0, "y"])
        + (d[2, "z"] - x * a[1, "z"] + y * a[0, "z"]),
    ]


def printed_tool_offset(a, xt, yt, zt):
    """8.71-8.73 without the nominal X_t, Y_t, Z_t that they begin with."""
    return [
        sum(-yt * a[2, u] + zt * a[1, u] for u in "xyz"),
        sum(xt * a[2, u] - zt * a[0, u] for u in "xyz"),
        sum(-xt * a[1, u] + yt * a[0, u] for u in "xyz"),
    ]


def hsu_fyxz(d, a, x, y, z):
    """Hsu's Table II with all measuring lines through home (X_s = Z_s = 0)."""
    return [
        sum(d[0, u] for u in "xyz") + z * a[1, "x"] + z * a[1, "y"],
        sum(d[1, u] for u in "xyz") - z * a[0, "x"] - z * a[0, "y"] + x * a[2, "y"],
        sum(d[2, u] for u in "xyz") - x * a[1, "y"],
    ]


PRINTED = {
    "FXYZ": printed_fxyz,
    "XFYZ": printed_xfyz,
    "XYFZ": printed_xyfz,
    "XYZF": printed_xyzf,
    "FYXZ": hsu_fyxz,
}


@pytest.mark.parametrize("chain", PRINTED)
def test_each_term_is_the_printed_one(chain):
    """One component at a time, so that no term can make up for another."""
    for component in RIGID:
        d, a = chapter_errors(np.random.default_rng(0), size=0.0)
        into, u = (a if component.is_rotation else d), component.axis
        into["xyzabc".index(component.direction) % 3, u] = 12.0
        expected = PRINTED[chain](d, a, *np.array(POINT) / MM)
        without, _ = error_at(chain, {component.code: 12.0}, POINT)
        code = component.code
        np.testing.assert_allclose(without, expected, rtol=1e-14, atol=1e-14, err_msg=code)
        with_tool, _ = error_at(chain, {component.code: 12.0}, POINT, TOOL)
        of_tool = printed_tool_offset(a, *np.array(TOOL) / MM)
        np.testing.assert_allclose(
            with_tool - without, of_tool, rtol=1e-12, atol=1e-13, err_msg=code
        )


@pytest.mark.parametrize("chain", PRINTED)
def test_all_terms_together_are_the_printed_sum(chain):
    rng = np.random.default_rng(868)
    for _ in range(20):
        d, a = chapter_errors(rng)
        point, tool = rng.uniform(-800, 800, 3), rng.uniform(-200, 200, 3)
        expected = np.array(PRINTED[chain](d, a, *point / MM)) + printed_tool_offset(a, *tool / MM)
        found, _ = error_at(chain, as_components(d, a), point, tool)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-11)


def exact_position(chain, d, a, point, tool):
    """The product of exact motions from the tool to the workpiece [mm].

    A workpiece-side axis carries X in RI(x)X (8.64): it shifts first and turns what it
    has shifted; a tool-side axis turns what it carries and shifts it then.
    """
    before, _, after = chain.lower().partition("f")
    position = np.array(tool)
    for u in reversed(after):
        position = turn(a, u).apply(position) + stage(d, point, u)
    for u in before:
        position = turn(a, u).apply(position + stage(d, point, u))
    return position


def turn(a, u):
    """RI(u), the active rotation, without the approximation of 8.62."""
    return Rotation.from_rotvec([a[i, u] * 1e-6 for i in range(3)])


def stage(d, point, u):
    """8.55-8.57."""
    nominal = point["xyz".index(u)] * np.eye(3)["xyz".index(u)]
    return nominal + np.array([d[i, u] for i in range(3)]) / MM


def chapter_product(chain, d, a, point, tool):
    """8.63-8.66 as printed, with exact rotations."""
    r = {u: turn(a, u).as_matrix() for u in "xyz"}
    x, y, z = (stage(d, point, u) for u in "xyz")
    t = r["x"] @ r["y"] @ r["z"] @ np.array(tool)
    return {
        "FXYZ": lambda: x + r["x"] @ y + r["x"] @ r["y"] @ z + t,
        "XFYZ": lambda: r["x"] @ x + r["x"] @ y + r["x"] @ r["y"] @ z + t,
        "XYFZ": lambda: r["y"] @ r["x"] @ x + r["y"] @ y + r["y"] @ r["x"] @ z + t,
        "XYZF": lambda: r["z"] @ r["y"] @ r["x"] @ x + r["z"] @ r["y"] @ y + r["z"] @ z + t,
    }[chain]()


def second_order_left(product, chain, size, seed=863):
    """How far the first order is from an exact product [µm], for errors of this size."""
    d, a = chapter_errors(np.random.default_rng(seed), size)
    exact_um = (product(chain, d, a, POINT, TOOL) - np.array(POINT) - np.array(TOOL)) * MM
    found, _ = error_at(chain, as_components(d, a), POINT, TOOL)
    return np.linalg.norm(found - exact_um), np.linalg.norm(found)


@pytest.mark.parametrize(
    ("product", "chain"),
    [*((chapter_product, c) for c in list(PRINTED)[:4]), *((exact_position, c) for c in CHAINS)],
)
def test_it_is_the_first_order_of_the_exact_product_of_motions(product, chain):
    """Errors k times larger leave k² times more, and at real sizes next to nothing.

    40 µrad squared over 1 m is 1.6e-3 µm: the bound at size 1. A wrong term of first
    order would leave tens of µm.
    """
    left, _ = second_order_left(product, chain, 1.0)
    assert left < 0.05
    small, error = second_order_left(product, chain, 100.0)
    large, _ = second_order_left(product, chain, 200.0)
    assert small < 0.02 * error
    assert large / small == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("chain", CHAINS)
def test_the_tools_direction_turns_as_the_exact_rotations_turn_it(chain):
    d, a = chapter_errors(np.random.default_rng(15))
    _, turned = error_at(chain, as_components(d, a), POINT, TOOL)
    k = exact_position(chain, d, a, POINT, (0.0, 0.0, 1.0))
    k = k - exact_position(chain, d, a, POINT, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(turned, (k - [0.0, 0.0, 1.0]) * 1e6, atol=0.02)
    # Hsu, Table I, columns I, J, K: +EB, -EA, 0.
    assert turned[0] == pytest.approx(sum(a[1, u] for u in "xyz"))
    assert turned[1] == pytest.approx(-sum(a[0, u] for u in "xyz"))
    assert turned[2] == 0.0


def test_squareness_adds_as_8_58_to_8_60_do_in_every_chain():
    _, y, z = POINT
    for chain in CHAINS:
        found, turned = error_at(chain, {"SXY": 12.0, "SYZ": -5.0, "SZX": 7.0}, POINT, TOOL)
        expected = [12.0 * y / MM + 7.0 * z / MM, -5.0 * z / MM, 0.0]
        np.testing.assert_allclose(found, expected, rtol=1e-14)
        assert not turned.any()


@pytest.mark.parametrize("chain", PRINTED)
def test_a_slope_is_the_parent_grown_with_the_other_coordinate(chain):
    """8.1-8.18: D_x^y(x) y takes the place of D_x(x), and for rotations with their arms."""
    for component in SLOPES:
        other_m = POINT["xyz".index(component.times)] / MM
        by_slope = error_at(chain, {component.code: 12.0}, POINT, TOOL)
        parent = component.code.partition("^")[0]
        by_parent = error_at(chain, {parent: 12.0 * other_m}, POINT, TOOL)
        np.testing.assert_allclose(by_slope, by_parent, rtol=1e-13, err_msg=component.code)
        assert np.abs(by_slope[0]).max() > 0.05, component.code


def test_the_gantrys_slopes_by_hand():
    """8.40-8.54 at x = 2 m: XYFZ, y = 1 m, z = 0.5 m, no tool.

    E_y = (D_y(y) + 10·2) − z (A_x(y) + 3·2) = 20 − 0.5·6 = 17 µm, and by roll about X
    E_z gains y·6 = 6 µm.
    """
    found, _ = error_at("XYFZ", {"EYY^x": 10.0, "EAY^x": 3.0}, (2000.0, 1000.0, 500.0))
    np.testing.assert_allclose(found, [0.0, 17.0, 6.0], atol=1e-12)


def measured_along(chain, errors, axis, line):
    """What a laser along the axis reads on this line: the rotations' arms are in it."""
    only = {k: v for k, v in errors.items() if COMPONENTS[k].axis == axis}
    place = np.array(line.point_mm)
    place["xyz".index(axis)] = POINT["xyz".index(axis)]
    return error_at(chain, only, place, line.tool_offset_mm)


@pytest.mark.parametrize("chain", CHAINS)
def test_translations_measured_off_the_axis_serve_with_their_measuring_line(chain):
    """Hsu 17-25: the reading contains ω × the line's offset; the model takes it out again.

    Each axis' translations are replaced by what would be read along a line away from it,
    at this position of the axis; the volumetric error must be that of the true ones.
    """
    d, a = chapter_errors(np.random.default_rng(17))
    true = as_components(d, a)
    read = dict(true)
    for axis, line in LINES.items():
        for letter, value in zip("XYZ", measured_along(chain, true, axis, line)[0], strict=True):
            read[f"E{letter}{axis.upper()}"] = value
    expected, _ = error_at(chain, true, POINT, TOOL)
    found, _ = error_at(chain, read, POINT, TOOL, LINES)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    unaware, _ = error_at(chain, read, POINT, TOOL)
    assert np.abs(unaware - expected).max() > 1.0


@pytest.mark.parametrize("chain", CHAINS)
def test_on_a_nonrigid_machine_slopes_count_from_the_line_too(chain):
    """Translations and rotations are read on the line, where slopes have worked already."""
    rng = np.random.default_rng(18)
    true = as_components(*chapter_errors(rng)) | {c.code: float(rng.normal(0, 8)) for c in SLOPES}
    read = dict(true)
    for axis, line in LINES.items():
        place = dict(zip("xyz", line.point_mm, strict=True))
        for letter, value in zip("XYZ", measured_along(chain, true, axis, line)[0], strict=True):
            read[f"E{letter}{axis.upper()}"] = value
        for component in SLOPES:
            parent = COMPONENTS[component.code.partition("^")[0]]
            if component.axis == axis and parent.is_rotation:
                read[parent.code] += true[component.code] * place[component.times] / MM
    expected = error_at(chain, true, POINT, TOOL)
    found = error_at(chain, read, POINT, TOOL, LINES)
    np.testing.assert_allclose(found, expected, rtol=1e-11)


@pytest.mark.parametrize("along", [0.0, 123.0, -1e4])
def test_where_along_its_axis_the_line_is_stated_does_not_matter(along):
    errors = {"EBX": 12.0, "ECX": -7.0, "EAX": 3.0}
    one = error_at("XFYZ", errors, POINT, TOOL, {"x": MeasuringLine((0.0, 250.0, 100.0))})
    other = error_at("XFYZ", errors, POINT, TOOL, {"x": MeasuringLine((along, 250.0, 100.0))})
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("tool", [(0.0, 0.0, 0.0), TOOL])
def test_on_its_measuring_line_a_rotation_is_invisible(chain, tool):
    errors = {"EAX": 12.0, "EBX": -30.0, "ECX": 41.0}
    line = {"x": MeasuringLine((0.0, 250.0, 100.0), tool)}
    found, _ = error_at(chain, errors, (307.0, 250.0, 100.0), tool, line)
    np.testing.assert_allclose(found, 0.0, atol=1e-14)


def test_off_the_axis_an_exact_rotation_is_read_and_not_hsus_printed_sum():
    """Hsu 23-25, printed with + throughout: −L_y ECY, −L_z EAY and −L_x EBY are a rotation's."""
    a, b, c = 31.0, -47.0, 59.0
    offset_mm = np.array([310.0, 170.0, -230.0])
    x, y, z = offset_mm / MM
    turned = Rotation.from_rotvec(np.array([a, b, c]) * 1e-6).apply(offset_mm) - offset_mm
    found, _ = error_at("FYXZ", {"EAY": a, "EBY": b, "ECY": c}, (0.0, 400.0, 0.0), offset_mm)
    np.testing.assert_allclose(found, turned * MM, atol=2e-3)
    np.testing.assert_allclose(found, [z * b - y * c, x * c - z * a, y * a - x * b], rtol=1e-12)
    printed = [y * c + z * b, x * c + z * a, x * b + y * a]
    assert (np.abs(found - printed) > 10.0).all()


def test_the_second_row_of_the_milling_machines_model_is_that_of_its_own_matrix():
    """Sratong-on 9 gives δ_y + ε_z p_x − ε_x p_z; its 10 and 11 print ε_x p_z − ε_z p_x."""
    a, b, c = 31.0, -47.0, 59.0
    x, y, z = np.array(POINT) / MM
    matrix = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    errors = {"EXX": 3.0, "EYX": -4.0, "EZX": 5.0, "EAX": a, "EBX": b, "ECX": c}
    found, _ = error_at("XFYZ", errors, POINT)
    np.testing.assert_allclose(found, [3.0, -4.0, 5.0] + matrix @ [x, y, z], rtol=1e-12)
    printed = [3.0 - c * y + b * z, -4.0 + a * z - c * x, 5.0 - b * x + a * y]
    assert (np.abs(found - printed) > 1.0).tolist() == [False, True, False]


def test_hsus_second_table_is_the_rule_with_the_lines_through_home():
    """FYXZ: ECX has no gain, EAY −Z_m, EBY Z_m and −X_m, ECY +X_m (X_s = Z_s = 0)."""
    home = dict.fromkeys("xyz", MeasuringLine((0.0, 0.0, 0.0)))
    x, _, z = np.array(POINT) / MM
    rows = {
        "EAX": [0, -z, 0], "EBX": [z, 0, 0], "ECX": [0, 0, 0],
        "EAY": [0, -z, 0], "EBY": [z, 0, -x], "ECY": [0, x, 0],
        "EAZ": [0, 0, 0], "EBZ": [0, 0, 0], "ECZ": [0, 0, 0],
    }  # fmt: skip
    for code, row in rows.items():
        found, _ = error_at("FYXZ", {code: 1.0}, POINT, lines=home)
        np.testing.assert_allclose(found, row, atol=1e-15)


finite = st.floats(-1e4, 1e4)


@given(st.lists(finite, min_size=18, max_size=18), st.lists(finite, min_size=6, max_size=6))
def test_errors_add_up(values, rest):
    """First order: the error of all is the sum of each one's."""
    codes = [c.code for c in RIGID]
    errors = dict(zip(codes, values, strict=True))
    point, tool = rest[:3], rest[3:]
    together, turned = error_at("XYFZ", errors, point, tool)
    alone = [error_at("XYFZ", {code: value}, point, tool) for code, value in errors.items()]
    size = 1e-12 * (1 + np.abs(alone).sum())
    np.testing.assert_allclose(together, sum(e for e, _ in alone), atol=size)
    np.testing.assert_allclose(turned, sum(t for _, t in alone), atol=size)


def test_many_points_are_as_each_alone_with_one_tool_or_one_each():
    rng = np.random.default_rng(3)
    points, tools = rng.uniform(-500, 500, (40, 3)), rng.uniform(-200, 200, (40, 3))
    errors = {c.code: rng.normal(size=40) for c in COMPONENTS.values()}
    lines = {"y": MeasuringLine((10.0, 20.0, 30.0), (0.0, 5.0, 90.0))}
    together, turned = volumetric_error(Chain.parse("XYFZ"), errors, points, tools, lines)
    one_tool, _ = volumetric_error(Chain.parse("XYFZ"), errors, points, TOOL, lines)
    for i in range(40):
        single = {code: float(values[i]) for code, values in errors.items()}
        alone, alone_turned = error_at("XYFZ", single, points[i], tools[i], lines)
        np.testing.assert_array_equal(together[i], alone)
        np.testing.assert_array_equal(turned[i], alone_turned)
        np.testing.assert_array_equal(
            one_tool[i], error_at("XYFZ", single, points[i], TOOL, lines)[0]
        )


def test_a_single_value_serves_all_points():
    points = [[0.0, 100.0, 0.0], [0.0, 200.0, 0.0]]
    found, _ = volumetric_error(Chain.parse("XYFZ"), {"SXY": np.float64(10.0)}, points)
    assert found.tolist() == [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]


def test_no_errors_are_no_error_and_rotary_locations_are_not_the_linear_axes():
    nothing, turned = error_at("XYFZ", {}, POINT, TOOL)
    assert not nothing.any()
    assert not turned.any()
    rotary, _ = error_at("XYFZ", {"XOC": 10.0, "AOC": 10.0}, POINT, TOOL)
    assert not rotary.any()


def test_a_lathe_sums_its_two_axes():
    """FZX: z carries x, so EBZ acts on the arm x: z is in error by −x·EBZ."""
    found, _ = error_at("FZX", {"EZZ": 3.0, "EXX": 2.0, "EBZ": 10.0}, (100.0, 0.0, 400.0))
    np.testing.assert_allclose(found, [2.0, 0.0, 3.0 - 0.1 * 10.0])


@pytest.mark.parametrize("points", [[[1.0, 2.0]], [[1.0, 2.0, 3.0, 4.0]], [5.0]])
def test_points_without_three_coordinates_are_refused(points):
    with pytest.raises(InvalidContent, match=r"expected points of 3 coordinates in mm, got \d"):
        volumetric_error(Chain.parse("XYFZ"), {}, points)
