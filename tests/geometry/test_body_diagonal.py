"""What the four diagonals show: 8.108-8.111 as printed (and as they must be), Ed and ESd."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry.body_diagonal import (
    DIAGONALS,
    diagonal_accuracy,
    diagonal_ends,
    displacement_along,
    extreme_displacements,
)
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.work_volume import WorkVolume
from tests.geometry.example_fields import (
    RIGID,
    TOOL,
    TRANSLATIONS,
    constant_field,
    diagonal_displacements,
    random_field,
)

# Three different sides, so that no two terms are alike [mm].
A, B, C = 307.0, 211.0, 503.0
R = np.sqrt(A * A + B * B + C * C)
BOX = WorkVolume((0.0, A), (0.0, B), (0.0, C))

# The signs of a/r, b/r, c/r in 8.108-8.111.
SIGNS = {"ppp": (1, 1, 1), "npp": (-1, 1, 1), "pnp": (1, -1, 1), "ppn": (1, 1, -1)}

# The angular terms of 8.108-8.111 for FXYZ. In 8.108 most subscripts are lost; the text
# below 8.111 names them. The last term of 8.110 is printed A_y(y)*bc/r.
FXYZ_TERMS = {
    "ppp": {"EBX": "+ac", "ECX": "-ab", "EBY": "+ac", "EAY": "-bc"},
    "npp": {"EBX": "-ac", "ECX": "+ab", "EBY": "-ac", "EAY": "-bc"},
    "pnp": {"EBX": "+ac", "ECX": "+ab", "EBY": "+ac", "EAY": "+bc"},
    "ppn": {"EBX": "-ac", "ECX": "-ab", "EBY": "-ac", "EAY": "+bc"},
}
# What the text says is left of them, for ppp. For XYZF it says "exactly the same as in the
# FXYZ": the same four with opposite signs follow from 8.80-8.82.
LEFT_ON_PPP = {
    "FXYZ": FXYZ_TERMS["ppp"],
    "XFYZ": {"EBY": "+ac", "EAY": "-bc"},
    "XYFZ": {"ECX": "+ab", "EAX": "-bc"},
    "XYZF": {"EBX": "-ac", "ECX": "+ab", "EBY": "-ac", "EAY": "+bc"},
}
ANGULAR = [c for c, component in COMPONENTS.items() if component.kind is Kind.ANGULAR]


def as_printed(term, value):
    """+ac with 12 µrad: 12 ac/r [µm]."""
    sides = {"a": A, "b": B, "c": C}
    arm = sides[term[1]] * sides[term[2]] / R
    return (1 if term[0] == "+" else -1) * value * arm / 1000.0


def last(field, tool=(0.0, 0.0, 0.0)):
    found = diagonal_displacements(field, BOX, 7, tool)
    return {name: displacements[-1] for name, displacements in found.items()}


def test_fxyz_shows_the_angular_terms_of_8_108_to_8_111():
    for diagonal in DIAGONALS:
        for code in ANGULAR:
            found = last(constant_field("FXYZ", {code: 12.0}))[diagonal]
            term = FXYZ_TERMS[diagonal].get(code)
            assert found == pytest.approx(as_printed(term, 12.0) if term else 0.0, abs=1e-12)


def test_each_configuration_shows_what_the_text_lists_on_ppp():
    for chain in LEFT_ON_PPP:
        for code in ANGULAR:
            found = last(constant_field(chain, {code: 12.0}))["ppp"]
            term = LEFT_ON_PPP[chain].get(code)
            assert found == pytest.approx(as_printed(term, 12.0) if term else 0.0, abs=1e-12)


def test_xyzf_is_fxyz_with_opposite_signs_on_every_diagonal():
    for diagonal in DIAGONALS:
        for code in ANGULAR:
            fixed_workpiece = last(constant_field("FXYZ", {code: 12.0}))[diagonal]
            fixed_tool = last(constant_field("XYZF", {code: 12.0}))[diagonal]
            assert fixed_tool == pytest.approx(-fixed_workpiece, abs=1e-12)


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_linear_and_squareness_terms_are_those_of_8_108_to_8_111(diagonal):
    """±a/r D_x(x) ±b/r D_y(x) … ±a/r [D_x(y) + y S_xy] …, each D as its axis travelled."""
    field = random_field("XYFZ", TRANSLATIONS, seed=108)
    expected = 0.0
    r = np.array(SIGNS[diagonal]) * [A, B, C] / R
    start, end = diagonal_ends(BOX, diagonal)
    for code, (positions, values) in field.tables.items():
        component = COMPONENTS[code]
        along = r["xyz".index(component.direction)]
        if component.axis:
            u = "xyz".index(component.axis)
            travelled = np.interp([start[u], end[u]], positions, values[0])
            expected += along * (travelled[1] - travelled[0])
        else:
            u = "xyz".index(component.times)
            expected += along * values[0, 0] * (end[u] - start[u]) / 1000.0
    assert last(field)[diagonal] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_a_diagonal_runs_as_its_letters_say(diagonal):
    start, end = diagonal_ends(BOX, diagonal)
    np.testing.assert_array_equal(np.sign(end - start), SIGNS[diagonal])
    assert np.linalg.norm(end - start) == pytest.approx(BOX.diagonal_mm) == pytest.approx(R)


@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ", "XYZF"])
def test_every_reading_is_the_volumetric_error_along_the_diagonal_since_the_start(chain):
    field = random_field(chain, RIGID, seed=1)
    found = diagonal_displacements(field, BOX, 10, TOOL)
    for name, displacements in found.items():
        assert displacements[0] == 0.0
        start, end = diagonal_ends(BOX, name)
        for i in (3, 10):
            here, there = (field.at(p, TOOL)[0][0] for p in (start, start + i / 10 * (end - start)))
            expected = (there - here) @ (end - start) / R
            assert displacements[i] == pytest.approx(expected, rel=1e-12)


def test_a_direction_counts_and_its_length_does_not():
    errors = np.array([[1.0, 1.0, 1.0], [1.0, 5.0, 1.0]])
    assert displacement_along(errors, np.array([0.0, 7.0, 0.0])).tolist() == [0.0, 4.0]
    assert displacement_along(errors, np.array([0.0, -0.1, 0.0])).tolist() == [0.0, -4.0]


def test_uniform_growth_lengthens_all_diagonals_alike():
    """10 µm/m in every axis is 10 µm/m along any diagonal: Ed = ESd."""
    tables = {f"E{u}{u}": Table([0.0, 1000.0], [0.0, 10.0]) for u in "XYZ"}
    field = ErrorField.make(Chain.parse("XYFZ"), tables)
    found = diagonal_accuracy(diagonal_displacements(field, BOX))
    assert found.ed_um == pytest.approx(10.0 * R / 1000.0)
    assert found.esd_um == pytest.approx(found.ed_um)


@pytest.mark.parametrize(("code", "sides"), [("SXY", A * B), ("SYZ", B * C), ("SZX", A * C)])
def test_squareness_alone_enters_ed_once_and_esd_twice(code, sides):
    """So "Ed does not include squareness errors" cannot be meant word for word."""
    found = diagonal_accuracy(diagonal_displacements(constant_field("XYFZ", {code: 10.0}), BOX))
    assert found.ed_um == pytest.approx(10.0 * sides / R / 1000.0)
    assert found.esd_um == pytest.approx(2.0 * found.ed_um)


def test_squareness_has_the_signs_of_wang_2000_12_and_gives_13():
    """12 and 13 count θ as 8.58-8.60 count S; 9 and 11 there print −yθ_xy, −zθ_xz, −zθ_yz."""
    xy, yz, zx = 12.0, -5.0, 7.0
    found = last(constant_field("FXYZ", {"SXY": xy, "SYZ": yz, "SZX": zx}))
    by_xy, by_yz, by_zx = np.array([xy * A * B, yz * B * C, zx * C * A]) / R / 1000.0
    assert found["ppp"] == pytest.approx(by_xy + by_yz + by_zx)
    assert found["npp"] == pytest.approx(-by_xy + by_yz - by_zx)
    assert found["pnp"] == pytest.approx(-by_xy - by_yz + by_zx)
    assert found["ppn"] == pytest.approx(by_xy - by_yz - by_zx)
    assert (found["ppp"] + found["ppn"]) * R / (2 * A * B) * 1000.0 == pytest.approx(xy)
    assert (found["ppp"] + found["npp"]) * R / (2 * B * C) * 1000.0 == pytest.approx(yz)
    assert (found["ppp"] + found["pnp"]) * R / (2 * C * A) * 1000.0 == pytest.approx(zx)


readings = st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=9)


@given(st.fixed_dictionaries(dict.fromkeys(DIAGONALS, readings)))
def test_esd_is_never_less_than_ed(displacements):
    found = diagonal_accuracy(displacements)
    assert found.ed_um == max(found.ranges_um.values())
    assert found.esd_um >= found.ed_um


def test_ranges_by_hand():
    found = diagonal_accuracy(
        {"ppp": [0.0, 3.0, -1.0], "npp": [0.0, -2.0], "pnp": [0.0, 1.0], "ppn": [0.0, 1.0, 2.0]}
    )
    assert dict(found.ranges_um) == {"ppp": 4.0, "npp": 2.0, "pnp": 1.0, "ppn": 2.0}
    assert (found.ed_um, found.esd_um) == (4.0, 5.0)


@pytest.mark.parametrize(
    ("missing", "values"), [("npp", None), ("ppn", []), ("ppp", [0.0, np.nan])]
)
def test_all_four_diagonals_are_needed(missing, values):
    given_um = {name: [0.0, 1.0] for name in DIAGONALS}
    given_um[missing] = values
    if values is None:
        del given_um[missing]
    with pytest.raises(InvalidContent, match=f"diagonals.{missing}: expected finite displacements"):
        diagonal_accuracy(given_um)


def test_what_is_no_diagonal_is_refused():
    with pytest.raises(InvalidContent, match="expected ppp, npp, pnp, ppn, got 'nnn'"):
        diagonal_ends(BOX, "nnn")
    with pytest.raises(InvalidContent, match="expected a diagonal longer than 0 mm, got 0 mm"):
        extreme_displacements(random_field(), WorkVolume((1.0, 1.0), (2.0, 2.0), (3.0, 3.0)))
