"""What each kind of controller leaves: by hand, and that its tables say the same."""

import math

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry import compensation_levels as module
from app.geometry.box_extremes import error_extremes
from app.geometry.chain import Chain
from app.geometry.compensation_levels import Level, compensation_levels, level_tables
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLine
from app.geometry.work_volume import WorkVolume
from tests.geometry.example_fields import (
    LINES,
    NONRIGID,
    RIGID,
    TOOL,
    TRANSLATIONS,
    constant_field,
    random_field,
)

BOX = WorkVolume((0.0, 500.0), (50.0, 400.0), (100.0, 300.0))
NO_TOOL = (0.0, 0.0, 0.0)


def left_um(field, tool=TOOL):
    return {level.level: level for level in compensation_levels(field, BOX, tool, 5)}


def test_each_level_takes_its_own_errors_away():
    """EXX 3, EYX 4, SXY 10 µm/m, EBX 10 µrad with z, EZZ^x 2 µm/m: one after the other."""
    components = {"EXX": 3.0, "EYX": 4.0, "EZY": 12.0, "EBX": 10.0, "EZX^y": 5.0}
    found = left_um(constant_field("FXYZ", components), NO_TOOL)
    # At the corner y = 400, z = 300 mm: x 3 + 3, y 4, z 12 + 2.
    assert found[Level.NOTHING].max_um == pytest.approx(math.hypot(6.0, 4.0, 14.0))
    assert found[Level.DISPLACEMENT].max_um == pytest.approx(math.hypot(3.0, 4.0, 14.0))
    assert found[Level.STRAIGHTNESS].max_um == pytest.approx(math.hypot(3.0, 2.0))
    assert found[Level.ANGULAR].max_um == pytest.approx(2.0)
    assert found[Level.NONRIGID].max_um == pytest.approx(0.0, abs=1e-12)


def test_mean_rms_and_largest_by_hand():
    """E_x = 10 µm/m · z with z at 100 and 300 mm: 1 and 3 µm."""
    nothing = compensation_levels(constant_field("FXYZ", {"SZX": 10.0}), BOX, NO_TOOL, 2)[0]
    assert (nothing.mean_um, nothing.max_um) == (pytest.approx(2.0), pytest.approx(3.0))
    assert nothing.rms_um == pytest.approx(math.sqrt(5.0))


@pytest.mark.slow
@pytest.mark.parametrize("chain", ["FXYZ", "XFYZ", "XYFZ", "XYZF"])
def test_the_last_level_leaves_nothing_of_the_model_and_rigid_ones_need_no_nonrigid(chain):
    found = left_um(random_field(chain, NONRIGID, positions=3))
    assert found[Level.NONRIGID].max_um < 1e-10
    assert found[Level.ANGULAR].max_um > 1.0
    rigid = left_um(random_field(chain, RIGID))
    assert rigid[Level.ANGULAR].max_um < 1e-10
    assert rigid[Level.STRAIGHTNESS].max_um > 1.0


def test_without_rotations_straightness_tables_are_enough():
    found = left_um(random_field("XYFZ", TRANSLATIONS))
    assert found[Level.STRAIGHTNESS].max_um < 1e-10
    assert found[Level.DISPLACEMENT].max_um > 1.0


@pytest.mark.parametrize("chain", ["FXYZ", "XYFZ"])
def test_what_straightness_tables_leave_is_the_rotations_at_the_present_tool(chain):
    """Twice the tool, and what is left changes by exactly Σω × T."""
    field = random_field(chain, RIGID)
    rotations = field.only(lambda component: component.is_rotation)
    points = BOX.lattice(5)
    for tool in (NO_TOOL, TOOL, (0.0, 0.0, 500.0)):
        expected = np.linalg.norm(rotations.at(points, tool)[0], axis=1)
        found = left_um(field, tool)[Level.STRAIGHTNESS]
        assert expected.max() <= found.max_um + 1e-9
        assert found.max_um == error_extremes(rotations, BOX, tool).longest
        assert found.rms_um == pytest.approx(np.sqrt((expected**2).mean()), rel=1e-9)


def test_on_the_measuring_lines_straightness_tables_leave_nothing():
    """Hsu 17-25: what a laser read along a line is right there, angular errors included."""
    line = {"x": MeasuringLine((0.0, 200.0, 150.0))}
    tables = {"EXX": Table([0.0, 500.0], [0.0, 9.0]), "EBX": Table([0.0, 500.0], [0.0, 30.0])}
    along = WorkVolume((0.0, 500.0), (200.0, 200.0), (150.0, 150.0))
    measured = ErrorField.make(Chain.parse("XYFZ"), tables, line)
    by_convention = ErrorField.make(Chain.parse("XYFZ"), tables)
    left = [compensation_levels(f, along, NO_TOOL, 5)[2].max_um for f in (measured, by_convention)]
    assert left[0] == pytest.approx(0.0, abs=1e-12)
    # z EBX and, on the workpiece's side, −x EBX.
    assert left[1] == pytest.approx(math.hypot(0.15 * 30.0, 0.5 * 30.0))


@pytest.mark.slow
@pytest.mark.parametrize("lines", [None, LINES])
@pytest.mark.parametrize("chain", ["XFYZ", "XYZF"])
def test_the_tables_of_a_level_leave_what_the_level_says(chain, lines):
    """The tables put back into a model, without any squareness, are what was taken away."""
    field = random_field(chain, NONRIGID, positions=4, lines=lines, low=120.0, high=330.0)
    points = BOX.lattice(6)
    errors, _ = field.at(points, TOOL)
    for level in compensation_levels(field, BOX, TOOL, 6):
        rebuilt = ErrorField.make(field.chain, level.tables, lines)
        left = np.linalg.norm(errors - rebuilt.at(points, TOOL)[0], axis=1)
        assert left.mean() == pytest.approx(level.mean_um, abs=1e-9)
        assert left.max() <= level.max_um + 1e-9
        assert np.sqrt((left**2).mean()) == pytest.approx(level.rms_um, abs=1e-9)
        dense = BOX.lattice(36)
        left = np.linalg.norm(field.at(dense, TOOL)[0] - rebuilt.at(dense, TOOL)[0], axis=1)
        assert 0.9 * level.max_um - 1e-9 <= left.max() <= level.max_um + 1e-9


# 8.83-8.88 and 8.95-8.100 as printed: arm and rotation; X, Z are x + X_t and z + Z_t. Slopes,
# which stand beside their parents, are left out.
ROTATIONS_AS_PRINTED = {
    "8.83": "-Z EBX +Yt EAZ +Z EBY +Yt ECY -Zt EBZ +Yt ECZ",
    "8.84": "-X ECY +Z EAY -Xt ECZ +Zt EAZ -Xt ECX +Z EAX",
    "8.85": "-Yt EAZ +Xt EBZ -Yt EAX +Xt EBX -Yt EAY +X EBY",
    "8.86": "-z EBX -z EBY",
    "8.87": "-x ECY +z EAY +z EAX",
    "8.88": "+x EBY",
    "8.95": "+Z EBX +Yt ECX -Z EBY +Yt ECY -Zt EBZ +Yt ECZ",
    "8.96": "-X ECY +Z EAY -Xt ECZ +Zt EAZ -Xt ECX +Z EAX",
    "8.97": "-Yt EAZ +Xt EBZ -Yt EAX +Xt EBX -Yt EAY +X EBY",
    "8.98": "-Z EBX +Yt ECX -Z EBY +Yt ECY -Zt EBZ +Yt ECZ",
    "8.99": "-X ECY +Z EAY -Xt ECZ +Zt EAZ -Xt ECX +Z EAX",
    "8.100": "-Yt EAZ +Xt EBZ -Yt EAX +Xt EBX -Yt EAY +X EBY",
}


def not_as_the_rule(chain, sign):
    """Equation to the rotations whose printed term is not the rule's, times a sign."""
    x, y, z = 307.0, -211.0, 503.0
    xt, yt, zt = 17.0, -29.0, 163.0
    arms = {"x": x, "z": z, "X": x + xt, "Z": z + zt, "Xt": xt, "Yt": yt, "Zt": zt}
    wrong = {}
    for row, (number, text) in enumerate(ROTATIONS_AS_PRINTED.items()):
        terms = text.split()
        printed = {
            code: float(f"{arm[0]}1") * arms[arm[1:]] / 1000.0
            for arm, code in zip(terms[::2], terms[1::2], strict=True)
        }
        tool = NO_TOOL if number in ("8.86", "8.87", "8.88") else (xt, yt, zt)
        for code in (f"E{about}{axis}" for axis in "XYZ" for about in "ABC"):
            error_um, _ = constant_field(chain, {code: 1.0}).at([x, y, z], tool)
            if printed.get(code, 0.0) != pytest.approx(sign * error_um[0, row % 3], abs=1e-12):
                wrong.setdefault(number, set()).add(code)
    return wrong


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("chain", ["FXYZ", "XFYZ", "XYFZ", "XYZF"])
def test_the_printed_compensation_equations_are_of_no_configuration_of_the_chapter(chain, sign):
    wrong = not_as_the_rule(chain, sign)
    for first in (83, 86, 95, 98):
        assert wrong.keys() & {f"8.{first + row}" for row in range(3)}


def test_but_for_three_terms_they_are_fyxz_with_every_rotation_the_other_way():
    """8.83: +(z+Z_t)A_y(y), and Y_t A_x(z) for Y_t A_z(x). 8.95: +(z+Z_t)A_y(x)."""
    assert not_as_the_rule("FYXZ", -1.0) == {"8.83": {"EBY", "ECX", "EAZ"}, "8.95": {"EBX"}}


@pytest.mark.slow
def test_each_level_has_its_tables():
    field = random_field("XYFZ", NONRIGID, positions=4)
    counts = {level.level: len(level.tables) for level in compensation_levels(field, BOX)}
    assert counts == {
        Level.NOTHING: 0,
        Level.DISPLACEMENT: 3,
        Level.STRAIGHTNESS: 9,
        Level.ANGULAR: 18,
        Level.NONRIGID: 54,
    }
    tables = level_tables(field, BOX, Level.NONRIGID)
    assert all(COMPONENTS[code].axis for code in tables)


def test_squareness_is_folded_into_straightness_at_its_positions():
    """8.58: D_x(y) = D_x(y)(old) + S_xy·y, at the table's positions and the volume's ends."""
    field = ErrorField.make(
        Chain.parse("XYFZ"),
        {
            "EXY": Table([0.0, 100.0, 200.0], [0.0, 1.0, 5.0]),
            "SXY": Table((), 10.0),
            "SYZ": Table((), -20.0),
        },
    )
    tables = level_tables(field, BOX, Level.STRAIGHTNESS)
    assert sorted(tables) == ["EXY", "EYZ"]
    positions, values = tables["EXY"]
    assert positions.tolist() == [50.0, 100.0, 200.0, 400.0]
    np.testing.assert_allclose(values, [0.5 + 0.5, 1.0 + 1.0, 5.0 + 2.0, 5.0 + 4.0])
    positions, values = tables["EYZ"]
    assert positions.tolist() == [100.0, 300.0]
    np.testing.assert_allclose(values, [-2.0, -6.0])
    assert level_tables(field, BOX, Level.DISPLACEMENT) == {}


@pytest.mark.slow
def test_more_of_the_same_errors_are_left_in_proportion():
    field = random_field("XYFZ", NONRIGID, positions=4)
    twice = ErrorField.make(
        field.chain, {c: Table(p, 2.0 * v[0]) for c, (p, v) in field.tables.items()}
    )
    one, two = left_um(field), left_um(twice)
    for level in Level:
        assert two[level].rms_um == pytest.approx(2.0 * one[level].rms_um, abs=1e-9)


def test_levels_are_of_one_thermal_state_and_a_real_lattice():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table((), [[1.0], [2.0]])})
    for ask in (compensation_levels, lambda f, v: level_tables(f, v, Level.NOTHING)):
        with pytest.raises(InvalidContent, match="expected one thermal state"):
            ask(field, BOX)
    with pytest.raises(InvalidContent, match="points_per_axis: expected at least 2, got 1"):
        compensation_levels(random_field(), BOX, points_per_axis=1)


def test_the_largest_that_is_left_is_found_between_the_lattices_points():
    """EXX is 0 but for 9 µm at 37 mm, where no lattice of 3 has a point."""
    tables = {"EXX": Table([0.0, 36.0, 37.0, 38.0, 500.0], [0.0, 0.0, 9.0, 0.0, 0.0])}
    field = ErrorField.make(Chain.parse("XYFZ"), tables)
    nothing, displacement, *_ = compensation_levels(field, BOX, NO_TOOL, 3)
    assert (nothing.max_um, nothing.mean_um) == (9.0, 0.0)
    assert (displacement.max_um, displacement.within_um) == (0.0, 0.0)


def test_of_too_many_nodes_the_largest_is_of_the_lattice_and_says_so(monkeypatch):
    tables = {"EXX": Table([0.0, 36.0, 37.0, 38.0, 500.0], [0.0, 0.0, 9.0, 0.0, 0.0])}
    field = ErrorField.make(Chain.parse("XYFZ"), tables)
    monkeypatch.setattr(module, "MOST_POINTS_EACH", 10)
    nothing, *_ = compensation_levels(field, BOX, NO_TOOL, 3)
    assert (nothing.max_um, nothing.within_um) == (0.0, None)
