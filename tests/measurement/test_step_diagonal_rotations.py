"""Rotations in the step diagonals: removed where known, and what they do where not."""

import re

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume, points_of
from app.measurement.step_diagonal import step_diagonal
from app.measurement.step_diagonal_readings import step_diagonal_readings
from tests.geometry.example_fields import diagonal_displacements
from tests.measurement.step_diagonal_example import (
    ANGULAR,
    CHAINS,
    ORIGIN,
    SQUARENESS,
    STEP,
    STEPS,
    TOOL,
    TRANSLATIONS,
    about_its_line,
    derive,
    errors_of,
    field_of,
    nodes,
    random_tables,
)

CORNERS = points_of(nodes("x"), nodes("y"), nodes("z"))


def without_rigid_motion(errors, points):
    """What is left of errors when the best displacement and turn of the whole is taken out."""
    x, y, z = (points / 1000.0).T
    zero = np.zeros_like(x)
    turns = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    columns = [*np.repeat(np.eye(3)[:, :, None], len(x), axis=2), *np.array(turns)]
    design = np.array([np.ravel(c, order="F") for c in columns]).T
    values = errors.ravel()
    return values - design @ np.linalg.lstsq(design, values, rcond=None)[0]


@pytest.mark.slow
@pytest.mark.parametrize("target", ["point", "flat-mirror"])
@pytest.mark.parametrize("chain", CHAINS)
def test_with_known_rotations_the_map_is_the_machine(chain, target):
    """At every node of the volume and with another tool, but for one motion of the whole."""
    rotations = random_tables(21, ANGULAR, size=20.0)
    truth = field_of(random_tables(20, [*TRANSLATIONS, *SQUARENESS]) | rotations, chain)
    read = step_diagonal_readings(truth, ORIGIN, STEP, STEPS, tool_offset_mm=TOOL, target=target)
    found = derive(read, chain, angular=rotations, tool_offset_mm=TOOL, target=target)
    assert np.abs(found.closure_um).max() < 1e-10
    derived = {t.component.code: Table(t.positions_mm, t.errors) for t in found.result.tables}
    model = field_of(derived | rotations, chain, found.result.measuring_lines)
    for tool in (TOOL, (-40.0, 70.0, 300.0)):
        difference = model.at(CORNERS, tool)[0] - truth.at(CORNERS, tool)[0]
        assert np.abs(without_rigid_motion(difference, CORNERS)).max() < 1e-9
    assert not any(note.startswith("Rotations that were not stated") for note in found.result.notes)


def test_without_them_the_closures_and_the_map_are_wrong():
    rotations = random_tables(21, ANGULAR, size=20.0)
    truth = field_of(random_tables(20, TRANSLATIONS) | rotations)
    found = derive(step_diagonal_readings(truth, ORIGIN, STEP, STEPS))
    assert np.abs(found.closure_um).max() > 1.0
    derived = {t.component.code: Table(t.positions_mm, t.errors) for t in found.result.tables}
    model = field_of(derived | rotations, "XYFZ", found.result.measuring_lines)
    difference = model.at(CORNERS)[0] - truth.at(CORNERS)[0]
    assert np.abs(without_rigid_motion(difference, CORNERS)).max() > 1.0


def test_a_map_of_translations_alone_tells_the_ends_of_the_diagonals():
    """Whatever turns: at the far corners it says what was read there."""
    truth = field_of(random_tables(22, [*TRANSLATIONS, *ANGULAR]), "FXYZ")
    read = step_diagonal_readings(truth, ORIGIN, STEP, STEPS)
    found = derive(read, "FXYZ")
    derived = {t.component.code: Table(t.positions_mm, t.errors) for t in found.result.tables}
    box = WorkVolume(*zip(ORIGIN, ORIGIN + STEP * STEPS, strict=True))
    expected = diagonal_displacements(field_of(derived, "FXYZ"), box, STEPS)
    for diagonal, rows in read.items():
        assert expected[diagonal][-1] == pytest.approx(rows[-1, 2], abs=1e-9)
    assert np.abs(found.closure_um).max() > 0.1


def test_removing_some_rotations_removes_no_others():
    """What is derived is linear: known rotations leave what the others alone would give."""
    rotations = random_tables(23, ANGULAR)
    known = {code: rotations[code] for code in ("EBX", "ECX", "EAY")}
    others = {code: t for code, t in rotations.items() if code not in known}
    one = derive(step_diagonal_readings(field_of(rotations), ORIGIN, STEP, STEPS), angular=known)
    lines = one.result.measuring_lines
    on_lines = step_diagonal_readings(field_of(known), ORIGIN, STEP, STEPS)
    free = step_diagonal_readings(field_of(known, "XYFZ", lines), ORIGIN, STEP, STEPS)
    alone = step_diagonal_readings(field_of(others), ORIGIN, STEP, STEPS)
    other = derive({d: alone[d] + on_lines[d] - free[d] for d in alone})
    for code, values in errors_of(other).items():
        np.testing.assert_allclose(errors_of(one)[code], values, atol=1e-9)
    (note,) = [n for n in one.result.notes if n.startswith("Rotations that were not stated")]
    assert "EAX" in note
    assert not any(code in note for code in known)


# --- What rotations that nobody stated do, in the limit of many small steps -----------------

SIDES = np.array([500.0, 300.0, 400.0])
MANY = 80
SHAPES = {
    "constant": lambda t: np.full_like(t, 10.0),
    "odd": lambda t: 20.0 * t - 30.0 * t**3,
    "even": lambda t: 40.0 * t**2 - 10.0 * t**4,
}
CENTRE = ORIGIN + SIDES / 2


def predicted(chain, code, shape):
    """The note's sentence as integrals: nine translations on fine nodes [µm].

    Second, what of them is squareness: the line through the centre, and the mean of both
    ends of the axis as a turn of the axes that are its arms.
    """
    about, v = "ABC".index(code[1]), "XYZ".index(code[2])
    t = np.linspace(-0.5, 0.5, MANY + 1)

    def rotation(values):
        omega = np.zeros((t.size, 3))
        omega[:, about] = values
        return omega

    whole = rotation(shape(t))
    even, odd = rotation((shape(t) + shape(-t)) / 2), rotation((shape(t) - shape(-t)) / 2)
    found = np.zeros((3, t.size, 3))
    square = np.zeros((3, t.size, 3))
    for letter in Chain.parse(chain).acts_on("xyz"[v]):
        u = "xyz".index(letter)
        unit = np.eye(3)[u]
        if u == v:
            # Its own arm: all of it, as if it were a translation.
            own = np.cross(whole, np.outer((CENTRE[v] + SIDES[v] * t) / 1000.0, unit))
            found[v] += own
            square[v] += own
            continue
        on_line = np.cross(whole, unit * CENTRE[u] / 1000.0)
        found[v] += on_line
        square[v] += on_line
        square[u] += np.outer(SIDES[u] * t / 1000.0, np.cross(whole[[0, -1]].mean(axis=0), unit))
        along_v = np.cross(whole, unit)[:, v]
        middle = (t[1:] + t[:-1]) / 2
        found[v][:, u] += np.r_[0.0, (middle * np.diff(along_v)).cumsum()] * SIDES[v] / 1000.0
        turned = np.cross(even, unit)
        turned[:, u] += np.cross(odd, unit)[:, v] * SIDES[v] / SIDES[u]
        steps = (turned[1:] + turned[:-1]) / 2 * SIDES[u] / MANY / 1000.0
        found[u] += np.vstack([np.zeros(3), steps.cumsum(axis=0)])
    return found, square


@pytest.mark.slow
@pytest.mark.parametrize(
    ("chain", "code", "shape"),
    [
        (chain, code, list(SHAPES)[(i + j) % len(SHAPES)])
        for i, chain in enumerate(CHAINS)
        for j, code in enumerate(ANGULAR)
    ],
)
def test_unknown_rotations_do_what_the_note_says(chain, code, shape):
    v = "XYZ".index(code[2])
    fine = ORIGIN[v] + np.linspace(0.0, SIDES[v], MANY + 1)
    table = Table(fine, SHAPES[shape]((fine - CENTRE[v]) / SIDES[v]))
    read = step_diagonal_readings(field_of({code: table}, chain), ORIGIN, SIDES / MANY, MANY)
    found = errors_of(step_diagonal(Chain.parse(chain), ORIGIN, SIDES / MANY, read))

    expected, slopes = {}, {}
    translations, square = predicted(chain, code, SHAPES[shape])
    for u, axis in enumerate("XYZ"):
        at = ORIGIN[u] + np.linspace(0.0, SIDES[u], MANY + 1)
        for d, direction in enumerate("XYZ"):
            values = translations[u][:, d]
            own = f"E{direction}{axis}"
            expected[own] = values - values[0]
            if u != d:
                expected[own], _ = about_its_line(at, values, "end-points")
                _, slopes[own] = about_its_line(at, square[u][:, d], "end-points")
    # What is left is of the order of a step's lever arm: 20 µrad · 6 mm.
    for own, values in expected.items():
        np.testing.assert_allclose(found[own], values, atol=0.06, err_msg=own)
    for a, b in ("XY", "YZ", "ZX"):
        both = slopes[f"E{a}{b}"] + slopes[f"E{b}{a}"]
        assert found[f"S{a}{b}"][0] == pytest.approx(both, abs=0.3)


def test_the_bias_is_no_small_one():
    """FXYZ, yaw EBX of ±10 µrad: 1.25 µm in EZX and in EZZ though neither axis is wrong."""
    fine = ORIGIN[0] + np.linspace(0.0, 500.0, MANY + 1)
    yaw = {"EBX": Table(fine, 20.0 * (fine - CENTRE[0]) / 500.0)}
    read = step_diagonal_readings(field_of(yaw, "FXYZ"), ORIGIN, SIDES / MANY, MANY)
    found = errors_of(step_diagonal(Chain.parse("FXYZ"), ORIGIN, SIDES / MANY, read))
    # ∫ (x − x_c) dω from one end to the centre: 20 µrad / 0.5 m · (0.25 m)²/2.
    assert np.abs(found["EZX"]).max() == pytest.approx(1.25, abs=0.03)
    assert np.abs(found["EZZ"]).max() == pytest.approx(1.25, abs=0.03)


@pytest.mark.parametrize(
    ("chain", "said", "unsaid"),
    [
        ("FXYZ", ["EBX", "ECX", "EAX", "EAY", "EBY"], ["ECY", "EAZ", "EBZ", "ECZ"]),
        ("XYFZ", ["EBX", "EAX", "ECY", "EAY", "EBY"], ["ECX", "EAZ", "EBZ", "ECZ"]),
        ("XYZF", ["ECY", "EBY", "EBZ", "ECZ", "EAZ"], ["EAX", "EBX", "ECX", "EAY"]),
    ],
)
def test_the_note_names_the_rotations_that_count_for_the_chain(chain, said, unsaid):
    read = step_diagonal_readings(field_of({}, chain), ORIGIN, STEP, 2)
    (note,) = [n for n in derive(read, chain).result.notes if n.startswith("Rotations that were")]
    assert all(code in note for code in said)
    assert not any(code in note for code in unsaid)


def test_the_measuring_lines_go_through_the_centre_with_the_tool_offset():
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, STEPS, tool_offset_mm=TOOL)
    found = derive(read, tool_offset_mm=TOOL)
    assert set(found.result.measuring_lines) == set("xyz")
    for line in found.result.measuring_lines.values():
        np.testing.assert_allclose(line.point_mm, ORIGIN + STEP * STEPS / 2)
        assert line.tool_offset_mm == TOOL


def test_only_angular_errors_are_taken_as_known():
    read = step_diagonal_readings(field_of({}), ORIGIN, STEP, 2)
    for wrong in ("EXX", "SXY", "EQX", "EYX^z", "AOC"):
        with pytest.raises(InvalidContent, match=rf"expected angular errors .* got '{wrong[:3]}"):
            derive(read, angular={wrong: Table((), 1.0)})


def test_slopes_of_rotations_are_taken_too():
    """A rotation that grows with another coordinate is a known rotation all the same."""
    known = {"EBX": Table(nodes("x"), np.linspace(0.0, 9.0, STEPS + 1)), "EBX^y": Table((), 8.0)}
    read = step_diagonal_readings(field_of(known), ORIGIN, STEP, STEPS)
    lines = derive(read).result.measuring_lines
    on_lines = step_diagonal_readings(field_of(known, "XYFZ", lines), ORIGIN, STEP, STEPS)
    expected = errors_of(derive({d: read[d] - on_lines[d] for d in read}))
    for code, values in errors_of(derive(read, angular=known)).items():
        np.testing.assert_allclose(values, expected[code], atol=1e-9)


def named_in(note, code):
    """The components in which the note puts a rotation: all brackets behind its code."""
    brackets = re.findall(rf"{code} \(([^)]*)\)", note)
    return {name for bracket in brackets for name in re.findall(r"in (E[XYZ]{2})", bracket)}


@pytest.mark.slow
@pytest.mark.parametrize("code", ANGULAR)
@pytest.mark.parametrize("chain", ["FXYZ", "FYXZ", "FZYX"])
def test_the_note_puts_each_rotation_where_it_appears(chain, code):
    """Centred on 0 and with all axes on the tool's side nothing else is in the tables."""
    v = "XYZ".index(code[2])
    t = np.linspace(-0.5, 0.5, MANY + 1)
    table = Table(SIDES[v] * t, 200.0 * t**2 - 60.0 * t + 80.0 * t**3)
    machine = Chain.parse(chain)
    read = step_diagonal_readings(field_of({code: table}, chain), -SIDES / 2, SIDES / MANY, MANY)
    found = step_diagonal(machine, -SIDES / 2, SIDES / MANY, read)
    seen = {c for c, values in errors_of(found).items() if np.abs(values).max() > 0.35}
    (note,) = [n for n in found.result.notes if n.startswith("Rotations that were not stated")]
    assert seen - set(SQUARENESS) == named_in(note, code)
