"""Maps of one machine, measured along different lines, are one machine again."""

import itertools

import numpy as np
import pytest

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLine
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable
from app.thermal.one_measuring_line import on_one_line
from tests.geometry.example_fields import LINES, NONRIGID, RIGID, codes_of, random_field
from tests.thermal.example_maps import error_map, machine, table

OTHER = {
    "x": MeasuringLine((0.0, 40.0, 380.0)),
    "y": MeasuringLine((310.0, 0.0, -25.0), (12.0, 0.0, 75.0)),
    "z": MeasuringLine((-60.0, 444.0, 0.0), (0.0, 0.0, 30.0)),
}
POINTS = np.random.default_rng(7).uniform(60.0, 440.0, (50, 3))
TOOL = (5.0, -20.0, 130.0)
CHAINS = ["FXYZ", "XFYZ", "XYFZ", "XYZF", "FYXZ"]


def as_map(label, field, t_c):
    tables = [
        ComponentTable.make(COMPONENTS[code], values[0], positions)
        for code, (positions, values) in field.tables.items()
    ]
    return error_map(label, t_c, *tables, lines=field.measuring_lines)


def as_field(chain, stored):
    tables = {c: Table(t.positions_mm, t.errors) for c, t in stored.tables.items()}
    return ErrorField.make(Chain.parse(chain), tables, stored.measuring_lines)


def measured_on(field, lines):
    """The same machine as instruments on these lines would map it, on dense positions."""
    dense = np.union1d(np.linspace(0.0, 500.0, 11), field.nodes_mm("x"))
    dense = np.union1d(np.union1d(dense, field.nodes_mm("y")), field.nodes_mm("z"))
    tables = dict(field.tables)
    for axis, line in lines.items():
        own = field.only(lambda c, axis=axis: c.axis == axis)
        points = np.tile(line.point_mm, (dense.size, 1))
        points[:, "xyz".index(axis)] = dense
        read = np.hstack([own.at(points, line.tool_offset_mm)[0], own.rotation_at(points)])
        for i, letter in enumerate("XYZABC"):
            tables[f"E{letter}{axis.upper()}"] = (dense, read[None, :, i])
    only_tables = {c: Table(p, v[0]) for c, (p, v) in tables.items()}
    return ErrorField.make(field.chain, only_tables, lines)


@pytest.mark.parametrize("kinds", [RIGID, NONRIGID], ids=["rigid", "nonrigid"])
@pytest.mark.parametrize("chain", CHAINS)
def test_a_machine_measured_along_two_sets_of_lines_is_the_same_machine(chain, kinds):
    field = random_field(chain, kinds, lines=LINES, positions=5)
    maps = [as_map("first", field, 20.0), as_map("second", measured_on(field, OTHER), 30.0)]
    (one, other), lines, notes = on_one_line(Chain.parse(chain), maps)
    assert one is maps[0]
    assert lines == LINES
    assert len(notes) == 3
    expected, turned = field.at(POINTS, TOOL)
    found, also_turned = as_field(chain, other).at(POINTS, TOOL)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(also_turned, turned, atol=1e-9)
    for code in codes_of({Kind.LINEAR, Kind.STRAIGHTNESS}):
        positions, values = field.tables[code]
        brought = other.tables[code]
        at_nodes = np.interp(positions, brought.positions_mm, brought.errors)
        np.testing.assert_allclose(at_nodes, values[0], atol=1e-9)


def test_by_hand_a_pitch_and_a_reflector_200_mm_higher():
    """XYFZ: E_x of x gains z EBX; 10 µrad at 0.2 m are 2 µm; backward 30 µrad are 6 µm."""
    tables = [
        table("EXX", [0.0, 5.0], [0.0, 500.0], [1.0, 6.0]),
        table("EBX", [10.0, 10.0], [0.0, 500.0], [30.0, 30.0]),
    ]
    low = error_map("low", 20.0, *tables, lines={"x": MeasuringLine((0.0, 0.0, 100.0))})
    high = error_map("high", 30.0, *tables, lines={"x": MeasuringLine((0.0, 0.0, 300.0))})
    (_, brought), lines, notes = on_one_line(Chain.parse("XYFZ"), [high, low])
    assert lines == {"x": high.measuring_lines["x"]}  # alike in time: the first by name
    assert brought.tables["EXX"].errors.tolist() == pytest.approx([2.0, 7.0])
    assert brought.tables["EXX"].backward_errors.tolist() == pytest.approx([7.0, 12.0])
    assert "'high'" in notes[0]
    assert "low" in notes[0]


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_the_order_of_the_maps_does_not_matter(order):
    field = random_field("XYFZ", RIGID, lines=LINES, positions=4)
    maps = [as_map(f"map {i}", field, 20.0 + i) for i in range(3)]
    maps[1] = as_map("map 1", measured_on(field, OTHER), 21.0)
    found, lines, _ = on_one_line(Chain.parse("XYFZ"), [maps[i] for i in order])
    by_label = {m.label: m for m in found}
    expected, _, _ = on_one_line(Chain.parse("XYFZ"), maps)
    assert lines == LINES
    for one in expected:
        for code, wanted in one.tables.items():
            np.testing.assert_array_equal(by_label[one.label].tables[code].errors, wanted.errors)


def test_a_map_that_states_no_line_is_brought_to_that_of_one_that_does():
    """Without a statement translations are free of the rotations: they gain them on the line."""
    tables = [table("EXX", [0.0, 0.0], [0.0, 500.0]), table("EBX", [10.0, 10.0], [0.0, 500.0])]
    free = error_map("free", 20.0, *tables)
    on_line = error_map("on a line", 30.0, *tables, lines={"x": MeasuringLine((0, 0, 300.0))})
    (brought, _), _, _ = on_one_line(Chain.parse("XYFZ"), [free, on_line])
    np.testing.assert_allclose(brought.tables["EXX"].errors, 3.0)


def test_without_rotations_the_translations_stay_and_it_is_said():
    maps = [
        error_map(f"at {z}", t, table("EXX", [1.0], [0]), lines={"x": MeasuringLine((0, 0, z))})
        for t, z in ((20.0, 100.0), (30.0, 300.0))
    ]
    found, _, notes = on_one_line(Chain.parse("XYFZ"), maps)
    assert [m.tables["EXX"].errors.tolist() for m in found] == [[1.0], [1.0]]
    assert "lack the rotations of x" in notes[1]


def test_a_rotation_that_differs_with_the_direction_makes_the_translation_differ_too():
    """XFYZ: E_x of x gains z EBX; 20 µrad at 0.2 m are 4 µm forward, −4 µm backward."""
    turn = table("EBX", [20.0, 20.0], [0.0, 500.0], [-20.0, -20.0])
    flat = table("EXX", [0.0, 0.0], [0.0, 500.0])
    on_line = error_map("a", 20.0, flat, turn, lines={"x": MeasuringLine((0, 0, 0), (0, 0, 200.0))})
    free = error_map("b", 30.0, flat, turn)
    (_, brought), _, _ = on_one_line(Chain.parse("XFYZ"), [on_line, free])
    assert brought.tables["EXX"].errors[[0, -1]].tolist() == pytest.approx([4.0, 4.0])
    assert brought.tables["EXX"].backward_errors[[0, -1]].tolist() == pytest.approx([-4.0, -4.0])


def test_what_an_axis_does_to_its_own_offset_is_followed_between_the_nodes():
    """XYFZ, EBX from −40 to 40 µrad over 500 mm: on a line E_z holds the parabola −x·EBX(x)."""
    tables = [table("EZX", [0.0, 0.0], [0.0, 500.0]), table("EBX", [-40.0, 40.0], [0.0, 500.0])]
    on_line = error_map("a", 20.0, *tables, lines={"x": MeasuringLine((0.0, 0.0, 0.0))})
    free = error_map("b", 30.0, *tables)
    (_, brought), _, _ = on_one_line(Chain.parse("XYFZ"), [on_line, free])
    x = np.linspace(0.0, 500.0, 101)
    found = np.interp(x, brought.tables["EZX"].positions_mm, brought.tables["EZX"].errors)
    expected = -x / 1000 * np.interp(x, [0.0, 500.0], [-40.0, 40.0])
    assert np.abs(found - expected).max() <= 10.0 / 64 + 1e-9


def test_rotations_that_were_measured_apart_need_no_line():
    """An autocollimator's map beside a laser's: a rigid body turns everywhere alike."""
    line = {"x": MeasuringLine((0.0, 250.0, 300.0))}
    maps = [
        error_map("laser", 20.0, table("EXX", [0.0, 5.0], [0.0, 500.0]), lines=line),
        error_map("autocollimator", 20.0, table("EBX", [0.0, 9.0], [0.0, 500.0])),
    ]
    found, lines, notes = on_one_line(Chain.parse("XYFZ"), maps)
    assert found[1] is maps[1]
    assert (lines, notes) == (line, [])


def test_maps_of_one_line_or_of_none_stay_as_they_are():
    for lines in (None, LINES):
        maps = [as_map(f"{t}", random_field("XYFZ", seed=t, lines=lines), t) for t in (20, 30)]
        found, shared, notes = on_one_line(Chain.parse("XYFZ"), maps)
        assert all(one is other for one, other in zip(found, maps, strict=True))
        assert (shared, notes) == (lines or {}, [])


def test_the_model_knows_its_line_and_says_what_was_brought_there():
    tables = [table("EXX", [0.0, 5.0], [0.0, 500.0]), table("EBX", [10.0, 10.0], [0.0, 500.0])]
    maps = [
        error_map(f"at {z}", t, *tables, lines={"x": MeasuringLine((0.0, 0.0, z))})
        for t, z in ((20.0, 100.0), (30.0, 300.0))
    ]
    model = compile_model(machine(), maps, {})
    assert model.measuring_lines == {"x": MeasuringLine((0.0, 0.0, 100.0))}
    assert any("are brought there" in note for note in model.notes)
    state = model.errors_at({"x-middle": 30.0})[0]
    assert state.values[state.members[0].forward].tolist() == pytest.approx([-2.0, 3.0])
