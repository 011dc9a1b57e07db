"""Twelve sets of errors from the step diagonals: exact, as printed, and better than printed."""

import doctest
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_table import Table
from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.geometry.example_fields import exact_position
from tests.measurement.step_diagonal_example import (
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TRANSLATIONS,
    WAYS,
    derive,
    errors_of,
    expected_errors,
    field_of,
    increments_by_hand,
    nodes,
    random_tables,
)

R = np.linalg.norm(STEP)
LINES = ["end-points", "least-squares"]


def simulate(tables, steps=STEPS, **options):
    return step_diagonal_readings(field_of(tables), ORIGIN, STEP, steps, **options)


def assert_same(found, expected):
    errors = errors_of(found)
    assert set(errors) == set(expected)
    for code, values in expected.items():
        np.testing.assert_allclose(errors[code], np.atleast_1d(values), atol=1e-9, err_msg=code)


@pytest.mark.parametrize("line", LINES)
def test_it_finds_the_errors_that_made_the_readings(line):
    tables = random_tables(4, [*TRANSLATIONS, *SQUARENESS])
    found = derive(simulate(tables), line=line)
    assert_same(found, expected_errors(tables, line))
    assert np.abs(found.closure_um).max() < 1e-10
    for table in found.result.tables[:9]:
        np.testing.assert_allclose(table.positions_mm, nodes(table.component.axis))


@pytest.mark.parametrize("missing", WAYS)
def test_three_diagonals_suffice(missing):
    tables = random_tables(5, [*TRANSLATIONS, *SQUARENESS])
    read = simulate(tables, diagonals=[d for d in WAYS if d != missing])
    found = derive(read)
    assert_same(found, expected_errors(tables))
    assert found.closure_um is None
    assert any(note.startswith("Three diagonals (") for note in found.result.notes)
    assert "closure_rms_um" not in found.result.figures


changes = st.lists(st.floats(-50.0, 50.0), min_size=4, max_size=4)


@given(st.fixed_dictionaries(dict.fromkeys(TRANSLATIONS, changes)))
def test_any_straight_and_crooked_machine_is_found(values):
    tables = {code: Table(nodes(code[2], 3), v) for code, v in values.items()}
    found = derive(simulate(tables, 3), line="least-squares")
    assert_same(found, expected_errors(tables, "least-squares"))


def test_order_of_the_diagonals_does_not_matter():
    read = simulate(random_tables(6, TRANSLATIONS))
    one, other = derive(read), derive(dict(reversed(read.items())))
    assert_same(one, errors_of(other))


def test_all_steps_at_once_are_least_squares_of_each_interval_alone():
    """Readings that contradict each other, interval by interval with numpy's own solver."""
    rng = np.random.default_rng(8)
    read = {d: rng.normal(size=(STEPS, 3)) for d in WAYS}
    by_hand = increments_by_hand(read)
    design = np.array(list(WAYS.values())) * STEP / R
    found = derive(read)
    for u, axis in enumerate("XYZ"):
        moved = np.array(
            [
                np.linalg.lstsq(design, [by_hand[d, u, i] for d in WAYS], rcond=None)[0]
                for i in range(STEPS)
            ]
        )
        np.testing.assert_allclose(
            errors_of(found)[f"E{axis}{axis}"][1:], moved[:, u].cumsum(), atol=1e-12
        )
        left = [
            [by_hand[d, u, i] - design[k] @ moved[i] for k, d in enumerate(WAYS)]
            for i in range(STEPS)
        ]
        np.testing.assert_allclose(
            np.abs(found.closure_um[u]), np.linalg.norm(left, axis=1), atol=1e-12
        )


def equations_7_and_8(read):
    """[V 7–8], two diagonals at a time: E_v(u)'s increments from ppp and one other."""
    by_hand = increments_by_hand(read)
    other = dict(zip("XYZ", ("npp", "pnp", "ppn"), strict=True))
    return {
        f"E{v}{a}": np.cumsum(
            [
                (by_hand["ppp", u, i] - by_hand[other[v], u, i]) * R / (2 * step)
                for i in range(len(read["ppp"]))
            ]
        )
        for v, step in zip("XYZ", STEP, strict=True)
        for u, a in enumerate("XYZ")
    }


def equation_13(ends, sides):
    """[V 13] in µm/m, with the ends' displacements in µm and the volume's sides in mm."""
    x, y, z = sides
    r = np.linalg.norm(sides)
    return {
        "SYZ": (ends["ppp"] + ends["npp"]) * r / (2 * y * z) * 1000.0,
        "SZX": (ends["ppp"] + ends["pnp"]) * r / (2 * z * x) * 1000.0,
        "SXY": (ends["ppp"] + ends["ppn"]) * r / (2 * x * y) * 1000.0,
    }


def test_equations_7_and_8_agree_where_nothing_contradicts():
    tables = random_tables(9, TRANSLATIONS)
    printed = equations_7_and_8(simulate(tables))
    for code in TRANSLATIONS:
        values = np.asarray(tables[code].values)
        np.testing.assert_allclose(printed[code], (values - values[0])[1:], atol=1e-9)


@pytest.mark.slow
def test_least_squares_has_half_the_variance_of_equations_7_and_8():
    rng = np.random.default_rng(10)
    field = field_of({})
    printed, ours = [], []
    for _ in range(300):
        read = step_diagonal_readings(field, ORIGIN, STEP, 4, noise_um=1.0, rng=rng)
        printed.append([equations_7_and_8(read)[f"E{u}{u}"][-1] for u in "XYZ"])
        found = errors_of(derive(read))
        ours.append([found[f"E{u}{u}"][-1] for u in "XYZ"])
    ratio = np.var(ours, axis=0) / np.var(printed, axis=0)
    assert ratio.mean() == pytest.approx(0.5, abs=0.06)


def test_equation_13_gives_squareness_only_where_no_axis_is_too_long():
    """V 12 has no linear displacement; what there is of it, V 13 counts as squareness."""
    sides = STEP * STEPS
    square = {"SXY": Table((), 12.0), "SYZ": Table((), -7.0), "SZX": Table((), 5.0)}
    long = {f"E{u}{u}": Table(nodes(u), 0.01 * (nodes(u) - nodes(u)[0])) for u in "XYZ"}

    for tables, excess in ((square, 0.0), (square | long, 10.0)):
        read = simulate(tables)
        ends = {d: rows[-1, 2] for d, rows in read.items()}
        printed = equation_13(ends, sides)
        for code, (a, b) in {"SXY": (0, 1), "SYZ": (1, 2), "SZX": (2, 0)}.items():
            true = float(square[code].values)
            wrong = excess * (sides @ sides) / (sides[a] * sides[b])
            assert printed[code] == pytest.approx(true + wrong, abs=1e-9)
            assert errors_of(derive(read))[code] == pytest.approx(true, abs=1e-9)
    # 10 µm/m in all axes look like these.
    excess = [10.0 * (sides @ sides) / (sides[a] * sides[b]) for a, b in ((0, 1), (1, 2), (2, 0))]
    assert excess == pytest.approx([100 / 3, 125 / 3, 25.0])


def test_equation_9_has_a_wrong_sign_in_its_last_line_and_11_the_right_one():
    """FXYZ: −yα_x(x) in P_z of V 9, +yα_x(x) in V 11; the product of motions decides."""
    alpha = 10.0
    point = np.array([0.0, 400.0, 0.0])
    moved = (exact_position("FXYZ", {"EAX": alpha}, point, np.zeros(3)) - point) * 1000.0
    assert moved[2] == pytest.approx(+alpha * 0.4, rel=1e-6)


@pytest.mark.parametrize("code", SQUARENESS)
def test_squareness_has_the_signs_of_12_and_not_of_9_and_11(code):
    """V 9 and V 11 have −yθ_xy, by which V 12 would be negative; both cannot be right."""
    a, b = (LINEAR_LETTERS.index(letter) for letter in code[1:].lower())
    read = simulate({code: Table((), 10.0)})
    for diagonal, ways in WAYS.items():
        expected = ways[a] * ways[b] * 10.0 * STEP[a] * STEP[b] / R / 1000.0
        np.testing.assert_allclose(read[diagonal][:, 2], expected * np.arange(1, STEPS + 1))


def test_by_end_points_squareness_is_what_the_diagonals_ends_say():
    """Contrasts of the body diagonals, by hand: also where readings contradict each other."""
    rng = np.random.default_rng(13)
    read = {d: rng.normal(size=(STEPS, 3)) for d in WAYS}
    found = errors_of(derive(read))
    for code, (a, b) in {"SXY": (0, 1), "SYZ": (1, 2), "SZX": (2, 0)}.items():
        pairs = sum(WAYS[d][a] * WAYS[d][b] * read[d][-1, 2] for d in WAYS)
        assert found[code][0] == pytest.approx(pairs * R / (4 * STEP[a] * STEP[b] * STEPS) * 1000.0)


def test_of_two_lines_slopes_only_the_sum_is_an_error():
    """A turned machine reads the same as a straight one with tilted mirrors: no error."""
    turned = {
        "EXY": Table(nodes("y"), 0.02 * nodes("y")),
        "EYX": Table(nodes("x"), -0.02 * nodes("x")),
    }
    found = errors_of(derive(simulate(turned)))
    assert max(np.abs(values).max() for values in found.values()) < 1e-10


@pytest.mark.parametrize("line", LINES)
def test_straightness_counts_from_the_stated_line(line):
    found = derive(simulate(random_tables(11, TRANSLATIONS)), line=line)
    for table in found.result.tables[:9]:
        values, positions = table.errors, table.positions_mm
        if table.component.direction == table.component.axis:
            assert values[0] == 0.0
        elif line == "end-points":
            np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-10)
        else:
            np.testing.assert_allclose(np.polyfit(positions, values, 1), 0.0, atol=1e-9)
    assert any(f"counts from the {line} line" in note for note in found.result.notes)


def test_one_step_is_enough_for_all_but_straightness():
    tables = random_tables(12, [*TRANSLATIONS, *SQUARENESS], steps=1)
    found = derive(simulate(tables, 1))
    assert_same(found, expected_errors(tables))
    assert found.noise.reading_um is None
    assert all(table.covariance is None for table in found.result.tables)


def test_the_diagonals_mean_scale_is_weighted_with_the_squares_of_the_steps():
    scales = {"x": 12.0, "y": -3.0, "z": 7.0}
    tables = {f"E{u}{u}".upper(): Table(nodes(u), s / 1000.0 * nodes(u)) for u, s in scales.items()}
    read = simulate(tables | {"SXY": Table((), 20.0)})
    found = derive(read).result.figures["diagonal_scale_um_per_m"]
    assert found == pytest.approx((STEP**2 @ list(scales.values())) / R**2)
    ends = [rows[-1, 2] for rows in read.values()]
    assert found == pytest.approx(np.mean(ends) / (R * STEPS / 1000.0))


@pytest.mark.parametrize("page", ["step-diagonal", "body-diagonal"])
def test_the_worked_example_of_the_page_is_true(page):
    path = Path(__file__).parents[2] / "docs" / "methods" / f"{page}.md"
    found = doctest.testfile(str(path), module_relative=False, encoding="utf-8")
    assert found.attempted > 3
    assert found.failed == 0
