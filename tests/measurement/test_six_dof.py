"""Six errors at once: the model made of them off the axes, Hsu's second table, uncertainty."""

from itertools import permutations

import numpy as np
import pytest

from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLine
from app.geometry.volumetric_error import volumetric_error
from app.measurement.six_dof import evaluate_six_dof
from tests.geometry.example_fields import (
    LINES,
    RIGID,
    TOOL,
    codes_of,
    exact_position,
    values_at_one,
)

CHAINS = ["".join(p) for p in permutations("XYZF")]
POSITIONS = np.linspace(0.0, 500.0, 6)
UM_PER_MM = 1000.0

HOME = np.array([200.0, 300.0, 100.0])
"""Nodes of the tables, so that errors which are zero there are zero exactly there."""

THROUGH_HOME = {
    "x": MeasuringLine(tuple(HOME), (3.0, -5.0, 40.0)),
    "y": MeasuringLine(tuple(HOME), (0.0, 0.0, 75.0)),
    "z": MeasuringLine(tuple(HOME), (0.0, 0.0, 160.0)),
}


def machine_that_is_right_at_home(chain, seed=0):
    """Every component on the same nodes, zero at home; squareness counts from home too."""
    rng = np.random.default_rng(seed)
    tables = {}
    for code in codes_of(RIGID):
        component = COMPONENTS[code]
        if component.axis is None:
            continue
        values = rng.normal(scale=10.0, size=POSITIONS.size)
        at_home = np.interp(HOME["xyz".index(component.axis)], POSITIONS, values)
        tables[code] = Table(POSITIONS, values - at_home)
    # Squareness as the slope of the straightness that it is: it too is zero at home.
    for code, axis, slope in (("EXY", 1, 12.0), ("EXZ", 2, -7.0), ("EYZ", 2, 5.0)):
        positions, values = tables[code]
        tables[code] = Table(positions, values + slope * (positions - HOME[axis]) / 1000.0)
    return ErrorField.make(Chain.parse(chain), tables)


def walk(field, axis, line, own_errors_only=False):
    """What the instrument reads: exact motions of the machine, minus the reading at home.

    Nothing of the model's own rule: homogeneous transformations of all six errors of all
    axes, with the other axes standing on the line.
    """
    seen = field.only(lambda c: c.axis == axis) if own_errors_only else field
    i = "xyz".index(axis)
    points = np.tile(np.array(line.point_mm), (POSITIONS.size, 1))
    points[:, i] = POSITIONS
    at_home = np.array(line.point_mm)
    at_home[i] = HOME[i]
    chain = field.chain.text

    def position(point):
        exact = exact_position(chain, values_at_one(seen, point), point, line.tool_offset_mm)
        return (exact - point - line.tool_offset_mm) * UM_PER_MM

    moved = np.array([position(point) for point in points]) - position(at_home)
    turned = seen.rotation_at(points) - seen.rotation_at(at_home)
    return moved, turned


def evaluated(axis, line, moved, turned):
    i = "xyz".index(axis)
    return evaluate_six_dof(
        axis,
        POSITIONS,
        moved[:, i],
        {letter: moved[:, j] for j, letter in enumerate("xyz") if j != i},
        {letter: turned[:, j] for j, letter in enumerate("abc")},
        measuring_line_mm=line.point_mm,
        tool_offset_mm=line.tool_offset_mm,
    )


def model_of(chain, results):
    """What a map of the three measurements says: tables and measuring lines, put together."""
    tables = {
        table.component.code: Table(table.positions_mm, table.errors)
        for result in results
        for table in result.tables
    }
    lines = {axis: line for r in results for axis, line in r.measuring_lines.items()}
    assert set(lines) == set("xyz")
    assert len(tables) == 18
    return ErrorField.make(Chain.parse(chain), tables, lines)


def anywhere(n=40, seed=9):
    """At nodes of the tables: between them a straight line is not u · ω(u)."""
    return np.random.default_rng(seed).choice(POSITIONS, (n, 3))


@pytest.mark.parametrize("chain", CHAINS)
def test_three_axes_measured_through_home_predict_the_error_anywhere(chain):
    """Hsu III C: no offset inside the machine is known, and the model is right all the same.

    The lines pass through a home position away from the machine's zero, each with another
    tool; the rotations at home are zero. What is left is of second order, 1e-3 µm.
    """
    truth = machine_that_is_right_at_home(chain)
    results = [evaluated(u, line, *walk(truth, u, line)) for u, line in THROUGH_HOME.items()]
    points = anywhere()
    expected, turned = truth.at(points, TOOL)
    found, found_turned = model_of(chain, results).at(points, TOOL)
    np.testing.assert_allclose(found, expected, atol=5e-3)
    np.testing.assert_allclose(found_turned, turned, atol=1e-9)
    assert np.abs(expected).max() > 10.0


@pytest.mark.parametrize("chain", CHAINS)
def test_without_their_lines_the_same_readings_mispredict(chain):
    truth = machine_that_is_right_at_home(chain)
    results = [evaluated(u, line, *walk(truth, u, line)) for u, line in THROUGH_HOME.items()]
    aware = model_of(chain, results)
    unaware = ErrorField.make(
        aware.chain, {c: Table(p, v[0]) for c, (p, v) in aware.tables.items()}
    )
    points = anywhere()
    assert np.abs(unaware.at(points, TOOL)[0] - truth.at(points, TOOL)[0]).max() > 1.0


@pytest.mark.parametrize("chain", CHAINS)
def test_on_any_lines_it_is_right_where_only_the_moving_axis_errs(chain):
    """17-25 for lines that do not meet: each axis' own rotations are in its translations."""
    truth = machine_that_is_right_at_home(chain)
    results = [evaluated(u, line, *walk(truth, u, line, True)) for u, line in LINES.items()]
    points = anywhere()
    found, _ = model_of(chain, results).at(points, TOOL)
    np.testing.assert_allclose(found, truth.at(points, TOOL)[0], atol=5e-3)


@pytest.mark.parametrize("chain", CHAINS)
def test_axes_that_stand_turned_add_a_slope_to_what_the_moving_axis_reads(chain):
    """What Hsu leaves out, and the method's page states: lines that do not meet at home.

    An axis v that stands away from home is turned by ω_v. Where it acts on the moving axis
    u, each millimetre of travel is turned with it: the readings gain ω_v × (u − home) e_u.
    """
    truth = machine_that_is_right_at_home(chain)
    results = [evaluated(u, line, *walk(truth, u, line)) for u, line in LINES.items()]
    points = anywhere()
    found, _ = model_of(chain, results).at(points, TOOL)
    gained = np.zeros_like(found)
    for u, line in LINES.items():
        i = "xyz".index(u)
        for v in truth.chain.axes:
            if v != u and u in truth.chain.acts_on(v):
                own = truth.only(lambda c, v=v: c.axis == v)
                omega = own.rotation_at(np.array(line.point_mm))[0]
                arm = np.zeros((len(points), 3))
                arm[:, i] = (points[:, i] - HOME[i]) / 1000.0
                gained += np.cross(omega, arm)
    np.testing.assert_allclose(found - truth.at(points, TOOL)[0], gained, atol=5e-3)
    assert np.abs(gained).max() > 0.5


def test_between_positions_a_workpiece_side_axis_is_off_by_a_quarter_of_step_times_turn():
    """XFYZ: the reading in z contains −x EBX(x), which is no straight line between positions.

    A step of 100 mm over which the pitch grows by 20 µrad: 100·20/4 nm = 0.5 µm at its middle.
    """
    pitch = np.array([0.0, 20.0])
    truth = ErrorField.make(Chain.parse("XFYZ"), {"EBX": Table([0.0, 100.0], pitch)})
    points = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [50.0, 0.0, 0.0]])
    read = truth.at(points)[0]
    result = evaluate_six_dof(
        "x",
        [0.0, 100.0],
        straightness_um={"z": read[:2, 2]},
        angular_urad={"b": pitch},
        measuring_line_mm=[0.0, 0.0, 0.0],
    )
    tables = {t.component.code: Table(t.positions_mm, t.errors) for t in result.tables}
    model = ErrorField.make(truth.chain, tables, result.measuring_lines)
    left = (model.at(points)[0] - read)[:, 2]
    np.testing.assert_allclose(left, [0.0, 0.0, -0.5], atol=1e-12)


# [K] Table II, rows of rotations: gains of ΔX, ΔY, ΔZ and ΔI, ΔJ, ΔK. X_m … is the position of
# the axis, X_s and −Z_s where X and Z stood while Y was measured.
TABLE_II = {
    "EAX": lambda xm, zm, xs, zs: ([0, -zm, 0], [0, -1, 0]),
    "EBX": lambda xm, zm, xs, zs: ([zm, 0, 0], [1, 0, 0]),
    "ECX": lambda xm, zm, xs, zs: ([0, 0, 0], [0, 0, 0]),
    "EAY": lambda xm, zm, xs, zs: ([0, -(zs + zm), 0], [0, -1, 0]),
    "EBY": lambda xm, zm, xs, zs: ([zs + zm, 0, xs - xm], [1, 0, 0]),
    "ECY": lambda xm, zm, xs, zs: ([0, -(xs - xm), 0], [0, 0, 0]),
    "EAZ": lambda xm, zm, xs, zs: ([0, 0, 0], [0, -1, 0]),
    "EBZ": lambda xm, zm, xs, zs: ([0, 0, 0], [1, 0, 0]),
    "ECZ": lambda xm, zm, xs, zs: ([0, 0, 0], [0, 0, 0]),
}


@pytest.mark.parametrize("code", TABLE_II)
def test_hsus_second_table_falls_out(code):
    """FYXZ; X and Z measured with the other axes at home, Y with X at 0.12 m and Z at 0.31 m."""
    axis, about = code[2].lower(), code[1].lower()
    line = [120.0, 0.0, 310.0] if axis == "y" else [0.0, 0.0, 0.0]
    result = evaluate_six_dof(
        axis, POSITIONS, angular_urad={about: np.ones(6)}, measuring_line_mm=line
    )
    (table,) = result.tables
    found, turned = volumetric_error(
        Chain.parse("FYXZ"), {code: table.errors[:1]}, [[307.0, -211.0, 503.0]],
        measuring_lines=result.measuring_lines,
    )  # fmt: skip
    gains, direction = TABLE_II[code](0.307, 0.503, 0.120, -0.310)
    np.testing.assert_allclose(found[0], gains, atol=1e-15)
    np.testing.assert_allclose(turned[0], direction, atol=1e-15)


@pytest.mark.parametrize("letter", "xyz")
@pytest.mark.parametrize("axis", "xyz")
def test_hsus_translations_have_gain_one(axis, letter):
    """The other nine rows of Table II."""
    code = f"E{letter}{axis}".upper()
    read = {"linear_um": [1.0]} if letter == axis else {"straightness_um": {letter: [1.0]}}
    result = evaluate_six_dof(axis, [0.0], **read, measuring_line_mm=[1.0, 2.0, 3.0])
    (table,) = result.tables
    assert table.component.code == code
    found, _ = volumetric_error(
        Chain.parse("FYXZ"), {code: table.errors}, [[307.0, -211.0, 503.0]],
        measuring_lines=result.measuring_lines,
    )  # fmt: skip
    assert found[0].tolist() == [1.0 if u == letter else 0.0 for u in "xyz"]


def test_the_worked_example_by_hand():
    """docs/methods/six-dof.md: x of an XYFZ machine, read 100 mm above the table.

    At x = 500 mm the readings are EXX = 4 µm and EBX = 12 µrad. On the line the error is
    the 4 µm that were read; 150 mm above it 12·0.15 = 1.8 µm more.
    """
    result = evaluate_six_dof(
        "x",
        [0.0, 500.0],
        [0.0, 4.0],
        angular_urad={"b": [0.0, 12.0]},
        measuring_line_mm=[0.0, 250.0, 100.0],
    )
    tables = {t.component.code: Table(t.positions_mm, t.errors) for t in result.tables}
    field = ErrorField.make(Chain.parse("XYFZ"), tables, result.measuring_lines)
    found, _ = field.at([[500.0, 250.0, 100.0], [500.0, 0.0, 250.0]])
    assert found[0, 0] == pytest.approx(4.0)
    assert found[1, 0] == pytest.approx(4.0 + 1.8)


def test_the_tables_are_the_readings_of_both_directions():
    read = np.arange(18.0).reshape(3, 6)
    result = evaluate_six_dof(
        "y",
        POSITIONS,
        read[0],
        {"x": read[1]},
        {"c": read[2]},
        backward_linear_um=read[0] - 2.0,
        backward_angular_urad={"c": read[2] + 1.0},
    )
    found = {table.component.code: table for table in result.tables}
    assert list(found) == ["EXY", "EYY", "ECY"]
    np.testing.assert_allclose(found["EYY"].backward_errors, read[0] - 2.0)
    np.testing.assert_allclose(found["ECY"].backward_errors, read[2] + 1.0)
    assert found["EXY"].backward_errors is None
    assert result.figures["EYY_reversal_um"] == pytest.approx(2.0)
    assert result.figures["ECY_range_urad"] == pytest.approx(6.0)
    assert all(table.covariance is None for table in result.tables)


def test_readings_and_their_order_of_naming_do_not_meet_the_wrong_component():
    """Suspiciously small readings are noted under their own component's name."""
    result = evaluate_six_dof(
        "x", POSITIONS, angular_urad={"c": np.ones(6)}, straightness_um={"z": np.full(6, 0.01)}
    )
    assert any("the readings of EZX" in note for note in result.notes)


def test_stated_repeatabilities_serve_each_their_unit():
    result = evaluate_six_dof(
        "x",
        POSITIONS,
        np.zeros(6),
        angular_urad={"b": np.zeros(6)},
        repeatability_um=0.5,
        repeatability_urad=2.0,
    )
    linear, pitch = result.tables
    np.testing.assert_allclose(linear.covariance, 0.25 * np.eye(6))
    np.testing.assert_allclose(pitch.covariance, 4.0 * np.eye(6))


@pytest.mark.parametrize("line", ["end-points", "least-squares"])
def test_a_line_that_is_taken_out_takes_the_beams_slope_and_leaves_the_reversal(line):
    rng = np.random.default_rng(11)
    form, beam = rng.normal(size=6), 3.0 + 0.02 * POSITIONS
    plain, tilted = (
        evaluate_six_dof(
            "x",
            POSITIONS,
            straightness_um={"y": form + slope},
            backward_straightness_um={"y": form + slope - 2.5},
            straightness_line=line,
        )
        for slope in (0.0, beam)
    )
    np.testing.assert_allclose(tilted.tables[0].errors, plain.tables[0].errors, atol=1e-12)
    reversal = tilted.tables[0].errors - tilted.tables[0].backward_errors
    np.testing.assert_allclose(reversal, 2.5, atol=1e-12)
    middle = (plain.tables[0].errors + plain.tables[0].backward_errors) / 2
    if line == "end-points":
        assert middle[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)
    else:
        assert np.polyfit(POSITIONS, middle, 1) == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_line_leaves_linear_and_angular_readings_alone():
    read = {"linear_um": POSITIONS / 50.0, "angular_urad": {"a": POSITIONS / 10.0}}
    one = evaluate_six_dof("x", POSITIONS, **read)
    other = evaluate_six_dof("x", POSITIONS, **read, straightness_line="least-squares")
    for as_read, line in zip(one.tables, other.tables, strict=True):
        np.testing.assert_array_equal(as_read.errors, line.errors)


@pytest.mark.slow
@pytest.mark.parametrize("line", ["as-read", "end-points", "least-squares"])
@pytest.mark.parametrize("directions", [1, 2])
def test_the_stated_covariance_is_the_scatter_of_the_tables(line, directions):
    """Four runs, noise of 1 µm; 700 times across: 5 % on a variance."""
    rng = np.random.default_rng(12)
    form = 5.0 * np.sin(POSITIONS / 90.0)
    errors, stated = [], []
    for _ in range(350):
        runs = form + rng.normal(size=(directions, 2, 4, 6))
        way = [dict(zip("yz", both, strict=True)) for both in runs]
        tables = evaluate_six_dof(
            "x",
            POSITIONS,
            straightness_um=way[0],
            backward_straightness_um=way[1] if directions == 2 else None,
            straightness_line=line,
        ).tables
        errors += [table.errors for table in tables]
        stated += [table.covariance for table in tables]
    np.testing.assert_allclose(np.cov(np.array(errors).T), np.mean(stated, axis=0), atol=0.06)
    assert np.mean(stated, axis=0)[2, 2] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("line", ["as-read", "least-squares"])
@pytest.mark.parametrize("opposite", [False, True])
def test_what_both_directions_of_a_run_share_counts_once(line, opposite):
    """Shift and slope of a run in both directions, or opposite in them: a reversal that varies.

    The first goes with the line and the second stays; 700 times across, four runs: 5 % on
    a variance, and each measurement's own estimate is right on the average.
    """
    rng = np.random.default_rng(13)
    across = (POSITIONS - 100.0) / 200.0
    found, stated = [], []
    for _ in range(350):
        common = 3.0 * rng.normal(size=(2, 4, 1)) + 2.0 * rng.normal(size=(2, 4, 1)) * across
        forward, backward = rng.normal(size=(2, 2, 4, 6))
        backward = 0.5 * backward + (-common if opposite else common)
        tables = evaluate_six_dof(
            "x",
            POSITIONS,
            straightness_um=dict(zip("yz", forward + common, strict=True)),
            backward_straightness_um=dict(zip("yz", backward, strict=True)),
            straightness_line=line,
        ).tables
        found += [[table.errors, table.backward_errors] for table in tables]
        stated += [[table.covariance, table.backward_covariance] for table in tables]
    for way in (0, 1):
        scatter = np.cov(np.array(found)[:, way].T)
        mean = np.mean([both[way] for both in stated], axis=0)
        np.testing.assert_allclose(mean, scatter, atol=0.12 * np.diagonal(scatter).max())
        np.testing.assert_allclose(np.diagonal(mean) / np.diagonal(scatter), 1.0, atol=0.15)


def test_straightness_figures_are_iso_230_1s():
    """A step of 3 µm on a slope of 20 µm/m: the range about the least-squares line."""
    read = 0.02 * POSITIONS + np.array([0.0, 0.0, 0.0, 3.0, 3.0, 3.0])
    figures = evaluate_six_dof("x", POSITIONS, straightness_um={"z": read}).figures
    line = np.polyval(np.polyfit(POSITIONS, read, 1), POSITIONS)
    assert figures["EZX_straightness_um"] == pytest.approx(np.ptp(read - line))
    assert figures["EZX_slope_um_per_m"] == pytest.approx(1000 * np.polyfit(POSITIONS, read, 1)[0])


def test_what_the_reading_cannot_tell_is_noted():
    both = {"linear_um": np.zeros(6), "angular_urad": {"b": np.zeros(6)}}
    unstated = evaluate_six_dof("x", POSITIONS, **both)
    assert any("No measuring line is stated" in note for note in unstated.notes)
    stated = evaluate_six_dof("x", POSITIONS, **both, measuring_line_mm=[0, 0, 0])
    assert not any("No measuring line" in note for note in stated.notes)
    assert any("EAX, ECX not read" in note for note in stated.notes)
    sideways = evaluate_six_dof("x", POSITIONS, straightness_um={"y": np.zeros(6)})
    assert any("Straightness as read" in note for note in sideways.notes)


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        ({"axis": "c"}, "axis", "expected axis x, y or z, got 'c'"),
        ({"linear_um": None}, "linear_um", "at least one component, got none"),
        ({"linear_um": [1.0, 2.0]}, "linear_um", "runs of 6 readings in µm"),
        ({"positions_mm": POSITIONS[::-1]}, "positions_mm", "readings in the same order"),
        ({"straightness_um": {"x": np.zeros(6)}}, "straightness_um", "expected y, z .* got 'x'"),
        ({"angular_urad": {"d": np.zeros(6)}}, "angular_urad", "expected a, b, c .* got 'd'"),
        ({"angular_urad": {"ab": np.zeros(6)}}, "angular_urad", "expected a, b, c .* got 'ab'"),
        ({"angular_urad": {"a": [np.nan] * 6}}, "angular_urad.a", "got nan µrad"),
        ({"angular_urad": {"a": [2e4] * 6}}, "angular_urad.a", "within ±10000 µrad"),
        ({"straightness_um": {"y": [2e4] * 6}}, "straightness_um.y", "within ±10000 µm"),
        (
            {"backward_angular_urad": {"a": np.zeros(6)}},
            "linear_um",
            "read backward, got none of EAX",
        ),
        ({"measuring_line_mm": [1.0, 2.0]}, "measuring_line_mm", "x, y and z of a point in mm"),
        ({"measuring_line_mm": [1.0, np.nan, 2.0]}, "measuring_line_mm", "expected finite"),
        ({"straightness_line": "best"}, "straightness_line", "as-read or least-squares or end"),
        ({"repeatability_urad": np.nan}, "repeatability_urad", "got nan µrad"),
    ],
)
def test_bad_input_is_refused_by_the_field_that_is_to_blame(change, field, message):
    arguments = {"axis": "x", "positions_mm": POSITIONS, "linear_um": np.zeros(6)} | change
    with pytest.raises(InvalidContent, match=message) as refused:
        evaluate_six_dof(**arguments)
    assert refused.value.errors[0].field == field
