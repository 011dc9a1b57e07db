"""What an export says beside its files, comparing, and temperature bands."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.controllers.bands import temperature_bands
from app.controllers.compare import compare
from app.controllers.curve import difference
from app.controllers.export import export
from app.controllers.format import Parsed
from app.controllers.grids import even_grid, even_positions
from app.controllers.read import read_files
from app.controllers.registry import FORMATS, format_named
from app.errors import InvalidContent
from tests.controllers.example_tables import curve, curves, error_table, options_for, read_back

TABLE = error_table(
    curve("EXX", [0.0, 100.0, 200.0], [2.0, 3.0, 8.0], [0.0, 2.0, 6.0]),
    curve("EYX", [0.0, 200.0], [0.0, 9.1]),
    curve("EBX", [0.0, 200.0], [0.0, 30.0]),
    curve("SXY", [], [-25.0]),
    ranges_mm={"x": (0.0, 200.0), "y": (0.0, 400.0)},
    sizes_um={"EBX": 12.0, "SXY": 10.0},
)


@pytest.mark.parametrize("name", FORMATS)
def test_every_component_is_held_or_its_size_is_said(name):
    found = export(format_named(name), TABLE, options_for(name))
    held = {one.code for one in found.loaded} | ({"SXY"} if format_named(name).folds else set())
    missing = {one.component for one in found.not_held if "has no table" in one.why}
    assert held | missing >= set(TABLE.curves)
    assert not held & missing
    sizes = {one.component: one.largest for one in found.not_held if one.component in missing}
    assert sizes == {code: TABLE.sizes_um[code] for code in missing}
    assert [one.largest for one in found.not_held] == sorted(sizes_of(found), reverse=True)


def sizes_of(found):
    return [one.largest for one in found.not_held]


def test_linuxcnc_holds_the_own_axis_alone():
    found = export(format_named("linuxcnc"), TABLE, options_for("linuxcnc", home_mm={"x": 100.0}))
    assert [(n.component, n.largest) for n in found.not_held] == [
        ("EBX", 12.0),
        ("SXY", 10.0),
        ("EYX", 9.1),
    ]
    assert any("steps by -3.0 µm at the first move after homing" in w for w in found.warnings)
    assert [(c.direction, c.expected_movement_um) for c in found.check] == [
        ("+", pytest.approx(-8.0)),
        ("-", pytest.approx(-6.0)),
    ]


NUMBERED = [
    ("linuxcnc", "Z is written as 2", 'joints={"x": 0, "z": 1}', {"joints": {"x": 0, "z": 1}}),
    (
        "siemens-cec",
        "Z is written as AX3",
        'axes={"x": "AX1", "z": "AX2"}',
        {"axes": {"x": "A1", "z": "A2"}},
    ),
    ("fanuc", "Z is written as 3", 'numbers={"x": 1, "z": 2}', {"numbers": {"x": 1, "z": 3}}),
    ("heidenhain", "Z is written as 3", 'columns={"x": 1, "z": 2}', {"columns": {"x": 1, "z": 2}}),
]


@pytest.mark.parametrize(("name", "written", "stated", "options"), NUMBERED)
def test_a_lathes_z_is_not_numbered_as_the_third_axis_without_a_word(
    name, written, stated, options
):
    z = curve("EZZ", [-300.0, -150.0, 0.0], [-9.0, -4.0, 0.0])
    mill = error_table(z)
    lathe = replace(mill, origin=replace(mill.origin, axes=("z", "x")))

    def told(table, **more):
        found = export(format_named(name), table, options_for(name, **more))
        return [w for w in found.warnings if "the machine has no Y" in w]

    (warning,) = told(lathe)
    assert written in warning
    assert stated in warning
    assert told(mill) == []
    assert told(lathe, **options) == []


def test_an_axis_before_the_absent_one_needs_no_word():
    x = error_table(curve("EXX", [0.0, 100.0, 200.0], [0.0, 3.0, 8.0]))
    lathe = replace(x, origin=replace(x.origin, axes=("z", "x")))
    found = export(format_named("linuxcnc"), lathe, options_for("linuxcnc"))
    assert not any("the machine has no" in w for w in found.warnings)


LATHE_OPTIONS = {name: stated for name, _, _, stated in NUMBERED}


@pytest.mark.parametrize("options", ["default", "advised"])
@pytest.mark.parametrize("name", FORMATS)
def test_what_would_move_an_axis_that_a_lathe_lacks_is_not_held(name, options):
    """EYX and EYZ are errors of a lathe, and nothing of it can move in Y."""
    controller = format_named(name)
    codes = ["EXX", "EYX", "EZX", "EYZ", "EZZ"]
    table = error_table(
        *(curve(code, [0.0, 100.0, 200.0], [0.0, 3.0, 5.0]) for code in codes),
        curve("SYZ", [], [30.0]),
        sizes_um={"EYX": 5.0, "EYZ": 5.0, "SYZ": 6.0},
        ranges_mm={"x": (0.0, 200.0), "z": (0.0, 200.0)},
    )
    lathe = replace(table, origin=replace(table.origin, axes=("z", "x")))
    stated = LATHE_OPTIONS.get(name, {}) if options == "advised" else {}
    found = export(controller, lathe, options_for(name, **stated))
    left = {one.component: one.why for one in found.not_held}
    for code in ("EYX", "EYZ", "SYZ"):
        assert left[code] == "the machine has no axis Y that could move so"
    assert {one.code for one in found.loaded} == {"EXX", "EZX", "EZZ"} & set(controller.holds)
    assert not any(check.moved_axis == "y" for check in found.check)
    read = read_back(name, found, options_for(name, **stated))
    assert not {"EYX", "EYZ", "EYY"} & set(read.curves)
    with pytest.raises(InvalidContent, match=r"EYX.*the machine has no axis Y"):
        export(controller, lathe, options_for(name, components=["EYX"]))


def test_each_joint_of_a_gantry_has_the_table():
    stated = {"x": [0, 1], "y": 2, "z": 3}
    options = options_for("linuxcnc", joints=stated)
    found = export(format_named("linuxcnc"), TABLE, options)
    (ini,) = [file.content for file in found.files if file.name == "thermap.ini"]
    for joint in (0, 1):
        assert f"[JOINT_{joint}]\nCOMP_FILE = x.comp\nCOMP_FILE_TYPE = 1\n" in ini
    assert read_back("linuxcnc", found, options).curves["EXX"].at(np.array([200.0])) == 8.0
    typed = options_for("linuxcnc", joints={"x": "0, 1", "y": "2"})
    assert typed.joints == {"x": (0, 1), "y": 2}
    for wrong in ([], [0, 0], [0, 16], "0;1", 1.5, True, [[0]], {"a": 1}):
        with pytest.raises(InvalidContent, match=r"options\.joints\.x: expected a joint from 0 to"):
            options_for("linuxcnc", joints={"x": wrong})
    with pytest.raises(InvalidContent, match="expected each joint once"):
        export(format_named("linuxcnc"), TABLE, options_for("linuxcnc", joints={"x": 0, "y": 0}))


def test_a_value_that_the_reader_would_refuse_is_not_written():
    """At the reference point the curve is 8 mm, so that its other end becomes −15 mm."""
    table = error_table(curve("EXX", [0.0, 500.0, 1000.0], [-7000.0, 0.0, 8000.0]))
    for name in ("siemens-enc-comp", "fagor"):
        with pytest.raises(InvalidContent, match="within ±10 mm in the file, got 15000 µm"):
            export(format_named(name), table, options_for(name, reference_mm={"x": 1000.0}))
        found = export(format_named(name), table, options_for(name, reference_mm={"x": 500.0}))
        assert read_back(name, found, options_for(name)).curves["EXX"].errors[0] == -7000.0


CROSSES = error_table(
    curve("EYY", [0.0, 100.0], [0.0, 2.0], [1.0, 4.0]),
    curve("EXY", [-100.0, 100.0], [4.0, 8.0], [0.0, 2.0]),
)


def test_fagors_crosses_are_the_mean_of_both_directions_and_0_at_machine_zero():
    controller, options = format_named("fagor"), options_for("fagor")
    found = export(controller, CROSSES, options)
    exy = next(one for one in found.loaded if one.code == "EXY")
    assert exy.errors == pytest.approx([-1.5, 1.5])
    assert exy.at(np.zeros(1)) == pytest.approx([0.0])
    (half,) = [one for one in found.not_held if "both directions" in one.why]
    assert (half.component, half.largest) == ("EXY", 3.0)
    compared = compare(controller, CROSSES, read_back("fagor", found, options), options)
    assert [one.largest for one in compared.components] == pytest.approx([0.0, 0.0])


def test_a_motor_that_steps_when_cec_begins_to_act_is_warned_of():
    def steps(**options):
        found = export(format_named("siemens-cec"), TABLE, options_for("siemens-cec", **options))
        return [w for w in found.warnings if "steps by" in w]

    (warning,) = steps()
    assert "the motor of x steps by -2.0 µm as soon as the tables act" in warning
    assert "(X 0 mm, Y 0 mm) is not 0" in warning
    x, y = steps(home_mm={"x": 200.0, "y": 400.0})
    # EXX 8 µm and EXY −10 µm: forward they take part of each other away, backward 6 − 10.
    assert "x steps by 4.0 µm" in x
    assert "y steps by -9.1 µm" in y


def test_squareness_is_folded_into_straightness_over_the_whole_axis():
    found = export(format_named("siemens-cec"), TABLE, options_for("siemens-cec"))
    exy = next(one for one in found.loaded if one.code == "EXY")
    assert exy.at(np.array([0.0, 400.0])) == pytest.approx([0.0, -10.0])
    assert "SXY" not in {one.component for one in found.not_held}


def test_one_table_for_both_directions_leaves_half_the_reversal():
    found = export(format_named("heidenhain"), TABLE, options_for("heidenhain"))
    (half,) = [n for n in found.not_held if "both directions" in n.why]
    assert (half.component, half.largest) == ("EXX", 1.0)
    exx = next(one for one in found.loaded if one.code == "EXX")
    assert exx.at(np.array([0.0]))[0] == pytest.approx(1.0, abs=0.01)


def test_a_format_that_is_zero_at_its_reference_says_what_constant_is_left():
    found = export(format_named("fagor"), TABLE, options_for("fagor", reference_mm={"x": 100.0}))
    exx = next(one for one in found.loaded if one.code == "EXX")
    assert exx.errors == pytest.approx([-1.0, 0.0, 5.0])
    assert exx.backward_errors == pytest.approx([-3.0, -1.0, 3.0])
    constants = {n.component: n.largest for n in found.not_held if "shift" in n.why}
    assert constants == {"EXX": pytest.approx(3.0)}


def test_a_sign_that_nobody_verified_is_warned_of():
    unverified = export(format_named("fanuc"), TABLE, options_for("fanuc"))
    assert any("the sign is not verified" in warning for warning in unverified.warnings)
    verified = export(format_named("linuxcnc"), TABLE, options_for("linuxcnc"))
    assert not any("the sign is not verified" in warning for warning in verified.warnings)


@given(wanted=curves("EXX"), most=st.integers(3, 200))
def test_a_grid_covers_the_curve_with_no_more_points_than_allowed(wanted, most):
    grid = even_positions(wanted.positions_mm, most, None, "spacing_mm")
    assert 2 <= grid.size <= most
    assert grid[0] <= wanted.positions_mm[0] + 1e-9
    assert grid[-1] >= wanted.positions_mm[-1] - 1e-9
    assert np.abs(np.diff(grid) - (grid[1] - grid[0])).max() < 1e-5


@given(wanted=curves("EXX"), at=st.floats(-900, 1500))
def test_no_place_is_further_off_than_what_is_said(wanted, at):
    low, high = wanted.positions_mm[[0, -1]]
    held = wanted.sampled(even_grid(float(low), float(high), 37.0, 11.0))
    stated = difference(held, wanted)
    where = np.array([min(max(at, low), high)])
    for direction in "+-":
        off = held.at(where, direction) - wanted.at(where, direction)
        assert abs(off[0]) <= abs(stated.largest) + 1e-9
    assert stated.rms <= abs(stated.largest) + 1e-9


# -- comparing ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
def test_what_was_just_exported_differs_by_resampling_alone(name):
    controller, options = format_named(name), options_for(name)
    found = export(controller, TABLE, options)
    compared = compare(controller, TABLE, read_back(name, found, options), options)
    stated = {one.component: one.largest_deviation for one in found.resampling}
    both = {c.component: c.largest for c in compared.components if c.state == "both"}
    assert set(both) == set(stated)
    for code, largest in both.items():
        assert abs(largest) <= stated[code] + 1e-5


def test_stale_forgotten_and_unknown_tables_are_found():
    controller, options = format_named("siemens-cec"), options_for("siemens-cec")
    old = error_table(
        curve("EXX", [0.0, 100.0, 200.0], [2.0, 3.0, 3.0], [0.0, 2.0, 1.0]),
        curve("EZX", [0.0, 200.0], [0.0, 4.0]),
        ranges_mm=TABLE.ranges_mm,
    )
    held = read_back("siemens-cec", export(controller, old, options), options)
    found = {c.component: c for c in compare(controller, TABLE, held, options).components}
    assert {code: one.state for code, one in found.items()} == {
        "EXX": "both",
        "EYX": "missing",
        "EXY": "missing",
        "EZX": "unknown",
    }
    assert found["EXX"].largest == pytest.approx(-5.0)
    assert found["EXX"].position_mm == 200.0
    assert found["EYX"].largest == pytest.approx(-9.1)
    assert found["EXY"].largest == pytest.approx(10.0)
    assert found["EZX"].largest == pytest.approx(4.0)
    assert [abs(c.largest) for c in found.values()] == sorted(
        (abs(c.largest) for c in found.values()), reverse=True
    )


def test_a_sign_that_is_wrong_shows_as_twice_the_error():
    controller = format_named("fanuc")
    written = export(controller, TABLE, options_for("fanuc", sign="error"))
    wrong = options_for("fanuc", sign="compensation")
    found = compare(controller, TABLE, read_back("fanuc", written, wrong), wrong)
    eyx = next(c for c in found.components if c.component == "EYX")
    assert eyx.largest == pytest.approx(-18.2, abs=1.1)


def test_another_machines_files_are_refused():
    controller, options = format_named("linuxcnc"), options_for("linuxcnc")
    with pytest.raises(InvalidContent, match="files of machine 'mcfv5050', got those of 'lathe'"):
        compare(controller, TABLE, Parsed({}, machine="lathe"), options)
    far = Parsed({"EXX": curve("EXX", [3000.0, 4000.0], [0.0, 1.0])})
    with pytest.raises(InvalidContent, match="within the axis' 0 to 200 mm"):
        compare(controller, TABLE, far, options)


@pytest.mark.parametrize("name", FORMATS)
def test_files_say_themselves_how_they_were_written(name):
    """Whoever compares need not know the options, and cannot state others."""
    controller = format_named(name)
    options = options_for(name, components=["EXX"])
    found = export(controller, TABLE, options)
    stated, read = read_files(controller, found.files, {})
    compared = compare(controller, TABLE, read, stated)
    assert [one.component for one in compared.components] == ["EXX"]
    assert not any("do not say of which machine" in w for w in compared.warnings)
    for option, value in DIFFERENT.get(name, {}).items():
        with pytest.raises(
            InvalidContent, match=rf"options\.{option}: expected .* says that it was"
        ):
            read_files(controller, found.files, {option: value})
    with pytest.raises(InvalidContent, match=r"options\.components: expected \['EXX'\]"):
        read_files(controller, found.files, {"components": ["EYY"]})


DIFFERENT = {
    "linuxcnc": {"linear_units": "inch", "type": 0, "joints": {"x": 1}},
    "siemens-cec": {"sign": "compensation", "axes": {"x": "X1"}},
    "siemens-enc-comp": {"encoder": 1, "axes": {"x": "AX1"}},
    "siemens-temperature": {"sign": "error"},
    "fanuc": {"sign": "compensation", "detection_unit_um": 0.1, "numbers": {"x": 2}},
    "heidenhain": {"sign": "error", "columns": {"x": 2}},
    "mdsi": {"sign": "compensation", "counts_per_mm": 1000.0},
}


def test_files_of_an_inch_machine_are_compared_without_stating_it():
    controller = format_named("linuxcnc")
    found = export(controller, TABLE, options_for("linuxcnc", linear_units="inch"))
    files = [file for file in found.files if file.name in ("x.comp", "thermap.ini")]
    stated, read = read_files(controller, files, {})
    (exx,) = compare(controller, TABLE, read, stated).components
    assert abs(exx.largest) < 1e-3
    assert read.warnings == []


def test_files_that_name_no_machine_or_two_are_seen():
    controller, options = format_named("fanuc"), options_for("fanuc")
    dat, check = export(controller, TABLE, options).files
    _, alone = read_files(controller, [dat], {"sign": "error"})
    assert any("do not say of which machine" in w
               for w in compare(controller, TABLE, alone, options).warnings)  # fmt: skip
    other = replace(check, content=check.content.replace("machine mcfv5050", "machine lathe"))
    _, foreign = read_files(controller, [dat, other], {})
    with pytest.raises(InvalidContent, match="machine 'mcfv5050', got those of 'lathe'"):
        compare(controller, TABLE, foreign, options)
    two = [dat, check, replace(other, name="b/thermap-check.txt")]
    with pytest.raises(InvalidContent, match="files of one machine, got mcfv5050 and lathe"):
        read_files(controller, two, {})
    signs = replace(check, name="b/thermap-check.txt", content=check.content.replace(
        'sign = "error"', 'sign = "compensation"'))  # fmt: skip
    with pytest.raises(InvalidContent, match="were written with different options"):
        read_files(controller, [dat, check, signs], {})
    for damaged in ('"error', "[" * 3000, '"' + "e" * 5000 + '"'):
        broken = replace(check, content=check.content.replace('"error"', damaged))
        with pytest.raises(InvalidContent, match="the option sign as it was written, in JSON"):
            read_files(controller, [dat, broken], {})


# -- temperature bands -------------------------------------------------------------------------


def growing(temperatures_c):
    """EXX grows by 2 µm/K up to 30 °C and by 5 µm/K beyond; EYX by 1 µm/K of the other sensor."""
    t, other = temperatures_c["x-middle"], temperatures_c["spindle"]
    end = 2.0 * (min(t, 30.0) - 20.0) + 5.0 * max(t - 30.0, 0.0)
    return {
        "EXX": curve("EXX", [0.0, 500.0], [0.0, end]),
        "EYX": curve("EYX", [0.0, 500.0], [0.0, other - 20.0]),
    }


@pytest.mark.parametrize("step", [1.0, 3.0, 7.5, 100.0])
def test_no_band_steps_by_more_than_is_stated(step):
    cold, hot = {"x-middle": 20.0, "spindle": 20.0}, {"x-middle": 40.0, "spindle": 30.0}
    bands = temperature_bands(growing, cold, hot, step)
    assert len(bands) == int(np.ceil(70.0 / step))  # 20 µm and then 50 µm of EXX
    assert bands[0].from_c == pytest.approx(cold)
    assert bands[-1].to_c == pytest.approx(hot)
    ends = [growing(band.at_c) for band in bands]
    for before, after in pairwise(ends):
        for code in before:
            change = after[code].errors[-1] - before[code].errors[-1]
            assert abs(change) <= step * (1 + 1e-6)
    for before, after in pairwise(bands):
        assert before.to_c == pytest.approx(after.from_c)
    for band in bands:
        for end in (band.from_c, band.to_c):
            off = growing(end)["EXX"].errors[-1] - growing(band.at_c)["EXX"].errors[-1]
            assert abs(off) <= step / 2 + 1e-6


def test_a_range_in_which_nothing_changes_is_one_band():
    still = {"x-middle": 25.0, "spindle": 25.0}
    (band,) = temperature_bands(growing, still, still, 1.0)
    assert band.at_c == still


def test_too_many_bands_and_other_sensors_are_refused():
    with pytest.raises(InvalidContent, match=r"which needs 700 for a change of 70\.0 µm"):
        temperature_bands(
            growing, {"x-middle": 20.0, "spindle": 20.0}, {"x-middle": 40.0, "spindle": 30.0}, 0.1
        )
    with pytest.raises(InvalidContent, match="expected the sensors"):
        temperature_bands(growing, {"x-middle": 20.0}, {"spindle": 30.0}, 1.0)


def test_components_are_listed_as_a_command_line_lists_them():
    listed = options_for("linuxcnc", components=["EXX", "EYY"])
    assert options_for("linuxcnc", components="EXX, EYY") == listed
