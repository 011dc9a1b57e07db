"""Verifications from CSV: what comes of each column, and what is said of wrong ones."""

import re
from pathlib import Path

import pytest

from app.files.csv_verification import read_csv_verification
from app.files.delimited_text import UnreadableFile

PAGE = Path(__file__).parents[2] / "docs" / "closing-the-loop.md"
EXAMPLES = re.findall(r"```csv\n(.*?)```", PAGE.read_text("utf-8"), re.S)


@pytest.fixture
def read(tmp_path):
    def read_text(text, name="night.csv", **how):
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        return read_csv_verification(file, **how)

    return read_text


@pytest.fixture
def refused(read):
    """Read what cannot be read; give what is said."""

    def read_wrong(text):
        with pytest.raises(UnreadableFile) as caught:
            read(text)
        return caught.value.detail

    return read_wrong


def test_the_documents_file_of_components(read):
    found = read(EXAMPLES[0])
    assert {k: v for k, v in found.body.items() if k != "observations"} == {
        "label": "night shift",
        "datum": "absolute",
        "repeatability_um": 0.5,
        "instrument": "XL-80, no. 4711",
        "operator": "M. Weber",
    }
    first, _, pitch, square = found.body["observations"]
    assert first == {
        "time": "2026-03-01T06:00:00Z",
        "component": "EXX",
        "position_mm": 250.0,
        "direction": "+",
        "measured_um": 4.31,
        "state": {"spindle_rpm": 0.0},
    }
    assert (pitch["component"], pitch["measured_urad"]) == ("EBX", 12.4)
    assert (square["component"], square["measured_um_per_m"]) == ("SXY", -8.2)
    assert "position_mm" not in square
    assert (list(found.remarks), found.lines[0]) == ([], 7)


def test_the_documents_file_of_points(read):
    found = read(EXAMPLES[1])
    assert found.body["label"] == "night"
    assert found.body["datum"] == "free"
    assert found.body["observations"][0] == {
        "time": "2026-03-01T07:00:00Z",
        "point_mm": [250.0, 100.0, 300.0],
        "tool_offset_mm": [0.0, 0.0, 160.0],
        "measured_um": [1.2, -0.4, 3.3],
        "direction": {"x": "+"},
    }


def test_rotations_and_squareness_may_have_columns_of_their_own(read):
    found = read(
        "time;component;position_mm;measured_um;measured_urad;measured_um_per_m\n"
        "2026-03-01T06:00:00Z;EXX;250;4,31;;\n"
        "2026-03-01T06:01:00Z;EBX;250;;12,4;\n"
        "2026-03-01T06:02:00Z;SXY;;;;-8,2\n"
    )
    length, pitch, square = found.body["observations"]
    assert (length["measured_um"], pitch["measured_urad"]) == (4.31, 12.4)
    assert (square["measured_um_per_m"], list(found.remarks)) == (-8.2, [])


def test_units_are_converted_in_decimal(read):
    found = read(
        "Time;Component;Position [m];Measured [mm];Measured [arcsec]\n"
        "2026-03-01T06:00:00+01:00;D_x(x);0,25;0,0012;\n"
        "2026-03-01T06:00:00+01:00;EBX;0,25;;1\n"
    )
    length, angle = found.body["observations"]
    assert (length["position_mm"], length["measured_um"]) == (250.0, 1.2)
    # One second of arc is 4.848 µrad.
    assert angle["measured_urad"] == pytest.approx(4.8481368, abs=1e-7)


def test_a_column_in_um_holds_other_components_in_their_own_unit(read):
    """As the field of the contract does."""
    found = read("time,component,measured_um\n2026-03-01T06:00:00Z,SXY,-8.2\n")
    assert found.body["observations"] == [
        {"time": "2026-03-01T06:00:00Z", "component": "SXY", "measured_um": -8.2}
    ]


def test_components_and_points_may_stand_in_one_file(read):
    found = read(
        "time,component,position_mm,measured_um,point_x_mm,point_y_mm,point_z_mm,measured_x_um,"
        "measured_y_um,measured_z_um,direction_y\n"
        "2026-03-01T06:00:00Z,EXX,5,1,,,,,,,\n"
        "2026-03-01T06:00:01Z,,,,1,2,3,4,5,6,\N{MINUS SIGN}\n"
    )
    component, point = found.body["observations"]
    assert component["component"] == "EXX"
    assert (point["point_mm"], point["measured_um"]) == ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    assert point["direction"] == {"y": "-"}
    assert "tool_offset_mm" not in point


def test_states_are_numbers_where_there_are_any(read):
    found = read(
        "time,component,measured_um,state spindle_rpm,State: coolant\n"
        "2026-03-01T06:00:00Z,SXY,1,8000,\n"
        "2026-03-01T06:01:00Z,SXY,1,,1\n"
        "2026-03-01T06:02:00Z,SXY,1,,\n"
    )
    states = [o.get("state") for o in found.body["observations"]]
    assert states == [{"spindle_rpm": 8000.0}, {"coolant": 1.0}, None]


def test_setups_are_any_text(read):
    found = read(
        "time,component,measured_um,setup\n"
        "2026-03-01T06:00:00Z,SXY,1,2\n"
        "2026-03-01T06:01:00Z,SXY,1,second clamping\n"
        "2026-03-01T06:02:00Z,SXY,1,\n"
    )
    assert [o.get("setup") for o in found.body["observations"]] == ["2", "second clamping", None]


def test_a_plan_needs_no_values_and_does_not_read_them(read):
    planned = "time,component,position_mm\n2026-03-01T06:00:00Z,EXX,5\n"
    expected = {"time": "2026-03-01T06:00:00Z", "component": "EXX", "position_mm": 5.0}
    assert read(planned, is_planned=True).body["observations"] == [expected]
    measured = "time,component,position_mm,measured_um\n2026-03-01T06:00:00Z,EXX,5,oops\n"
    assert read(measured, is_planned=True).body["observations"] == [expected]
    points = "time,point_x_mm,point_y_mm,point_z_mm\n2026-03-01T06:00:00Z,1,2,3\n"
    assert "measured_um" not in read(points, is_planned=True).body["observations"][0]


def test_what_is_not_read_is_said(read):
    found = read(
        "# machine: mill\n# measured_at: 2026-03-01T06:00:00Z\n# colour: red\n"
        "time,component,measured_um,operator\n2026-03-01T06:00:00Z,SXY,1,Ann\n"
    )
    assert found.machine == "mill"
    told = " ".join(found.remarks)
    for word in ("measured_at", "colour", "operator"):
        assert word in told


HEAD = "time,component,position_mm,direction,measured_um,state rpm\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD, "expected lines of observations, got none"),
        (HEAD + "yesterday,EXX,5,+,1,\n", "line 2, column 1 (time): expected a time such as"),
        (HEAD + "2026-03-01T06:00:00,EXX,5,+,1,\n", "with its zone"),
        (HEAD + "2026-03-01T06:00:00Z,EXQ,5,+,1,\n", "line 2, column 2 (component)"),
        (HEAD + "2026-03-01T06:00:00Z,,5,+,1,\n", "expected a component such as EXX, got none"),
        (HEAD + "2026-03-01T06:00:00Z,EXX,,+,1,\n", "expected a position of EXX in mm, got none"),
        (HEAD + "2026-03-01T06:00:00Z,EXX,5,up,1,\n", "column 4 (direction): expected + or -"),
        (HEAD + "2026-03-01T06:00:00Z,EXX,5,+,,\n", "expected a measured value in µm, got none"),
        (
            HEAD + "2026-03-01T06:00:00Z,EXX,5,+,1,fast\n",
            "(state rpm): expected a number, got 'fast'",
        ),
        (
            "time,component,position_mm,measured_um,measured_urad\n"
            "2026-03-01T06:00:00Z,EXX,5,1,2\n",
            "column 5 (measured_urad): expected one measured value, in µm, got both",
        ),
        (
            "time,component,position_mm,measured_urad\n2026-03-01T06:00:00Z,EXX,5,2\n",
            "line 2: expected a measured value in µm, got one in µrad",
        ),
        (
            "time,component,position_mm,measured_um,measured_x_um\n"
            "2026-03-01T06:00:00Z,EXX,5,1,2\n",
            "column 5 (measured_x_um): expected a component or a point, and not both, got both",
        ),
        ("# datum: last\n" + HEAD, "expected datum among absolute, first, free, got 'last'"),
        (
            "time,component,measured_urad,measured_um_per_m\n2026-03-01T06:00:00Z,SXY,2,3\n",
            "expected one measured value, in µm/m, got both",
        ),
        (
            "time,component,position_mm,measured_um,measured_urad,measured_um_per_m\n"
            "2026-03-01T06:00:00Z,EXX,5,,,3\n",
            "expected a measured value in µm, got one in µm/m",
        ),
        ("time,component,position_mm\n", "measured_um (or measured_urad), or at points"),
        ("time,component,measured [furlong]\n", "expected the unit of measured"),
        ("component,measured_um\n", "without time"),
        ("time,component,measured_um,state a,State: a\n", "expected each state in one column"),
        (
            "time,component,position_mm,measured_mm\n2026-03-01T06:00:00Z,EBX,5,1\n",
            "line 2: expected a measured value in µrad, got one in mm",
        ),
        (
            "time,point_x_mm,point_y_mm,point_z_mm,measured_x_um,measured_y_um,measured_z_um\n"
            "2026-03-01T06:00:00Z,1,2,,4,5,6\n",
            "column 4 (point_z_mm): expected point_z in mm, got none",
        ),
    ],
)
def test_what_is_wrong_is_told_at_its_place(refused, text, said):
    assert said in refused(text)


def test_a_cell_that_is_no_number_is_complained_of_once(refused):
    said = refused(HEAD + "2026-03-01T06:00:00Z,EXX,5 mm,+,1,\n")
    assert said.count("\n") == 0
    assert "column 3 (position_mm): expected a number in mm, got '5 mm'" in said


def test_a_comment_that_is_not_read_is_told_what_is_once_each(read):
    text = HEAD.replace("time", "# labl: x\ntime", 1) + "2026-03-01T06:00:00Z,EXX,5,+,1,\n"
    (remark,) = read(text).remarks
    assert "'labl' is not read" in remark
    assert remark.count("repeatability_um") == 1


def test_a_file_over_the_limit_is_refused_before_its_values_are_read(refused):
    told = refused(HEAD + "yesterday,EXQ,much,up,,\n" * 100_001)
    assert told.endswith("expected at most 100000 lines of values, got 100001")
    assert "line 2" not in told
