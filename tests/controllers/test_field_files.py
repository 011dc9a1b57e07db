"""Files as users have them: what the control would read is read, the rest is named or refused."""

from pathlib import Path

import numpy as np
import pytest

from app.controllers.format import ControllerFile
from app.controllers.read import read_files
from app.controllers.registry import format_named
from app.errors import InvalidContent

CASES = Path(__file__).parent / "cases"


def case(folder, *names):
    return [
        ControllerFile(name, (CASES / folder / name).read_bytes().decode())
        for name in names or sorted(path.name for path in (CASES / folder).iterdir())
    ]


def read(controller, files, **stated):
    return read_files(format_named(controller), files, stated)[1]


def refused(controller, files, match, **stated):
    with pytest.raises(InvalidContent, match=match):
        read(controller, files, **stated)


def changed(files, old, new):
    assert any(old in file.content for file in files)
    return [ControllerFile(file.name, file.content.replace(old, new)) for file in files]


# -- LinuxCNC ----------------------------------------------------------------------------------

INCH = case("linuxcnc-ini-inch")
GANTRY = case("linuxcnc-gantry-ini")
OLD = case("linuxcnc-axis-sections")


@pytest.mark.parametrize("units", ["inch", "in", "imperial", "Inch"])
def test_the_unit_is_that_of_the_ini(units):
    found = read("linuxcnc", changed(INCH, "= inch", f"= {units}"))
    exx = found.curves["EXX"]
    assert exx.positions_mm == pytest.approx([0.0, 152.4, 304.8])
    assert exx.errors == pytest.approx([0.0, -5.08, 7.62])
    assert exx.backward_errors == pytest.approx([0.0, -10.16, 2.54])
    assert found.warnings == []


def test_an_option_that_contradicts_the_ini_is_refused():
    refused("linuxcnc", INCH, r"options\.linear_units: expected 'inch', as .*mill\.ini says, got "
            "'mm'", linear_units="mm")  # fmt: skip
    refused("linuxcnc", INCH, r"options\.type: expected 1, as COMP_FILE_TYPE of joint 0", type=0)
    refused("linuxcnc", INCH, r"options\.joints\.x: expected \[0\], as coordinates=XYZ",
            joints={"x": 1})  # fmt: skip
    read("linuxcnc", INCH, linear_units="inch", type=1, joints={"x": 0})
    refused("linuxcnc", changed(INCH, "= inch", "= furlong"), "LINEAR_UNITS of mm, metric, inch")


def test_a_whole_ini_is_read_and_two_values_of_one_setting_are_refused():
    whole = changed(INCH, "[TRAJ]", "[HAL]\nHALFILE = a.hal\nHALFILE = b.hal\n; x = 1\n[TRAJ]")
    assert read("linuxcnc", whole).warnings == []
    twice = changed(INCH, "LINEAR_UNITS = inch", "LINEAR_UNITS = inch\nLINEAR_UNITS = mm")
    refused("linuxcnc", twice, r"line \d+: expected one LINEAR_UNITS of \[TRAJ\]")
    # Of an axis that the machine does not have an option says nothing.
    lathe = changed(INCH, "COORDINATES = X Y Z", "COORDINATES = X Z")
    assert list(read("linuxcnc", lathe, joints={"x": 0, "y": 2, "z": 1}).curves) == ["EXX"]


def test_a_unit_and_type_that_nothing_states_are_named():
    found = read("linuxcnc", case("linuxcnc-text-after-numbers"))
    (assumed,) = [w for w in found.warnings if "not stated" in w]
    assert "COMP_FILE_TYPE of x.comp is read as 1, LINEAR_UNITS as mm" in assumed
    stated = read("linuxcnc", case("linuxcnc-text-after-numbers"), type=1, linear_units="mm")
    assert not any("not stated" in w for w in stated.warnings)


def test_joints_of_a_gantry_with_different_tables_are_no_error_of_an_axis():
    refused("linuxcnc", GANTRY, r"all joints of Y \(coordinates=XYYZ of router\.ini\), got EYY of "
            r"joint 1 \(left\.comp\) -10 µm, joint 2 \(right\.comp\) -14 µm at 400 mm")  # fmt: skip
    same = read("linuxcnc", changed(GANTRY, "0.014", "0.010"))
    assert list(same.curves) == ["EYY"]
    assert same.curves["EYY"].errors == pytest.approx([0.0, -10.0])
    assert same.warnings == []


@pytest.mark.parametrize(
    ("kinematics", "axes"),
    [
        ("KINEMATICS = trivkins coordinates=xzzy", {"EZZ"}),
        ("KINEMATICS = trivkins", {"EYY", "EZZ"}),
        ("KINEMATICS = trivkins coordinates=XYA", {"EYY"}),
        ("", {"EYY"}),  # [TRAJ] COORDINATES = XYYZ
    ],
)
def test_the_axis_of_a_joint_is_that_of_the_coordinates(kinematics, axes):
    stated = changed(GANTRY, "KINEMATICS = trivkins coordinates=XYYZ kinstype=BOTH", kinematics)
    assert set(read("linuxcnc", changed(stated, "0.014", "0.010")).curves) == axes


def test_a_joint_of_a_rotary_axis_is_left_aside_and_one_without_an_axis_refused():
    rotary = changed(GANTRY, "coordinates=XYYZ", "coordinates=XYAZ")
    assert read("linuxcnc", rotary).warnings == [
        "left aside: right.comp: it is of axis A, and only X, Y and Z are read"
    ]
    refused("linuxcnc", changed(GANTRY, "coordinates=XYYZ", "coordinates=XY"),
            "joints 0 to 1 for coordinates=XY, got joint 2")  # fmt: skip
    other = changed(GANTRY, "trivkins coordinates=XYYZ", "genhexkins")
    refused("linuxcnc", other, "says the axis of joint 1, or options.joints; got genhexkins")
    stated = read("linuxcnc", other, joints={"y": 1, "z": 2})
    assert set(stated.curves) == {"EYY", "EZZ"}


def test_a_joint_of_an_axis_without_a_table_is_named():
    one_side = changed(GANTRY, "[JOINT_2]\nCOMP_FILE = right.comp\nCOMP_FILE_TYPE = 1\n", "")
    found = read("linuxcnc", one_side)
    assert found.curves["EYY"].errors == pytest.approx([0.0, -10.0])
    assert any("joint 2 moves Y too" in warning for warning in found.warnings)
    assert any("right.comp: no joint of router.ini has it" in w for w in found.warnings)
    missing = read("linuxcnc", GANTRY[:1] + GANTRY[2:])
    assert any("right.comp of joint 2: the file is not among" in w for w in missing.warnings)


def test_a_file_that_the_ini_does_not_load_is_not_read():
    off = changed(INCH, "COMP_FILE = screwx.dat", "#COMP_FILE = screwx.dat")
    refused("linuxcnc", off, "left aside: screwx.dat: no joint of mill.ini has it as its COMP_FILE")


def test_numbered_axis_sections_are_those_of_joints():
    ezz = read("linuxcnc", OLD).curves["EZZ"]
    assert ezz.errors == pytest.approx([0.0, 2.0, -3.0])
    assert ezz.backward_errors == pytest.approx([0.0, 4.0, -1.0])
    # Up to 2.7 the number is that of the axis, whatever COORDINATES lists.
    lathe = changed(OLD, "[TRAJ]", "[TRAJ]\nCOORDINATES = X Z")
    assert set(read("linuxcnc", lathe).curves) == {"EZZ"}


def test_trims_that_are_positions_are_refused_however_short_the_axis():
    trims = changed(OLD, "COMP_FILE_TYPE = 0", "COMP_FILE_TYPE = 1")
    refused("linuxcnc", trims, "nearer to the nominal positions: are these positions of type 0?")
    refused("linuxcnc", changed(INCH, "COMP_FILE_TYPE = 1", "COMP_FILE_TYPE = 0"),
            "nearer to 0: are these trims of type 1?")  # fmt: skip


def test_text_behind_three_numbers_is_passed_over_as_in_the_control():
    found = read("linuxcnc", case("linuxcnc-text-after-numbers"))
    assert found.curves["EXX"].errors == pytest.approx([0.0, -1.0, -3.0])
    assert found.curves["EXX"].backward_errors == pytest.approx([0.0, -2.0, -4.0])
    assert "what stands behind the third number of a line is not read" in found.warnings[0]
    comma = [ControllerFile("x.comp", "0 0 0,5\n")]
    refused("linuxcnc", comma, "or reads less than what stands there")
    for name in ("xy.comp", "yz.comp"):
        refused("linuxcnc", [ControllerFile(name, "0 0 0\n")], "the name of an axis")


# -- Fanuc -------------------------------------------------------------------------------------

BIDIRECTIONAL = case("fanuc-bidirectional")


def test_both_directions_of_fanuc_are_read():
    found = read("fanuc", BIDIRECTIONAL, sign="error", interval_unit_um=1.0)
    exx = found.curves["EXX"]
    at = np.array([0.0, 50.0, 100.0])
    assert exx.at(at).tolist() == [0.0, 2.0, 3.0]
    assert exx.at(at, "-").tolist() == [-3.0, -4.0, -6.0]
    assert any("parameter 1006 of axis 1 is not in the file" in w for w in found.warnings)
    returns = changed(BIDIRECTIONAL, "N3605", "N1006Q1A1P00100000\nN3605")
    exx = read("fanuc", returns, sign="error", interval_unit_um=1.0).curves["EXX"]
    assert exx.at(at).tolist() == [-3.0, -1.0, 0.0]
    assert exx.at(at, "-").tolist() == [0.0, -1.0, -3.0]


def test_a_table_of_the_other_direction_that_does_not_act_is_left_aside():
    off = changed(BIDIRECTIONAL, "P00000001", "P00000000")
    found = read("fanuc", off, sign="error")
    assert found.curves["EXX"].backward_errors is None
    assert any("switched off by bit 0 of parameter 3605" in w for w in found.warnings)
    refused("fanuc", changed(BIDIRECTIONAL, "N3605Q1A1P00000001\n", ""),
            "N3605 of axis 1, which says whether", sign="error")  # fmt: skip
    refused("fanuc", changed(BIDIRECTIONAL, "N3626Q1A1P160\n", ""), "N3626 of axis 1",
            sign="error")  # fmt: skip
    refused("fanuc", changed(BIDIRECTIONAL, "N10162P-2\n", ""), "a value N10162", sign="error")


DUMP = case("fanuc-whole-dump")


def test_a_whole_parameter_file_is_read():
    found = read("fanuc", DUMP, sign="error", interval_unit_um=1.0)
    at = np.array([0.0, 50.0])
    assert found.curves["EXX"].at(at).tolist() == [0.0, 2.0]
    assert found.curves["EYY"].at(at).tolist() == [0.0, -1.0]
    assert found.warnings == []
    blocks = [ControllerFile("D.TXT", DUMP[0].content.replace("\n", ";\r\n").replace("%;", "%"))]
    assert read("fanuc", blocks, sign="error").curves["EYY"].at(at).tolist() == [0.0, -1.0]


@pytest.mark.parametrize(("old", "new", "parameter"), [
    ("N03623Q1A1P1A2P1", "N03623Q1A1P1A2P0", 3623),
    ("P50000A2P50000", "P50000A2P0", 3624),
])  # fmt: skip
def test_an_axis_whose_parameters_switch_it_off_is_left_aside(old, new, parameter):
    found = read("fanuc", changed(DUMP, old, new), sign="error")
    assert list(found.curves) == ["EXX"]
    why = f"axis 2 of CNC-PARA.TXT: switched off by parameter {parameter}, which is 0"
    assert any(why in warning for warning in found.warnings)


def test_an_axis_that_is_none_of_ours_is_left_aside():
    found = read("fanuc", DUMP, sign="error", numbers={"x": 2, "z": 3})
    assert list(found.curves) == ["EXX"]
    assert any("axis 1 of CNC-PARA.TXT: it is none of the axes" in w for w in found.warnings)


def test_an_interval_with_a_decimal_point_is_in_mm():
    real = case("fanuc-real-interval")
    found = read("fanuc", real, sign="error")
    assert found.curves["EXX"].at(np.array([0.0, 50.0])).tolist() == [0.0, 2.0]
    assert found.warnings == []
    whole = read("fanuc", changed(real, "P50.0", "P50000"), sign="error")
    assert whole.curves["EXX"].at(np.array([0.0, 50.0])).tolist() == [0.0, 2.0]
    assert any("no decimal point and is read in units of 1 µm" in w for w in whole.warnings)


# -- Siemens -----------------------------------------------------------------------------------

LOAD, OFF = ([file] for file in case("siemens-switching-lines"))
(STOPPED, ENCODER) = case("siemens-m0-before-m17")
SETTINGS = case("siemens-line-checksums")
CURVE = pytest.approx([0.0, 1.2, 2.1])


@pytest.mark.parametrize("stop", ["M0", "M1", "m00", "M01", "N90 M0", "STOPRE", "G4 F2", "M30"])
def test_a_stop_and_a_second_end_change_nothing(stop):
    files = changed([STOPPED], "\nM0\n", f"\n{stop}\n")
    found = read("siemens-cec", files, sign="error")
    assert found.curves["EXX"].errors == CURVE
    assert found.warnings == []
    tail = [ControllerFile("a.spf", files[0].content + "$AN_CEC[0,2]=0.5\n")]
    refused("siemens-cec", tail, "nothing after the end of the program", sign="error")


def test_encoder_compensation_with_stops_is_read():
    found = read("siemens-enc-comp", [ENCODER], encoder=1, axes={"x": "X"})
    assert found.curves["EXX"].errors == pytest.approx([0.0, 1.2])
    other = read("siemens-enc-comp", [ENCODER, ControllerFile("y.ini", ENCODER.content.replace(
        ",X]", ",Y]"))], encoder=1, axes={"x": "X"})  # fmt: skip
    assert any("Y, encoder 1, of y.ini: it is none of the axes X" in w for w in other.warnings)
    refused("siemens-enc-comp", [ENCODER], "it is not of encoder 0", axes={"x": "X"})
    off = changed([ENCODER], "m0\n", "$MA_ENC_COMP_ENABLE[1,X]=0\n")
    why = r"switched off by \$MA_ENC_COMP_ENABLE\[1,X\]=0"
    refused("siemens-enc-comp", off, why, encoder=1, axes={"x": "X"})


@pytest.mark.parametrize("line", [
    "IF $P_SIM GOTOF NEXT", "R1=0.5", "$AN_CEC[0,1]=R1*2", "GOTOB START", "$AN_CEC[R1,1]=0 0",
    "FOR R1=0 TO 2",
])  # fmt: skip
def test_what_only_running_the_program_would_tell_is_refused(line):
    files = changed([STOPPED], "\nM0\n", f"\n{line}\n")
    refused("siemens-cec", files, "line 13: expected", sign="error")


def test_lines_that_switch_are_read():
    assert read("siemens-cec", LOAD, sign="error").curves["EXX"].errors == CURVE
    refused("siemens-cec", OFF, r"table 0 of CEC_OFF\.SPF: switched off by "
            r"\$SN_CEC_TABLE_ENABLE\[0\]=FALSE, so that it does nothing", sign="error")  # fmt: skip
    on = changed(OFF, "ENABLE[0]=FALSE", "ENABLE[0]=1")
    assert read("siemens-cec", on, sign="error").curves["EXX"].errors == CURVE
    # What stands last counts.
    axis_off = changed(LOAD, "$MA_CEC_ENABLE[AX1]=TRUE", "$MA_CEC_ENABLE[AX1]=0")
    refused("siemens-cec", axis_off, r"switched off by \$MA_CEC_ENABLE\[AX1\]=0", sign="error")


def test_a_table_that_is_off_does_not_hide_those_that_act():
    second = OFF[0].content.replace("[0]", "[1]").replace("[0,", "[1,").replace("(AX1)", "(AX2)")
    found = read("siemens-cec", [*LOAD, ControllerFile("b.spf", second)], sign="error")
    assert list(found.curves) == ["EXX"]
    assert any("table 1 of b.spf: switched off" in warning for warning in found.warnings)


def test_tables_of_axes_that_are_none_of_ours_are_left_aside():
    rotary = LOAD[0].content.replace("[0]", "[1]").replace("[0,", "[1,").replace("(AX1)", "(AX5)")
    found = read("siemens-cec", [*LOAD, ControllerFile("b.spf", rotary)], sign="error")
    assert any("AX5 is none of the axes AX1, AX2, AX3 (options.axes)" in w for w in found.warnings)
    refused("siemens-cec", LOAD, "AX1 is none of the axes X1", sign="error", axes={"x": "X1"})


def test_an_archive_of_several_programs_is_read_and_its_cut_is_seen():
    first, second = "%_N_A_SPF\n" + STOPPED.content, "%_N_B_SPF\n$MN_A=1\nM17\n"
    whole = [ControllerFile("a.arc", first + second)]
    assert read("siemens-cec", whole, sign="error").curves["EXX"].errors == CURVE
    cut = [ControllerFile("a.arc", first.replace("M17\n", "") + second)]
    refused("siemens-cec", cut, "M17 before the next program", sign="error")


def test_numbers_and_checksums_of_lines_are_the_control_s_own():
    exx = read("siemens-temperature", SETTINGS, sign="error").curves["EXX"]
    assert exx.at(np.array([0.0, 1000.0])) == pytest.approx([2.0, 12.0])
    other = "N43400 $SA_WORKAREA_PLUS_ENABLE[X1]=0 '1a2b\nM17"
    found = read("siemens-temperature", changed(SETTINGS, "M17", other), sign="error")
    assert found.warnings == ["left aside: $SA_WORKAREA_PLUS_ENABLE: other data in SEA.INI"]
    named = read("siemens-cec", changed(LOAD, "AX1", "LIN1"), sign="error", axes={"x": "LIN1"})
    assert named.curves["EXX"].errors == CURVE
    numbered = changed(LOAD, "$AN_CEC[0,1]=0.001200", "N10 $AN_CEC[0,1]=0.001200 '00ff")
    assert read("siemens-cec", numbered, sign="error").curves["EXX"].errors == CURVE


@pytest.mark.parametrize(("kind", "expected"), [
    ("3", [2.0, 12.0]), ("1", [2.0, 2.0]), ("2", [0.0, 10.0]), ("'H3'", [2.0, 12.0]),
])  # fmt: skip
def test_the_parts_of_a_temperature_compensation_that_act(kind, expected):
    files = changed(SETTINGS, "M17", f"N32750 $MA_TEMP_COMP_TYPE[X1]={kind} '0123\nM17")
    exx = read("siemens-temperature", files, sign="error").curves["EXX"]
    assert exx.at(np.array([0.0, 1000.0])) == pytest.approx(expected)


@pytest.mark.parametrize("kind", ["0", "4"])
def test_a_temperature_compensation_that_is_off_is_left_aside(kind):
    files = changed(SETTINGS, "M17", f"$MA_TEMP_COMP_TYPE[X1]={kind}\nM17")
    refused("siemens-temperature", files, r"switched off by \$MA_TEMP_COMP_TYPE\[X1\]=" + kind,
            sign="error")  # fmt: skip


# -- Heidenhain --------------------------------------------------------------------------------

NEWER = case("heidenhain-tnc640-tables")


def test_tables_of_newer_controls_are_read():
    exx = read("heidenhain", NEWER, sign="error").curves["EXX"]
    assert exx.positions_mm.tolist() == [0.0, 50.0, 100.0]
    assert exx.errors == pytest.approx([0.0, -1.2, -2.1])


def test_a_column_is_where_its_name_stands():
    gap = " " * 14  # from the column X to Y
    sag = changed(NEWER, " -0.00", f" {gap}-0.00")
    sag = changed(sag, " " * 12 + "+0.0000", " " * 12 + f"{gap}+0.0000")
    assert list(read("heidenhain", sag, sign="error").curves) == ["EYX"]
    refused("heidenhain", changed(NEWER, "  -0.0012", "-0.0012"),
            "each value where the name of its column begins", sign="error")  # fmt: skip
    refused("heidenhain", changed(NEWER, "          -0.0021", "-0.0021   -0.0021"), "line 5: ",
            sign="error")  # fmt: skip
    refused("heidenhain", changed(NEWER, "+100.0000", "+40.0000 "), "increasing positions",
            sign="error")  # fmt: skip


def test_the_negative_direction_of_newer_tables_is_not_read_and_said_so():
    both = changed(NEWER, "+50.0000                    ", "+50.0000      -0.0030       ")
    refused("heidenhain", both, "no value in BACKLASH", sign="error")


def test_the_marked_line_of_a_newer_assignment_counts():
    second = ControllerFile("AXIS_X2.COM", NEWER[0].content.replace("AXIS_X", "AXIS_X2"))
    found = read("heidenhain", [*NEWER, second], sign="error")
    assert any("AXIS_X2.COM: the active line" in warning for warning in found.warnings)
    refused("heidenhain", changed(NEWER, "0    *", "0     "), "marked with \\* in ACTIVE",
            sign="error")  # fmt: skip
    refused("heidenhain", changed(NEWER, ".COM MM", ".COM INCH"), "a table in MM", sign="error")


# -- ISO names ---------------------------------------------------------------------------------

ROTARY_CSV, ROTARY_ETALON = case("isg-etalon-rotary-errors")


def test_errors_along_rotary_axes_are_left_aside():
    for controller, file in (("etalon", ROTARY_ETALON), ("isg-csv", ROTARY_CSV)):
        found = read(controller, [file])
        assert found.curves["EXX"].errors == pytest.approx([0.0, 1.0])
        (warning,) = found.warnings
        assert "EXC" in warning
        assert "errors along A, B, C, U, V and W" in warning
        refused(controller, changed([file], "EXC", "EQC"), "expected an ISO 230-1 error")
    alone = [ControllerFile("c.csv", ROTARY_CSV.content.partition("#\n")[2])]
    refused("isg-csv", alone, "got none in c.csv; left aside: EXC of c.csv, EYC of c.csv, EAC")


# -- MDSI and Fagor ----------------------------------------------------------------------------


def test_a_fagor_table_that_is_off_is_left_aside():
    table = (
        "P15 LSCRWCOM = {}\nP16 NPOINTS = 2\n"
        "P001 {} +0.0 E{} +0.0 E{} +0.0\nP002 {} +9.0 E{} +0.001 E{} +0.0\n"
    )
    both = table.format("ON", *"XXXXXX") + table.format("OFF", *"YYYYYY")
    found = read("fagor", [ControllerFile("a.fgr", both)])
    assert list(found.curves) == ["EXX"]
    assert found.warnings == [
        "left aside: Y of a.fgr: switched off by LSCRWCOM = OFF, so that it does nothing"
    ]


def test_a_fourth_axis_of_a_tune_file_is_left_aside():
    axis = (
        "axLSCompCount[{0}] 2\naxLSCompSpacing[{0}] 1000\naxLSCompPosMin[{0}] 0\n"
        "axLSCompDirNeg[0][{0}] 0\naxLSCompDirNeg[1][{0}] 1\n"
        "axLSCompDirPos[0][{0}] 0\naxLSCompDirPos[1][{0}] 1\n"
    )
    files = [ControllerFile("a.tun", axis.format(0) + axis.format(3))]
    found = read("mdsi", files, sign="error", counts_per_mm=1000.0)
    assert list(found.curves) == ["EXX"]
    assert found.warnings == ["left aside: axis 3: only axes 0, 1 and 2 are X, Y and Z"]
