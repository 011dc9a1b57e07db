"""The field against the rule with np.interp, exact transformations, and itself in other shapes."""

import tracemalloc
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.errors import InvalidContent
from app.geometry import error_field
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.volumetric_error import volumetric_error
from tests.geometry.example_fields import (
    LINES,
    NONRIGID,
    RIGID,
    TOOL,
    codes_of,
    random_field,
    values_at,
)

CHAINS = ["".join(p) for p in permutations("XYZF")]


def random_points(n, low=-100.0, high=600.0, seed=7):
    """Inside the tables and outside."""
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


@pytest.mark.parametrize("lines", [None, LINES], ids=["axes", "lines"])
@pytest.mark.parametrize("chain", CHAINS)
def test_it_is_the_rule_with_one_np_interp_for_each_component(chain, lines):
    """All 18 motion errors, 3 squareness errors and 36 slopes, each on positions of its own."""
    field = random_field(chain, NONRIGID, lines=lines)
    points = random_points(300)
    expected = volumetric_error(field.chain, values_at(field, points), points, TOOL, lines)
    for found, wanted in zip(field.at(points, TOOL), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11)


def test_at_a_tables_own_positions_it_is_the_table_to_the_last_bit():
    for code in codes_of({Kind.LINEAR, Kind.STRAIGHTNESS}):
        rng = np.random.default_rng(3)
        positions, values = np.array([-40.0, 0.0, 33.3, 100.1, 499.9]), rng.normal(size=5)
        field = ErrorField.make(Chain.parse("XYFZ"), {code: Table(positions, values)})
        points = np.zeros((5, 3))
        points[:, "xyz".index(COMPONENTS[code].axis)] = positions
        errors, _ = field.at(points)
        np.testing.assert_array_equal(errors[:, "xyz".index(COMPONENTS[code].direction)], values)


def test_outside_a_table_its_end_values_hold():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table([0.0, 100.0], [1.0, 8.0])})
    errors, _ = field.at([[-50.0, 0, 0], [-1e8, 0, 0], [100.5, 0, 0], [1e8, 0, 0]])
    assert errors[:, 0].tolist() == [1.0, 1.0, 8.0, 8.0]


@pytest.mark.parametrize("tools", [TOOL, "each"])
def test_many_points_are_as_each_alone(tools, monkeypatch):
    """To the last bit, though the many are summed in pieces."""
    monkeypatch.setattr(error_field, "POINTS_AT_ONCE", 16)
    field = random_field("XYFZ", NONRIGID, lines=LINES)
    points = random_points(50)
    offsets = random_points(50, seed=8) if tools == "each" else np.broadcast_to(TOOL, (50, 3))
    together = field.at(points, offsets if tools == "each" else TOOL)
    for i in range(50):
        for all_points, alone in zip(together, field.at(points[i], offsets[i]), strict=True):
            np.testing.assert_array_equal(all_points[i], alone[0])


def test_several_states_are_as_each_alone():
    rng = np.random.default_rng(9)
    one = random_field("XFYZ", NONRIGID)
    factors = rng.uniform(0.5, 2.0, 3)
    tables = {c: Table(p, factors[:, None] * v) for c, (p, v) in one.tables.items()}
    tables["EXX"] = Table(one.tables["EXX"][0], one.tables["EXX"][1][0])  # the same in all
    together = ErrorField.make(one.chain, tables)
    points = random_points(40)
    errors, orientation = together.at(points, TOOL)
    assert errors.shape == orientation.shape == (3, 40, 3)
    assert together.rotation_at(points).shape == (3, 40, 3)
    for s, factor in enumerate(factors):
        alone = {c: Table(p, factor * v[0]) for c, (p, v) in one.tables.items()}
        alone["EXX"] = tables["EXX"]
        expected = ErrorField.make(one.chain, alone).at(points, TOOL)
        np.testing.assert_array_equal(errors[s], expected[0])
        np.testing.assert_array_equal(orientation[s], expected[1])


def test_a_single_value_is_a_table_that_does_not_depend_on_position():
    errors = {"EXX": 3.0, "EBY": -7.0, "SZX": 5.0, "EAY^x": 11.0}
    for positions in ((), [250.0]):
        tables = {
            code: Table(positions if COMPONENTS[code].axis else (), value)
            for code, value in errors.items()
        }
        field = ErrorField.make(Chain.parse("XYFZ"), tables)
        points = random_points(10)
        values = {code: np.float64(value) for code, value in errors.items()}
        expected, _ = volumetric_error(field.chain, values, points, TOOL)
        np.testing.assert_allclose(field.at(points, TOOL)[0], expected, rtol=1e-13)


def test_the_parts_of_a_field_add_up_to_it():
    field = random_field("XYZF", NONRIGID, lines=LINES)
    points = random_points(30)
    parts = [field.only(lambda c, kind=kind: c.kind is kind).at(points, TOOL)[0] for kind in Kind]
    np.testing.assert_allclose(sum(parts), field.at(points, TOOL)[0], atol=1e-10)


def test_nothing_known_is_no_error_and_rotary_locations_are_not_the_linear_axes():
    for tables in ({}, {"XOC": Table((), 10.0), "AOC": Table((), 10.0)}):
        errors, orientation = ErrorField.make(Chain.parse("XYFZ"), tables).at([[1.0, 2.0, 3.0]])
        assert errors.tolist() == orientation.tolist() == [[0.0, 0.0, 0.0]]


def test_a_lathe_has_two_axes_and_leaves_the_third_ones_errors_aside():
    """FZX: z carries x, so EBZ acts on the arm x: z is in error by −x·EBZ."""
    tables = {"EZZ": Table((), 3.0), "EBZ": Table([0.0, 400.0], [0.0, 10.0]), "EYY": Table((), 9.0)}
    errors, _ = ErrorField.make(Chain.parse("FZX"), tables).at([[100.0, 0.0, 400.0]])
    np.testing.assert_allclose(errors, [[0.0, 0.0, 3.0 - 0.1 * 10.0]])


def test_rotations_sum_without_arms_and_turn_the_tool():
    field = random_field("XYZF", NONRIGID)
    points = random_points(25)
    rotation = field.rotation_at(points)
    _, orientation = field.at(points, TOOL)
    expected = np.stack([rotation[:, 1], -rotation[:, 0], np.zeros(25)], axis=1)
    np.testing.assert_allclose(orientation, expected, rtol=1e-14)
    values = {c: v for c, v in values_at(field, points).items() if COMPONENTS[c].direction == "c"}
    by_hand = sum(
        v * (points[:, "xyz".index(COMPONENTS[c].times)] / 1000 if COMPONENTS[c].times else 1.0)
        for c, v in values.items()
    )
    np.testing.assert_allclose(rotation[:, 2], by_hand, atol=1e-11)


def test_nodes_are_the_union_of_positions_that_matter():
    tables = {
        "EXX": Table([0.0, 100.0], [0.0, 1.0]),
        "EAX": Table([0.0, 50.0, 120.0], [0.0, 1.0, 2.0]),
        "EYX": Table([77.0], [1.0]),
        "SXY": Table((), 1.0),
    }
    field = ErrorField.make(Chain.parse("XYFZ"), tables)
    assert field.nodes_mm("x").tolist() == [0.0, 50.0, 100.0, 120.0]
    assert field.nodes_mm("y").size == field.nodes_mm("z").size == 0


@pytest.mark.slow
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
    st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3),
)
def test_the_tool_is_one_more_arm_of_every_rotation(point, tool):
    """e(p; T) − e(p; 0) = Σω × T, in every chain the same."""
    for chain in ("FXYZ", "XYZF"):
        field = random_field(chain, NONRIGID)
        by_tool = field.at(point, tool)[0] - field.at(point)[0]
        omega = field.rotation_at(point)[0]
        expected = np.cross(omega, np.array(tool) / 1000.0)
        np.testing.assert_allclose(by_tool[0], expected, atol=1e-9)


def test_a_large_answer_needs_little_more_memory_than_itself():
    field = random_field("XYFZ", RIGID)
    points = random_points(200_000)
    field.at(points[:10], TOOL)
    tracemalloc.start()
    errors, orientation = field.at(points, TOOL)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2 * (errors.nbytes + orientation.nbytes)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"EXX": Table([0.0, 1.0], [1.0])}, r"expected 2 values in µm, .* shape \(1,\)"),
        ({"EXX": Table([0.0, 1.0], [[[1.0, 2.0]]])}, r"shape \(1, 1, 2\)"),
        ({"EXX": Table((), [1.0, 2.0])}, "expected 1 value in µm"),
        ({"EBX": Table([0.0, 1.0], [1.0, np.nan])}, "expected finite values in µrad"),
        ({"EXX": Table([0.0, np.inf], [1.0, 2.0])}, "EXX: expected finite numbers .* mm, got inf"),
        ({"EXX": Table([1.0, 0.0], [1.0, 2.0])}, r"increasing positions in mm.* \[1.0, 0.0\]"),
        ({"EXX": Table([0.0, 0.0], [1.0, 2.0])}, "at least 1e-06 mm apart"),
        ({"EXX": Table([[0.0, 1.0]], [[1.0, 2.0]])}, "increasing positions"),
        ({"EQQ": Table((), 1.0)}, "expected an error component's code, got 'EQQ'"),
        (
            {"EXX": Table((), [[1.0], [2.0]]), "EYY": Table((), [[1.0], [2.0], [3.0]])},
            r"expected one number of thermal states, got \[2, 3\]",
        ),
    ],
)
def test_what_is_no_table_is_refused(tables, message):
    with pytest.raises(InvalidContent, match=message):
        ErrorField.make(Chain.parse("XYFZ"), tables)


@pytest.mark.parametrize(
    ("points", "tool", "message"),
    [
        ([[1.0, 2.0]], TOOL, r"points_mm: expected points of 3 coordinates in mm, got 2"),
        (
            [[1.0, np.nan, 2.0]],
            TOOL,
            r"points_mm: expected finite .* got nan mm at index \[0, 1\]",
        ),
        ([[0.0, 0, 0], [1.0, 2.0, -np.inf]], TOOL, r"got -inf mm at index \[1, 2\]"),
        ([[1e10, 0, 0]], TOOL, r"within ±1e\+09 mm, got 1e\+10 mm"),
        ([[0.0, 0, 0]], [0.0, np.nan, 0.0], r"tool_offset_mm: .* got nan mm at index \[1\]"),
        ([[0.0, 0, 0]], [0.0, 1.0], r"one for each of 1 point, got an array of shape \(2,\)"),
        ([[0.0, 0, 0]] * 2, [TOOL] * 3, r"one for each of 2 points, .* \(3, 3\)"),
    ],
)
def test_points_and_tools_that_are_none_are_refused(points, tool, message):
    with pytest.raises(InvalidContent, match=message):
        random_field().at(points, tool)


def test_no_points_are_no_errors():
    errors, orientation = random_field().at(np.empty((0, 3)))
    assert errors.shape == orientation.shape == (0, 3)


def test_one_state_is_asked_for_where_one_is_meant():
    field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table((), [[1.0], [2.0]])})
    with pytest.raises(InvalidContent, match="expected one thermal state, got an axis of 2"):
        field.expect_one_state()
